"""Light that comes through thin parts: ear rims, nostrils, lips.

Behind each point lies, straight through the flesh, a point of the far side. What leaves here is the blurred light that
arrived there, weighed by the transmittance of a slab as thick as the flesh between (`slab_weights`). The ray goes along
the inward normal rather than towards each light: diffuse light has forgotten where it came from, and one ray serves all
lights, soft ones included.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import (
    FIRST_TILE,
    AtlasRaster,
    coarser_atlas,
    face_mm_per_texel,
    interpolate,
    local_uv,
    tile_of_face,
    tiles_of,
)
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe
from skinbake.diffuse.methods import METHODS
from skinbake.diffuse.terms.far_side import FarSide, far_side, inwards, slant_factors
from skinbake.diffuse.terms.skin_hits import skin_points
from skinbake.diffuse.terms.slab_weights import DARK, SlabWeights, slab_weights
from skinbake.irradiance.occluder import Occluder
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.lights import LightSpec
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
TEXEL_MM = 0.4  # transmitted light is smooth: no finer texels than these are computed or stored
SAMPLED = 256  # rows or columns of texels, of which the mean reflected light is taken
SEEN_SHARE = 0.001  # of the skin: `auto` looks at the brightest part of that size
WORTH = 5.0  # tolerances of the mean radiance that part must reach


class TransmittedLight(NamedTuple):
    """A light that comes through.

    Attributes
    ----------
    light : LightSpec, optional
        None: several in one.
    counted : bool
        Whether it counts by its incidence already (theory.md 9.5).
    """

    light: LightSpec | None
    counted: bool


class _ThinTile(NamedTuple):
    """Texels of a tile that have a far side.

    Attributes
    ----------
    raster : AtlasRaster
        Of the size that transmitted light is computed at.
    rows, cols : ndarrays of shape (n,)
    far : FarSide
        Of these texels.
    """

    raster: AtlasRaster
    rows: Index
    cols: Index
    far: FarSide


class ThinParts(NamedTuple):
    """What lies behind each texel: traced once, good for any light.

    Attributes
    ----------
    weights : SlabWeights
    gaussians : GaussianSum
        Of what scatters.
    tiles : tuple of _ThinTile
    centre_mm : ndarray of shape (3,)
        About which the points of `tiles` lie.
    """

    weights: SlabWeights
    gaussians: GaussianSum
    tiles: tuple[_ThinTile, ...]
    centre_mm: Float

    @classmethod
    def of(
        cls,
        mesh: SkinMesh,
        gaussians: GaussianSum,
        size: tuple[int, int],
        gutter: int,
        udim: bool,
        albedo_rgb: Float,
        occluder: Occluder | None = None,
        medium: SkinMedium | None = None,
        scatter: float = 1.0,
    ) -> ThinParts:
        """Trace inwards from the texels of a texture.

        Parameters
        ----------
        mesh, gaussians, size, gutter, udim, albedo_rgb, occluder, medium, scatter
            As of `transmit`.
        """
        reflectance = np.where(gaussians.energy_rgb < 0.98, gaussians.energy_rgb, albedo_rgb)
        if scatter < 1 or (gaussians.table is not None and gaussians.table.scatters):
            weights, gaussians = _of_what_scatters(gaussians, reflectance, medium)
        else:
            weights = slab_weights(gaussians, reflectance, medium)
        texel_mm = float(np.median(face_mm_per_texel(mesh, size).max(axis=1)))
        coarse = 1 << transmitted_level(texel_mm)
        small = (max(1, size[0] // coarse), max(1, size[1] // coarse))
        occluder = occluder or Occluder(mesh)
        tiles = []
        for raster in coarser_atlas(mesh, size, gutter, udim, small):
            rows, cols = np.nonzero(raster.addressed)
            point, normal = skin_points(raster, mesh, occluder, rows, cols)
            near = np.flatnonzero(occluder.occluded(*inwards(occluder, point, normal), _reach(weights, len(rows))))
            far = far_side(occluder, mesh, point[near], normal[near])
            tiles.append(_ThinTile(raster, rows[near], cols[near], far))
        return cls(weights, gaussians, tuple(tiles), occluder.centre_mm)


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
    lights: Mapping[str, TransmittedLight] | None = None,
    scatter: float = 1.0,
    thin: ThinParts | None = None,
) -> tuple[Lobe | None, Decision]:
    """Transmitted light as one more lobe, and the plan's line on it.

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
    lights : mapping of str to TransmittedLight, optional
        By the names in `diffused`; of others light comes from everywhere and counts by its incidence.
    scatter : float
        Weight of the lobe: share of the light that scatters.
    thin : ThinParts, optional
        What `ThinParts.of` made of the same skin on the same texture.

    References
    ----------
    [dEon2007], [Donner2005]
    """
    if switch == "off":
        return None, Decision("transmission", False, "off")
    thin = thin or ThinParts.of(mesh, gaussians, size, gutter, udim, albedo_rgb, occluder, medium, scatter)
    weights, gaussians, atlas = thin.weights, thin.gaussians, [each.raster for each in thin.tiles]
    carried = _carried_already(weights, diffused, gaussians)
    of_names = [(lights or {}).get(name, TransmittedLight(None, True)) for name in diffused.lights]
    rgb, through, reflected = {}, [], []
    for raster, rows, cols, far in thin.tiles:
        slants = (slant_factors(weights, far, *light, thin.centre_mm) for light in of_names)
        by_lobe = _ByLobe(_at(weights, weights.weight_rgb, far), _at(weights, carried, far), np.stack(list(slants)))
        across = _gather(diffused, mesh, udim, far.face, far.uv, by_lobe)
        image = np.zeros((len(diffused.lights), *raster.shape, 3), np.float32)
        image[:, rows, cols] = np.maximum(across, 0)
        rgb[raster.tile] = image
        through.append((image[:, rows, cols].sum(axis=(0, 2)), raster.area_mm2[rows, cols]))
        reflected.append(_reflected(diffused, mesh, udim, gaussians, raster))
    rms, peak = _contribution(*_joined(through), *_joined(reflected), sum(float(r.area_mm2.sum()) for r in atlas))
    kept = switch == "on" or peak > WORTH * tolerance or rms > limit
    found = f"{SEEN_SHARE:.1%} of the skin get {peak:.1%} of the mean light and more (rms {rms:.2%})"
    why = f"{switch}: through thin parts {found}, worth it from {WORTH * tolerance:.1%} (rms {limit:.2%})"
    lobe = Lobe(float(gaussians.variance_mm2[-1]), (scatter, scatter, scatter), None, rgb) if kept else None
    return lobe, Decision("transmission", kept, why, 0.0 if kept else rms)


def _of_what_scatters(
    gaussians: GaussianSum, reflectance: Float, medium: SkinMedium | None
) -> tuple[SlabWeights, GaussianSum]:
    """Weights of a slab whose first Gaussian, of no width, is light that never entered; and the sum without that."""
    scattered = gaussians.weight_rgb[1:]
    whole = safe_div(scattered, scattered.sum(axis=0)) * gaussians.weight_rgb.sum(axis=0)
    inside = replace(gaussians, variance_mm2=gaussians.variance_mm2[1:], weight_rgb=whole, table=None)
    slab = slab_weights(inside, reflectance, medium)
    padded = np.concatenate([np.zeros_like(slab.weight_rgb[:, :1]), slab.weight_rgb], axis=1)
    none = np.zeros((1, 3))
    return replace(slab, weight_rgb=padded), replace(gaussians, weight_rgb=np.concatenate([none, whole]))


def transmitted_level(texel_mm: float) -> int:
    """How often a texture is halved for transmitted light, from the length of a texel of the full size."""
    return int(np.floor(np.log2(max(TEXEL_MM / max(texel_mm, 1e-6), 1.0))))


def _reach(weights: SlabWeights, rays: int) -> Image:
    """Thickness beyond which all is dark, for each ray."""
    lit = np.flatnonzero(np.abs(weights.weight_rgb).sum(axis=1).max(axis=1) >= DARK)
    last = min(int(lit.max(initial=-1)) + 1, len(weights.thickness_mm) - 1)
    return np.full(rays, weights.thickness_mm[last], np.float32)


def _carried_already(weights: SlabWeights, diffused: DiffuseMap, gaussians: GaussianSum) -> Float:
    """Weights that lobes summed over the surface in space carry through a slab themselves, (K, N, 3); theory.md 7.2."""
    carried = np.zeros_like(weights.weight_rgb)
    for i, lobe in enumerate(diffused.lobes):
        if lobe.method and METHODS[lobe.method].through_flesh and lobe.variance_mm2 > 0:
            through = np.exp(-(weights.thickness_mm**2) / (2 * lobe.variance_mm2))
            carried[:, i] = through[:, None] * gaussians.weight_rgb[i]
    return carried


def _at(weights: SlabWeights, table: Float, far: FarSide) -> Image:
    """Weights of the lobes for each ray, (n, N, 3); linear in the logarithm of the thickness, dark beyond the table."""
    step = float(np.log(weights.thickness_mm[1] / weights.thickness_mm[0]))
    out = np.zeros((len(far.face), *table.shape[1:]), np.float32)
    thinnest_mm = float(weights.thickness_mm[0])
    rays = np.ascontiguousarray(far.thickness_mm), np.ascontiguousarray(far.opposed)
    parallel_for(_read_table, len(out), table, thinnest_mm, step, rays, out)
    return out


@kernel
def _read_table(first, stop, table, thinnest_mm, step, rays, out):  # type: ignore[no-untyped-def]
    """`_at` of rays.

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
        for c in range(3):
            for i in range(table.shape[1]):
                out[ray, i, c] = (table[low, i, c] * (1 - t) + table[low + 1, i, c] * t) * opposed[ray]


class _ByLobe(NamedTuple):
    """What of each lobe counts at n places.

    Attributes
    ----------
    weight, less : ndarrays of shape (n, N, 3), float32
        Its weight, and what is taken off that.
    factor : ndarray of shape (L, n, 3), float32
        On the weights, by light.
    """

    weight: Image
    less: Image
    factor: Image


def _gather(diffused: DiffuseMap, mesh: SkinMesh, udim: bool, face: NDArray[np.int64], uv: Float, of: _ByLobe) -> Image:
    """Weighted sum of the lobes at places (n) of the texture, each light apart, shape (L, n, 3)."""
    out = np.zeros((len(diffused.lights), len(face), 3), np.float32)
    lit = (of.weight.sum(axis=1).max(axis=1) >= DARK) & (face >= 0)
    of_face = tile_of_face(mesh) if udim else np.full(len(mesh.faces), FIRST_TILE)
    for tile in tiles_of(mesh, udim):
        pick = np.flatnonzero(lit & (of_face[face] == tile))
        local = local_uv(uv[pick], tile)
        for i, lobe in enumerate(diffused.lobes):
            image = np.asarray(lobe.rgb[tile], np.float32)
            mine = _ByLobe(np.ascontiguousarray(of.weight[:, i]), np.ascontiguousarray(of.less[:, i]), of.factor)
            parallel_for(_add_bilinear, len(pick), image, local, pick, mine, out)
    return out


@kernel
def _add_bilinear(first, stop, image, uv, pick, of, out):  # type: ignore[no-untyped-def]
    """Add weighted light of a lobe, read bilinearly, at places of the texture.

    Parameters
    ----------
    first, stop : int
        Places.
    image : ndarray of shape (L, h, w, 3)
    uv : ndarray of shape (n, 2)
        Within the tile.
    pick : ndarray of shape (n,)
        Row of `of` and of `out` that each place has.
    of : _ByLobe
        Of this lobe: `weight` and `less` of shape (all, 3).
    out : ndarray of shape (L, all, 3)
        Added to.
    """
    lights, height, width = image.shape[:3]
    for n in range(first, stop):
        around = texels_around(uv[n, 0], uv[n, 1], height, width)
        at = pick[n]
        for light in range(lights):
            for c in range(3):
                weight = of.weight[at, c] * of.factor[light, at, c] - of.less[at, c]
                out[light, at, c] += weight * bilinear(image[light], c, around)


def _reflected(
    diffused: DiffuseMap, mesh: SkinMesh, udim: bool, gaussians: GaussianSum, raster: AtlasRaster
) -> tuple[Image, Image]:
    """Light reflected at a sample of texels, all lights and channels, and the areas they stand for."""
    step = max(1, min(raster.shape) // SAMPLED)
    rows, cols = (step * index for index in np.nonzero(raster.covered[::step, ::step]))
    uv = interpolate(raster, mesh.corner_uv)[rows, cols].astype(np.float64)
    weight = np.broadcast_to(gaussians.weight_rgb.astype(np.float32), (len(rows), *gaussians.weight_rgb.shape))
    factor = np.ones((len(diffused.lights), len(rows), 3), np.float32)
    everything = _ByLobe(weight, np.zeros_like(weight), factor)
    light = _gather(diffused, mesh, udim, raster.face_index[rows, cols].astype(np.int64), uv, everything)
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
