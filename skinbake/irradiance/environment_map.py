"""Radiance maps of the whole sphere: directions to trace, and the irradiance of every normal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import shrink
from skinbake.atlas.sample import bilinear
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

Image = NDArray[np.float32]
NORMALS = 96  # octahedral table of unshadowed irradiance: 96 x 96 normals, read bilinearly
SKY = (64, 128)  # to which a map is averaged for that table: the cosine is smooth


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
    with a tenth of the samples' density uniform, so that dim parts are not left to chance.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
        Equirectangular map, row 0 at the top.
    rotate_deg : float
        Turns the map about +y, +z towards +x.
    """

    def __init__(self, radiance: Image, rotate_deg: float = 0.0) -> None:
        height, width = radiance.shape[:2]
        self._radiance, self._rotate_deg = radiance, rotate_deg
        self._row_edges = np.cos(np.pi * np.arange(height + 1) / height)
        self._solid = (2 * np.pi / width) * (self._row_edges[:-1] - self._row_edges[1:])[:, None]
        bright = radiance.mean(axis=2, dtype=np.float64) * self._solid
        share = np.broadcast_to(self._solid / (4 * np.pi), bright.shape)
        self._density = 0.9 * bright / bright.sum() + 0.1 * share if bright.sum() > 0 else share
        self._marginal = np.concatenate([[0], np.cumsum(self._density.sum(axis=1))])
        self._marginal /= self._marginal[-1]
        self._conditional = np.concatenate([np.zeros((height, 1)), np.cumsum(self._density, axis=1)], axis=1)
        self._conditional /= self._conditional[:, -1:]

    def draw(self, count: int, offset: float = 0.0) -> tuple[Image, Image]:
        """Unit directions (count, 3), and the flux each stands for (count, 3): radiance over density.

        `offset`, from 0 to 1, shifts the sequence.
        """
        height, width = self._density.shape
        plastic = 1.32471795724474602596
        step = np.arange(count) + 0.5
        x, y = (step / plastic + offset) % 1, (step / plastic**2 + offset) % 1
        row = np.clip(np.searchsorted(self._marginal, x, side="right") - 1, 0, height - 1)
        in_row = (x - self._marginal[row]) / np.maximum(self._marginal[row + 1] - self._marginal[row], 1e-300)
        conditional = self._conditional
        col = np.array([np.searchsorted(conditional[r], t, side="right") - 1 for r, t in zip(row, y, strict=True)])
        col = np.clip(col, 0, width - 1)
        in_col = (y - conditional[row, col]) / np.maximum(conditional[row, col + 1] - conditional[row, col], 1e-300)

        # Uniform in solid angle inside the texel
        edges = self._row_edges
        cosine = edges[row] + np.clip(in_row, 0, 1) * (edges[row + 1] - edges[row])
        v = 1 - np.arccos(np.clip(cosine, -1, 1)) / np.pi
        directions = direction_of((col + np.clip(in_col, 0, 1)) / width, v, self._rotate_deg)
        density = self._density[row, col][:, None]
        stands_for = self._radiance[row, col] * (self._solid[row] / density / count)
        return directions.astype(np.float32), stands_for.astype(np.float32)


def cosine_irradiance(radiance: Image, rotate_deg: float, normal: Float) -> Float:
    """Unshadowed irradiance of unit normals, shape (n, 3): the integral of the sky times the clamped cosine.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
    rotate_deg : float
    normal : ndarray of shape (n, 3)
    """
    height, width = min(SKY[0], radiance.shape[0]), min(SKY[1], radiance.shape[1])
    fine = -(-SKY[0] // height), -(-SKY[1] // width)
    edges = np.cos(np.pi * np.arange(radiance.shape[0] + 1) / radiance.shape[0])
    weight = (edges[:-1] - edges[1:]).astype(np.float32)[:, None, None]
    mean = shrink(radiance * weight, (height, width)) / shrink(weight, (height, 1))
    sky = np.repeat(np.repeat(mean, fine[0], axis=0), fine[1], axis=1).astype(np.float64)

    h, w = sky.shape[:2]
    edges = np.cos(np.pi * np.arange(h + 1) / h)
    polar = np.pi * (np.arange(h) + 0.5) / h
    u, v = np.meshgrid((np.arange(w) + 0.5) / w, 1 - polar / np.pi)
    solid = np.broadcast_to(((2 * np.pi / w) * (edges[:-1] - edges[1:]))[:, None], (h, w))
    towards = direction_of(u, v, rotate_deg).reshape(-1, 3)
    out = np.zeros((len(normal), 3))
    flux = (sky * solid[..., None]).reshape(-1, 3)
    parallel_for(_convolve, len(normal), normal, towards, flux, solid.ravel(), out)
    return out


def irradiance_table(radiance: Image, rotate_deg: float = 0.0) -> Image:
    """Unshadowed irradiance of every normal as an octahedral map, shape (NORMALS + 1, NORMALS + 1, 3)."""
    axis = np.linspace(-1, 1, NORMALS + 1)
    x, y = np.meshgrid(axis, axis)
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0)
    normal = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1).reshape(-1, 3)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    out = cosine_irradiance(radiance, rotate_deg, normal)
    return out.astype(np.float32).reshape(NORMALS + 1, NORMALS + 1, 3)


@kernel
def _convolve(first: int, stop: int, normal: Float, towards: Float, flux: Float, solid: Float, out: Float) -> None:
    """Sum of flux times clamped cosine, scaled so that constant radiance gives exactly pi.

    Parameters
    ----------
    first, stop : int
        Normals.
    normal : ndarray of shape (n, 3)
    towards : ndarray of shape (m, 3)
        Unit directions of the sky's texels.
    flux : ndarray of shape (m, 3)
        Radiance times solid angle.
    solid : ndarray of shape (m,)
        Solid angle, sr.
    out : ndarray of shape (n, 3)
        Added to: zeros.
    """
    for i in range(first, stop):
        total = 0.0
        for j in range(len(towards)):
            c = normal[i, 0] * towards[j, 0] + normal[i, 1] * towards[j, 1] + normal[i, 2] * towards[j, 2]
            if c > 0.0:
                total += c * solid[j]
                for k in range(3):
                    out[i, k] += c * flux[j, k]
        for k in range(3):
            out[i, k] *= np.pi / total


@kernel
def look_up(first: int, stop: int, table: Image, normal: Image, addressed: NDArray[np.bool_], out: Image) -> None:
    """Irradiance at texels by their normals, read bilinearly from `irradiance_table`.

    Parameters
    ----------
    first, stop : int
        Rows.
    table : ndarray of shape (NORMALS + 1, NORMALS + 1, 3)
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
                out[row, col, k] = bilinear(table, k, i, i + 1, fy, j, j + 1, fx)
