"""Radiance maps of the whole sphere: directions to trace, and the irradiance of every normal."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.sample import bilinear
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

Image = NDArray[np.float32]
NORMALS = 96  # octahedral table of unshadowed irradiance: 96 x 96 normals, read bilinearly
SKY = (64, 128)  # blocks of a map, whose fluxes are summed up for that table
AT_ONCE = 64  # normals


def direction_of(u: Float, v: Float, rotate_deg: float = 0.0) -> Float:
    """Unit direction that a place of the map shows, shape (..., 3): y up, u = 0.5 towards +z, u = 0.75 towards -x.

    As seen from inside the sphere.

    Parameters
    ----------
    u, v : ndarray of shape (...)
        Place in the map, 0 ... 1, v up.
    rotate_deg : float
        Turns the map about +y, +z towards +x.
    """
    polar, azimuth = np.pi * (1 - np.asarray(v)), 2 * np.pi * (0.5 - np.asarray(u)) + math.radians(rotate_deg)
    return np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)], axis=-1)


class SkySamples:
    """Directions drawn in proportion to radiance times solid angle, theory.md 10.4.

    A low-discrepancy sequence (R2 [Roberts2018]) mapped through the marginal and conditional distributions of the map,
    with some of the samples' density uniform, so that dim parts are not left to chance.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
        Equirectangular map, row 0 at the top.
    rotate_deg : float
        Turns the map about +y, +z towards +x.
    uniform : float
        Share of the samples whose density is uniform.
    """

    def __init__(self, radiance: Image, rotate_deg: float = 0.0, uniform: float = 0.1) -> None:
        height, width = radiance.shape[:2]
        self._radiance, self._rotate_deg = radiance, rotate_deg
        self._row_edges = np.cos(np.pi * np.arange(height + 1) / height)
        self._solid = (2 * np.pi / width) * (self._row_edges[:-1] - self._row_edges[1:])
        self._bright: Float = np.array([row.mean(axis=1, dtype=np.float64).sum() for row in radiance]) * self._solid
        total = float(self._bright.sum())
        self._per_bright: float = (1 - uniform) / total if total > 0 else 0.0
        self._per_solid: float = (uniform if total > 0 else 1.0) / (4 * np.pi)
        rows = self._per_bright * self._bright + self._per_solid * width * self._solid
        self._marginal = np.concatenate([[0], np.cumsum(rows)])
        self._marginal /= self._marginal[-1]

    def _density(self, row: int) -> Float:
        """Share of the samples that each texel of a row gets, (w,)."""
        bright = self._radiance[row].mean(axis=1, dtype=np.float64) * self._solid[row]
        return self._per_bright * bright + self._per_solid * self._solid[row]

    def draw(self, count: int, offset: float = 0.0) -> tuple[Image, Image]:
        """Unit directions (count, 3), and the flux each stands for (count, 3): radiance over density.

        `offset`, from 0 to 1, shifts the sequence.
        """
        directions, radiance, solid = self.draw_parts(count, offset)
        return directions, (radiance * solid[:, None]).astype(np.float32)

    def draw_parts(self, count: int, offset: float = 0.0) -> tuple[Image, Image, Float]:
        """Unit directions (count, 3), their radiance (count, 3), and the part of the sphere each stands for, (count,).

        Parameters
        ----------
        count : int
        offset : float
            As of `draw`.
        """
        height, width = self._radiance.shape[:2]
        plastic = 1.32471795724474602596
        step = np.arange(count) + 0.5
        x, y = (step / plastic + offset) % 1, (step / plastic**2 + offset) % 1
        row = np.clip(np.searchsorted(self._marginal, x, side="right") - 1, 0, height - 1)
        in_row = (x - self._marginal[row]) / np.maximum(self._marginal[row + 1] - self._marginal[row], 1e-300)
        # Rows are summed up only where they are drawn from: a large map would take as much memory again
        col, in_col, density = np.empty(count, np.int64), np.empty(count), np.empty(count)
        for r in np.unique(row):
            drawn = np.flatnonzero(row == r)
            of_row = self._density(r)
            edges = np.concatenate([[0], np.cumsum(of_row)])
            edges /= edges[-1]
            at = np.clip(np.searchsorted(edges, y[drawn], side="right") - 1, 0, width - 1)
            col[drawn], density[drawn] = at, of_row[at]
            in_col[drawn] = (y[drawn] - edges[at]) / np.maximum(edges[at + 1] - edges[at], 1e-300)

        # Uniform in solid angle inside the texel
        edges = self._row_edges
        cosine = edges[row] + np.clip(in_row, 0, 1) * (edges[row + 1] - edges[row])
        v = 1 - np.arccos(np.clip(cosine, -1, 1)) / np.pi
        directions = direction_of((col + np.clip(in_col, 0, 1)) / width, v, self._rotate_deg)
        return directions.astype(np.float32), self._radiance[row, col], self._solid[row] / density / count


def cosine_irradiance(radiance: Image, rotate_deg: float, normal: Float) -> Float:
    """Unshadowed irradiance of unit normals, shape (n, 3): the integral of the sky times the clamped cosine.

    Texels are summed up in blocks as vectors, flux times direction: what a block above the horizon sends is then exact,
    wherever in it a sun stands.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
    rotate_deg : float
    normal : ndarray of shape (n, 3)
    """
    fine = -(-SKY[0] // radiance.shape[0]), -(-SKY[1] // radiance.shape[1])
    if max(fine) > 1:
        radiance = np.repeat(np.repeat(radiance, fine[0], axis=0), fine[1], axis=1)
    height, width = radiance.shape[:2]
    polar = np.pi * np.arange(height + 1) / height
    azimuth = 2 * np.pi * (0.5 - np.arange(width + 1) / width) + math.radians(rotate_deg)
    # Integrals of the direction over each texel: of s^2 and of y s over its row, of sin, cos and 1 over its column
    across = np.diff(polar / 2 - np.sin(2 * polar) / 4)
    up = np.diff(-(np.cos(polar) ** 2) / 2)
    cols = -np.diff([-np.cos(azimuth), np.sin(azimuth), azimuth], axis=1)
    rows, columns = (
        np.round(np.linspace(0, whole, blocks + 1)).astype(np.int64)
        for whole, blocks in zip((height, width), SKY, strict=True)
    )
    flux = np.zeros((SKY[0] * SKY[1], 4, 3))
    integrals = _DirectionIntegrals(across, up, cols)
    parallel_for(_add_fluxes, SKY[0], radiance, integrals, rows, columns, flux)
    # A light on black is a few blocks of many, a grey sky one channel
    lit = np.ascontiguousarray(flux[flux[:, :3].any(axis=(1, 2)), :3])
    channels = 1 if (lit[:, :1] == lit).all() else 3
    out = np.empty((len(normal), channels))
    parallel_for(_convolve, len(normal), np.ascontiguousarray(normal, np.float64), lit, flux[:, 3].copy(), out)
    return np.repeat(out, 3 // channels, axis=1)


def irradiance_table(radiance: Image, rotate_deg: float = 0.0) -> Image:
    """Unshadowed irradiance of every normal as an octahedral map, shape (NORMALS + 1, NORMALS + 1, 3)."""
    out = cosine_irradiance(radiance, rotate_deg, octahedral_normals(NORMALS))
    return out.astype(np.float32).reshape(NORMALS + 1, NORMALS + 1, 3)


def octahedral_normals(cells: int) -> Float:
    """Unit normals at the nodes of an octahedral map that `look_up` reads, shape ((cells + 1)^2, 3)."""
    axis = np.linspace(-1, 1, cells + 1)
    x, y = np.meshgrid(axis, axis)
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0)
    normal = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1).reshape(-1, 3)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


class _DirectionIntegrals(NamedTuple):
    """Integrals of the direction over each texel of a map (h, w).

    Attributes
    ----------
    across, up : ndarrays of shape (h,)
        Over each row, of sin^2 and of cos sin of the polar angle.
    cols : ndarray of shape (3, w)
        Over each column, of sin, cos and 1 of the azimuth.
    """

    across: Float
    up: Float
    cols: Float


@kernel
def _add_fluxes(
    first: int,
    stop: int,
    radiance: Image,
    integrals: _DirectionIntegrals,
    row_edges: NDArray[np.int64],
    col_edges: NDArray[np.int64],
    flux: Float,
) -> None:
    """Sum over each block of radiance times direction times solid angle: red, green, blue, and of radiance 1.

    Parameters
    ----------
    first, stop : int
        Rows of blocks.
    radiance : ndarray of shape (h, w, 3)
    integrals : _DirectionIntegrals
    row_edges, col_edges : ndarrays of shape (rows + 1,) and (columns + 1,)
        Texels between which the blocks lie.
    flux : ndarray of shape (rows * columns, 4, 3)
        Added to: zeros.
    """
    across, up, cols = integrals.across, integrals.up, integrals.cols
    columns = len(col_edges) - 1
    for i in range(first, stop):
        for j in range(columns):
            block = flux[i * columns + j]
            for row in range(row_edges[i], row_edges[i + 1]):
                for col in range(col_edges[j], col_edges[j + 1]):
                    x, y, z = across[row] * cols[0, col], up[row] * cols[2, col], across[row] * cols[1, col]
                    for k in range(4):
                        weight = np.float64(radiance[row, col, k]) if k < 3 else 1.0
                        block[k, 0] += weight * x
                        block[k, 1] += weight * y
                        block[k, 2] += weight * z


@kernel
def _convolve(first: int, stop: int, normal: Float, flux: Float, even: Float, out: Float) -> None:
    """Sum of what blocks send to each normal, scaled so that constant radiance gives exactly pi.

    Parameters
    ----------
    first, stop : int
        Normals.
    normal : ndarray of shape (n, 3)
    flux : ndarray of shape (lit blocks, 3, 3)
        By block, channel and axis, as `_add_fluxes` gives it.
    even : ndarray of shape (blocks, 3)
        Of radiance 1.
    out : ndarray of shape (n, 1) or (n, 3)
        The first channel or all; written.
    """
    channels = out.shape[1]
    x, y, z, sums = np.empty(AT_ONCE), np.empty(AT_ONCE), np.empty(AT_ONCE), np.empty((channels + 1, AT_ONCE))
    for begin in range(first, stop, AT_ONCE):  # many normals at a time, lest each addition waits for the one before
        count = min(AT_ONCE, stop - begin)
        for i in range(count):
            x[i], y[i], z[i] = normal[begin + i, 0], normal[begin + i, 1], normal[begin + i, 2]
        sums[:, :] = 0.0
        for j in range(len(even)):
            a, b, c = even[j, 0], even[j, 1], even[j, 2]
            for i in range(count):
                sent = x[i] * a + y[i] * b + z[i] * c
                sums[channels, i] += sent if sent > 0.0 else 0.0
        for j in range(len(flux)):
            for k in range(channels):
                a, b, c = flux[j, k, 0], flux[j, k, 1], flux[j, k, 2]
                for i in range(count):
                    sent = x[i] * a + y[i] * b + z[i] * c
                    sums[k, i] += sent if sent > 0.0 else 0.0
        for i in range(count):
            for k in range(channels):
                out[begin + i, k] = sums[k, i] * (np.pi / sums[channels, i])


@kernel
def look_up(first: int, stop: int, table: Image, normal: Image, addressed: NDArray[np.bool_], out: Image) -> None:
    """Irradiance at texels by their normals, read bilinearly from `irradiance_table`.

    Parameters
    ----------
    first, stop : int
        Rows.
    table : ndarray of shape (n + 1, n + 1, 3)
    normal : ndarray of shape (H, W, 3)
        Unit.
    addressed : ndarray of shape (H, W)
        Texels to write.
    out : ndarray of shape (H, W, 3)
        Written.
    """
    size = table.shape[0] - 1
    for row in range(first, stop):
        for col in range(addressed.shape[1]):
            if not addressed[row, col]:
                continue
            nx, ny, nz = (
                np.float64(normal[row, col, 0]),
                np.float64(normal[row, col, 1]),
                np.float64(normal[row, col, 2]),
            )
            # Place of the normal in the octahedral map, then four nodes around it
            scale = abs(nx) + abs(ny) + abs(nz)
            if scale == 0.0:
                continue
            x, y = nx / scale, ny / scale
            if nz < 0.0:
                x, y = np.copysign(1.0 - abs(y), x), np.copysign(1.0 - abs(x), y)
            x, y = (x + 1.0) * 0.5 * size, (y + 1.0) * 0.5 * size
            i, j = min(max(int(y), 0), size - 1), min(max(int(x), 0), size - 1)
            fy, fx = y - i, x - j
            for k in range(3):
                out[row, col, k] = bilinear(table, k, (i, i + 1, fy, j, j + 1, fx))
