"""Light that comes through thin parts: ear rims, nostrils, lips.

Behind each point lies, straight through the flesh, a point of the far side. What leaves here is the blurred light that
arrived there, weighed by the transmittance of a slab as thick as the flesh between (`slab_weights`). The ray goes along
the inward normal rather than towards each light: diffuse light has forgotten where it came from, and one ray serves all
lights, soft ones included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import (
    FIRST_TILE,
    AtlasRaster,
    face_mm_per_texel,
    interpolate,
    local_uv,
    rasterize,
    tile_of_face,
    tiles_of,
)
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe
from skinbake.diffuse.methods import METHODS
from skinbake.diffuse.terms.skin_hits import ascend, skin_points
from skinbake.diffuse.terms.slab_weights import DARK, SlabWeights, slab_weights
from skinbake.irradiance.occluder import Occluder
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
TEXEL_MM = 0.4  # transmitted light is smooth: no finer texels than these are computed or stored
SAMPLED = 256  # rows or columns of texels, of which the mean reflected light is taken
SEEN_SHARE = 0.001  # of the skin: `auto` looks at the brightest part of that size
WORTH = 5.0  # tolerances of the mean radiance that part must reach


def transmit(
    diffused: DiffuseMap,
    mesh: SkinMesh,
    gaussians: GaussianSum,
    size: tuple[int, int],
    gutter: int,
    udim: bool,
    albedo_rgb: Float,
    switch: str,
    tolerance: float,
    occluder: Occluder | None = None,
    medium: SkinMedium | None = None,
    limit: float = np.inf,
) -> tuple[Lobe | None, Decision]:
    """Transmitted light as one more lobe of weight 1, and the plan's line on it.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance; lobes of the surface methods already count exp(-d^2 / 2v) through the flesh, which is then
        taken off the slab's weight.
    size : (width, height)
        Of the texture.
    albedo_rgb : ndarray of shape (3,)
        Mean albedo of the skin, which stands for the reflectance where the profile knows none (energy 1).
    switch : "auto", "on" or "off"
    tolerance : float
        `auto` keeps the term when the brightest `SEEN_SHARE` of the skin gets `WORTH` tolerances of the mean light.
    occluder : Occluder, optional
        Of the mesh, where somebody has one already.
    medium : SkinMedium, optional
        What the skin is made of.
    limit : float
        Root mean square that may be left out; `auto` keeps the term above it, too.

    References
    ----------
    [dEon2007], [Donner2005]
    """
    if switch == "off":
        return None, Decision("transmission", False, "off")
    reflectance = np.where(gaussians.energy_rgb < 0.98, gaussians.energy_rgb, albedo_rgb)
    weights = slab_weights(gaussians, reflectance, medium)
    weights = _without_counted(weights, diffused, gaussians)

    texel_mm = float(np.median(face_mm_per_texel(mesh, size).max(axis=1)))
    coarse = 1 << transmitted_level(texel_mm)
    small = (max(1, size[0] // coarse), max(1, size[1] // coarse))
    atlas = rasterize(mesh, small, max(2, gutter // coarse), udim)
    occluder = occluder or Occluder(mesh)
    rgb, through, reflected = {}, [], []
    for raster in atlas:
        rows, cols = np.nonzero(raster.addressed)
        point, normal = skin_points(raster, mesh, occluder, rows, cols)
        near = np.flatnonzero(occluder.occluded(*_inwards(occluder, point, normal), _reach(weights, len(rows))))
        face, uv, thickness, opposed = far_side(occluder, mesh, point[near], normal[near])
        across = _gather(diffused, mesh, udim, face, uv, _weights_at(weights, thickness, opposed))
        rows, cols = rows[near], cols[near]
        image = np.zeros((len(diffused.lights), *raster.shape, 3), np.float32)
        image[:, rows, cols] = np.maximum(across, 0)
        rgb[raster.tile] = image
        through.append((image[:, rows, cols].sum(axis=(0, 2)), raster.area_mm2[rows, cols]))
        reflected.append(_reflected(diffused, mesh, udim, gaussians, raster))
    rms, peak = _contribution(*_joined(through), *_joined(reflected), sum(float(r.area_mm2.sum()) for r in atlas))
    kept = switch == "on" or peak > WORTH * tolerance or rms > limit
    found = f"{SEEN_SHARE:.1%} of the skin get {peak:.1%} of the mean light and more (rms {rms:.2%})"
    why = f"{switch}: through thin parts {found}, worth it from {WORTH * tolerance:.1%} (rms {limit:.2%})"
    lobe = Lobe(float(gaussians.variance_mm2[-1]), (1.0, 1.0, 1.0), None, rgb) if kept else None
    return lobe, Decision("transmission", kept, why, 0.0 if kept else rms)


def transmitted_level(texel_mm: float) -> int:
    """How often a texture is halved for transmitted light, from the length of a texel of the full size."""
    return int(np.floor(np.log2(max(TEXEL_MM / max(texel_mm, 1e-6), 1.0))))


def _inwards(occluder: Occluder, point: Image, normal: Image) -> tuple[Image, Image]:
    """Rays into the flesh: in by a hundredth of a millimetre and the coordinates' own spacing, off the own facet."""
    inward = np.ascontiguousarray(-normal)
    return point + inward * np.float32(0.01 + 32 * occluder.spacing_mm), inward


def _reach(weights: SlabWeights, rays: int) -> Image:
    """Thickness beyond which all is dark, for each ray."""
    lit = np.flatnonzero(np.abs(weights.weight_rgb).sum(axis=1).max(axis=1) >= DARK)
    last = min(int(lit.max(initial=-1)) + 1, len(weights.thickness_mm) - 1)
    return np.full(rays, weights.thickness_mm[last], np.float32)


def far_side(
    occluder: Occluder, mesh: SkinMesh, point: Image, normal: Image
) -> tuple[NDArray[np.int64], Float, Float, Float]:
    """Where the inward normal leaves the flesh.

    Parameters
    ----------
    occluder : Occluder
    mesh : SkinMesh
    point, normal : ndarrays of shape (n, 3)
        On the surface that rays meet, mm about the occluder's centre, and unit.

    Returns
    -------
    face : ndarray of shape (n,)
        -1 where it never does.
    uv : ndarray of shape (n, 2)
    thickness_mm : ndarray of shape (n,)
    opposed : ndarray of shape (n,)
        Cosine between the way and the outward normal there: 1 through a slab, 0 where it only grazes.
    """
    start, inward = _inwards(occluder, point, normal)
    child, in_1, in_2, distance = occluder.first_hit(start, inward)
    levels = occluder.subdivided.levels
    face, b1, b2 = ascend(child.astype(np.int64), in_1.astype(np.float64), in_2.astype(np.float64), levels)
    barycentric = np.stack([1 - b1 - b2, b1, b2], axis=1)
    uv = np.einsum("nk,nki->ni", barycentric, mesh.corner_uv[face])
    there = np.einsum("nk,nki->ni", barycentric, mesh.corner_normal[face])
    opposed = np.clip((there * inward).sum(axis=1) / np.maximum(np.linalg.norm(there, axis=1), 1e-30), 0, 1)
    missed = child < 0
    opposed[missed] = 0
    return np.where(missed, -1, face), uv, distance.astype(np.float64), opposed


def _without_counted(weights: SlabWeights, diffused: DiffuseMap, gaussians: GaussianSum) -> SlabWeights:
    """Take off what lobes summed over the surface in space already carry through a slab, theory.md 7.2."""
    taken = weights.weight_rgb.copy()
    for i, lobe in enumerate(diffused.lobes):
        if lobe.method and METHODS[lobe.method].through_flesh and lobe.variance_mm2 > 0:
            through = np.exp(-(weights.thickness_mm**2) / (2 * lobe.variance_mm2))
            taken[:, i] -= through[:, None] * gaussians.weight_rgb[i]
    return SlabWeights(weights.thickness_mm, taken)


def _weights_at(weights: SlabWeights, thickness_mm: Float, opposed: Float) -> Image:
    """Weights of the lobes for each ray, (n, N, 3); linear in the logarithm of the thickness, dark beyond the table."""
    table = weights.weight_rgb
    step = float(np.log(weights.thickness_mm[1] / weights.thickness_mm[0]))
    out = np.zeros((len(thickness_mm), *table.shape[1:]), np.float32)
    thinnest_mm = float(weights.thickness_mm[0])
    rays = np.ascontiguousarray(thickness_mm), np.ascontiguousarray(opposed)
    parallel_for(_read_table, len(out), table, thinnest_mm, step, rays, out)
    return out


@kernel
def _read_table(first, stop, table, thinnest_mm, step, rays, out):  # type: ignore[no-untyped-def]
    """`_weights_at` of rays.

    Parameters
    ----------
    first, stop : int
        Rays.
    table : ndarray of shape (K, N, 3)
        Weights at thicknesses in even steps of their logarithm.
    thinnest_mm, step : float
        The first one, and the step.
    rays : tuple of two ndarrays of shape (n,)
        Thickness that each passes, mm, and the factor on its weights.
    out : ndarray of shape (n, N, 3), float32
        Written; zero where it is dark.
    """
    thickness_mm, opposed = rays
    last = len(table) - 1
    for ray in range(first, stop):
        k = np.log(max(thickness_mm[ray], 1e-6) / thinnest_mm) / step
        if not (k < last and opposed[ray] > 0):
            continue
        k = max(k, 0.0)
        low = min(int(k), last - 1)
        t = k - low
        most = 0.0
        for c in range(3):
            total = 0.0
            for i in range(table.shape[1]):
                weight = (table[low, i, c] * (1 - t) + table[low + 1, i, c] * t) * opposed[ray]
                out[ray, i, c] = weight
                total += abs(weight)
            most = max(most, total)
        if most < DARK:
            for i in range(table.shape[1]):
                for c in range(3):
                    out[ray, i, c] = 0


def _gather(
    diffused: DiffuseMap, mesh: SkinMesh, udim: bool, face: NDArray[np.int64], uv: Float, weight: Image
) -> Image:
    """Weighted sum of the lobes at places (n) of the texture, each light apart, shape (L, n, 3)."""
    out = np.zeros((len(diffused.lights), len(face), 3), np.float32)
    lit = weight.any(axis=(1, 2)) & (face >= 0)
    of_face = tile_of_face(mesh) if udim else np.full(len(mesh.faces), FIRST_TILE)
    for tile in tiles_of(mesh, udim):
        pick = np.flatnonzero(lit & (of_face[face] == tile))
        local = local_uv(uv[pick], tile)
        for i, lobe in enumerate(diffused.lobes):
            image = np.asarray(lobe.rgb[tile], np.float32)
            parallel_for(_add_bilinear, len(pick), image, local, pick, np.ascontiguousarray(weight[:, i]), out)
    return out


@kernel
def _add_bilinear(
    first: int, stop: int, image: Image, uv: Float, pick: NDArray[np.int64], weight: Image, out: Image
) -> None:
    """Add weighted light of a lobe, read bilinearly, at places of the texture.

    Parameters
    ----------
    first, stop : int
        Places.
    image : ndarray of shape (L, h, w, 3)
    uv : ndarray of shape (n, 2)
        Within the tile.
    pick : ndarray of shape (n,)
        Row of `weight` and of `out` that each place has.
    weight : ndarray of shape (all, 3)
    out : ndarray of shape (L, all, 3)
        Added to.
    """
    lights, height, width = image.shape[:3]
    for n in range(first, stop):
        around = texels_around(uv[n, 0], uv[n, 1], height, width)
        for light in range(lights):
            for c in range(3):
                out[light, pick[n], c] += weight[pick[n], c] * bilinear(image[light], c, around)


def _reflected(
    diffused: DiffuseMap, mesh: SkinMesh, udim: bool, gaussians: GaussianSum, raster: AtlasRaster
) -> tuple[Image, Image]:
    """Light reflected at a sample of texels, all lights and channels, and the areas they stand for."""
    step = max(1, min(raster.shape) // SAMPLED)
    rows, cols = (step * index for index in np.nonzero(raster.covered[::step, ::step]))
    uv = interpolate(raster, mesh.corner_uv)[rows, cols].astype(np.float64)
    weight = np.broadcast_to(gaussians.weight_rgb.astype(np.float32), (len(rows), *gaussians.weight_rgb.shape))
    light = _gather(diffused, mesh, udim, raster.face_index[rows, cols].astype(np.int64), uv, weight)
    return light.sum(axis=(0, 2)), raster.area_mm2[rows, cols]


def _joined(tiles: list[tuple[Image, Image]]) -> tuple[Float, Float]:
    light, area = (np.concatenate(part).astype(np.float64) for part in zip(*tiles, strict=True))
    return light, area


def _contribution(
    through: Float, through_mm2: Float, reflected: Float, sample_mm2: Float, skin_mm2: float
) -> tuple[float, float]:
    """Rms of the transmitted over the reflected light, and its value in the brightest part over the mean reflected."""
    if sample_mm2.sum() == 0:
        return 0.0, 0.0
    mean = (sample_mm2 * reflected).sum() / sample_mm2.sum()
    if mean <= 0:
        return 0.0, 0.0
    mean_square = (sample_mm2 * reflected**2).sum() / sample_mm2.sum()
    rms = np.sqrt((through_mm2 * through**2).sum() / skin_mm2 / max(mean_square, 1e-300))
    order = np.argsort(-through)
    reached = np.searchsorted(np.cumsum(through_mm2[order]), SEEN_SHARE * skin_mm2)
    return float(rms), float(through[order[reached]] / mean) if reached < len(order) else 0.0
