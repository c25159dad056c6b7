"""Irradiance of the lights of a basis, with shadows, at the texels of an atlas; theory.md 10.6."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster
from skinbake.atlas.sample import texels_around
from skinbake.diffuse.skin_weights import ScatterOf
from skinbake.irradiance.environment_share import NO_OIL
from skinbake.irradiance.oil_albedo import OilLayer, albedo_at
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.slant import Slant
from skinbake.irradiance.surface import texel_surface
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, broadcast, load, mul_add, store
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros
from skinbake.relight.open_sky import OpenSky
from skinbake.scene.spec import SpecularSpec

Image = NDArray[np.float32]
NODES = 65  # of what a cosine lets in, even in its square root: the oil's albedo rises steeply towards grazing
GROUP = 8  # directions that are near each other and are looked at together: all below the horizon, or added up at once


@dataclass(frozen=True)
class Passage:
    """What of light from a direction enters the skin.

    Attributes
    ----------
    specular : SpecularSpec
    oil_albedo : ndarray of shape (C, M, 2)
        Of size 0 where the oil takes nothing off.
    slant : Slant, optional
        How much more of slanted light counts; None where the look leaves that out.
    scatters : callable
        Gives the share of the light that scatters and counts so, of a tile and (H, W): (H, W) or (1, 1).
    """

    specular: SpecularSpec
    oil_albedo: Float = field(default_factory=lambda: NO_OIL)
    slant: Slant | None = None
    scatters: ScatterOf = field(default=lambda tile, shape: np.ones((1, 1), np.float32))

    @property
    def factor_rgb(self) -> Float:
        """The slant's factor at the nodes, (NODES, 3), or (NODES, 1) where it has no colour."""
        if self.slant is None:
            return np.ones((NODES, 1))
        cosine = np.linspace(0, 1, NODES) ** 2
        nodes = np.linspace(0, 1, len(self.slant.factor_rgb))
        return np.stack([np.interp(cosine, nodes, self.slant.factor_rgb[:, c]) for c in range(3)], axis=1)


class _Sky(NamedTuple):
    """What one tile needs of an `OpenSky`.

    Attributes
    ----------
    row : ndarray of shape (h, w), int32
    share : ndarray of shape (n, D), uint8
    normal : ndarray of shape (n, 3), float32
    columns : ndarray of shape (3, D), float32
    """

    row: NDArray[np.int32]
    share: NDArray[np.uint8]
    normal: Image
    columns: Image


class _Texels(NamedTuple):
    """What the texels of a full tile are like.

    Attributes
    ----------
    texels : ndarray of shape (n,), int64
        row * W + col of each that is computed.
    place : ndarray of shape (n,), int64
        Where its result goes.
    normal, smooth_normal : ndarrays of shape (H, W, 3)
    """

    texels: NDArray[np.int64]
    place: NDArray[np.int64]
    normal: Image
    smooth_normal: Image


class _Passage(NamedTuple):
    """What enters the skin at a texel.

    Attributes
    ----------
    oil : OilLayer
    factor_rgb : ndarray of shape (NODES, 3 or 1)
    scatter : ndarray of shape (H, W) or (1, 1), float32
    """

    oil: OilLayer
    factor_rgb: Float
    scatter: Image


def basis_irradiance(
    raster: AtlasRaster,
    scene: SceneData,
    sky: OpenSky,
    passage: Passage,
    light: Image,
    texels: NDArray[np.int64] | None = None,
    zeros: Zeros = np.zeros,
) -> Image:
    """Irradiance of some lights that shine from the sky's directions.

    What the small atlas sees is read bilinearly, from texels that are turned the same way; the cosine is that of the
    texel's own, mapped normal.

    Parameters
    ----------
    raster : AtlasRaster
        Of any size.
    scene : SceneData
    sky : OpenSky
    passage : Passage
    light : ndarray of shape (D, K), float32
        Radiance of each light from each direction times the part of the sphere, 4 pi / D.
    texels : ndarray of shape (n,), optional
        row * W + col of those that are wanted.
    zeros : callable, optional
        Makes the array that comes back.

    Returns
    -------
    ndarray of shape (K, H, W, 3), float32, or (K, n, 3)
        Zero where the atlas is empty.
    """
    surface = texel_surface(raster, scene.mesh, scene.maps, passage.specular, scene.occluder)
    height, width = raster.shape
    chosen = np.flatnonzero(raster.addressed) if texels is None else texels
    out = zeros((light.shape[1], height * width if texels is None else len(texels), 3), np.float32)
    parallel_for(
        _gather,
        len(chosen),
        _Texels(
            chosen,
            chosen if texels is None else np.arange(len(texels)),
            surface.normal,
            surface.smooth_normal,
        ),
        _Sky(
            sky.row[raster.tile],
            sky.share[raster.tile],
            sky.normal[raster.tile],
            _filled_up(sky.towards).T.copy(),
        ),
        _Passage(
            OilLayer(surface.roughness, surface.strength, passage.oil_albedo, surface.f0),
            passage.factor_rgb,
            passage.scatters(raster.tile, raster.shape),
        ),
        np.pad(_filled_up(light), ((0, 0), (0, -light.shape[1] % (2 * LANES)))),
        out,
    )
    return out.reshape(len(out), height, width, 3) if texels is None else out


def _filled_up(rows: Image) -> Image:
    """Rows of directions with zeros after them, whole groups in all: from there no light comes, at no cosine."""
    return np.pad(np.asarray(rows, np.float32), ((0, -len(rows) % GROUP), (0, 0)))


@kernel
def _gather(first, stop, at, sky, passage, light, out):  # type: ignore[no-untyped-def]
    """Add up what the lights send to texels.

    Parameters
    ----------
    first, stop : int
        Of the texels.
    at : _Texels
    sky : _Sky
    passage : _Passage
    light : ndarray of shape (D, K or more)
    out : ndarray of shape (K, places, 3)
        Written.
    """
    count, lights = light.shape
    channels = passage.factor_rgb.shape[1]
    height, width = at.normal.shape[:2]
    h, w = sky.row.shape
    seen, cosines = np.zeros(count, np.float32), np.empty(count, np.float32)
    node, groups = np.empty(count, np.uint32), np.empty(count // GROUP, np.int64)
    enters, total = np.empty((channels, count), np.float32), np.empty((channels, lights), np.float32)
    lets = np.empty((channels, NODES), np.float32)
    for i in range(first, stop):
        row, col = at.texels[i] // width, at.texels[i] % width
        nx, ny, nz = at.normal[row, col, 0], at.normal[row, col, 1], at.normal[row, col, 2]
        around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, h, w)
        _read_share(sky, at.smooth_normal[row, col], around, seen)
        if i == first or passage.scatter.size > 1 or _varies(passage.oil):
            _let_in(passage, row, col, lets)
        for d in range(count):
            cosines[d] = nx * sky.columns[0, d] + ny * sky.columns[1, d] + nz * sky.columns[2, d]
        found = 0
        for begin in range(0, count, GROUP):
            lit = 0
            for d in range(begin, begin + GROUP):
                lit += (cosines[d] > 0.0) & (seen[d] > 0.0)
            groups[found] = begin
            found += lit > 0
        # Short loops without a choice in them, which the compiler makes vectors of
        for d in range(count):
            cosines[d] = max(cosines[d], np.float32(0.0))
            seen[d] *= cosines[d]
            cosines[d] = min(np.sqrt(cosines[d]), np.float32(1.0)) * np.float32(NODES - 1)
        for d in range(count):
            node[d] = min(np.int32(cosines[d]), np.int32(NODES - 2))
            cosines[d] -= np.float32(node[d])
        for c in range(channels):
            of = lets[c]
            for d in range(count):
                below = of[node[d]]
                enters[c, d] = seen[d] * (below + cosines[d] * (of[node[d] + 1] - below))
            _add_up(groups[:found], enters[c], light, total[c])
        for k in range(len(out)):
            for c in range(3):
                out[k, at.place[i], c] = total[c % channels, k]


@kernel(inner=True)
def _varies(oil: OilLayer) -> bool:
    """Whether what the oil takes off differs between texels."""
    return oil.roughness.size > 1 or oil.strength.size > 1 or oil.f0.size > 1


@kernel(inner=True)
def _add_up(groups, enters, light, total):  # type: ignore[no-untyped-def]
    """Sum of what directions send of each light.

    Parameters
    ----------
    groups : ndarray of shape (G,)
        First directions of the groups that count.
    enters : ndarray of shape (D,)
        What of each direction enters.
    light : ndarray of shape (D, K)
        K is a multiple of two vectors.
    total : ndarray of shape (K,)
        Written.
    """
    flat, lights = light.reshape(-1), light.shape[1]
    for k in range(0, lights, 2 * LANES):
        even, odd = broadcast(np.float32(0)), broadcast(np.float32(0))
        even_2, odd_2 = broadcast(np.float32(0)), broadcast(np.float32(0))
        for begin in groups:
            for d in range(begin, begin + GROUP, 2):
                at = d * lights + k
                even = mul_add(load(flat, at), enters[d], even)
                even_2 = mul_add(load(flat, at + LANES), enters[d], even_2)
                odd = mul_add(load(flat, at + lights), enters[d + 1], odd)
                odd_2 = mul_add(load(flat, at + lights + LANES), enters[d + 1], odd_2)
        store(total, k, even + odd)
        store(total, k + LANES, even_2 + odd_2)


@kernel(inner=True)
def _read_share(sky, normal, around, seen):  # type: ignore[no-untyped-def]
    """Shares of a texel of the full atlas, from up to four small ones that are turned the same way.

    Parameters
    ----------
    sky : _Sky
    normal : ndarray of shape (3,)
    around : tuple
        As `texels_around` gives it.
    seen : ndarray of shape (D or more,)
        Written.
    """
    count = sky.share.shape[1]
    i0, i1, fy, j0, j1, fx = around
    seen[:] = 0.0
    total = 0.0
    for turn in range(2):  # where none is turned the same way, any will do
        for corner in range(4):
            r = sky.row[i1 if corner >= 2 else i0, j1 if corner % 2 else j0]
            if r < 0:
                continue
            same = normal[0] * sky.normal[r, 0] + normal[1] * sky.normal[r, 1] + normal[2] * sky.normal[r, 2]
            weight = (fy if corner >= 2 else 1.0 - fy) * (fx if corner % 2 else 1.0 - fx) + 1e-3
            if turn == 0:
                weight *= max(same, 0.0) ** 4
            total += weight
            part = np.float32(weight)
            for d in range(count):
                seen[d] += part * np.float32(sky.share[r, d])
        if total > 0.0:
            break
    if total > 0.0:
        scale = np.float32(1.0 / (255.0 * total))
        for d in range(count):
            seen[d] *= scale


@kernel(inner=True)
def _let_in(passage, row, col, lets):  # type: ignore[no-untyped-def]
    """What enters of light at the nodes' cosines.

    Parameters
    ----------
    passage : _Passage
    row, col : int
        Texel.
    lets : ndarray of shape (3 or 1, NODES)
        Written.
    """
    oil = passage.oil
    roughness = oil.roughness[row, col] if oil.roughness.size > 1 else oil.roughness[0, 0]
    strength = oil.strength[row, col] if oil.strength.size > 1 else oil.strength[0, 0]
    f0 = oil.f0[row, col] if oil.f0.size > 1 else oil.f0[0, 0]
    scatter = passage.scatter[row, col] if passage.scatter.size > 1 else passage.scatter[0, 0]
    for j in range(NODES):
        enters = 1.0
        if oil.table.size > 0:
            cosine = (j / (NODES - 1)) ** 2
            enters = min(max(1.0 - strength * albedo_at(oil.table, cosine, np.float64(roughness), f0), 0.0), 1.0)
        for c in range(len(lets)):
            lets[c, j] = enters * (1.0 + scatter * (passage.factor_rgb[j, c] - 1.0))
