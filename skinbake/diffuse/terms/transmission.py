"""Light that comes through thin parts: ear rims, nostrils, lips.

From each point rays go into the flesh. What leaves here is the light that arrived where they come out, weighed by how
long they are, such that a slab lets through what it does (`flesh_rays`). They look all ways rather than towards each
light: diffuse light has forgotten where it came from, and the same rays serve all lights, soft ones included. One ray
along the normal found too little behind ears, where the light comes about a corner: light in thin parts that no sun
reaches was 0.76 / 0.69 / 0.83 of what walks find on the sample head at an index of 1.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import (
    AtlasRaster,
    interpolate,
    local_uv,
    tile_of_face,
    tiles_of,
)
from skinbake.atlas.sample import texels_around
from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe
from skinbake.diffuse.methods import METHODS
from skinbake.diffuse.terms.far_side import FarSide, factors_of_lights, in_parts
from skinbake.diffuse.terms.flesh_rays import gathered, noise_of_rays, rays_for, through_along
from skinbake.diffuse.terms.thin_parts import FEW_MM, ThinParts, TranslucentSkin, read_weights
from skinbake.diffuse.terms.thin_worth import SEEN_SHARE, contribution
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import on_threads, parallel_for
from skinbake.numerics import Float
from skinbake.scene.lights import LightSpec

Image = NDArray[np.float32]
Index = NDArray[np.int64]
STEEPEST = 0.1  # least cosine at which a ray leaves, of what the lobes carry themselves
SAMPLED = 256  # rows or columns of texels, of which the mean reflected light is taken
LEFT_SHARE = 0.5  # of what is left of the tolerance that noise may take: light that skin sends on comes after it
LEAST_LEFT = 0.15  # of the tolerance that it may take even where nothing is left
WORTH = 5.0  # tolerances of the mean radiance that part must reach
PLAIN = 0.8  # of what may be left out: few texels come within 0.04 of what all say


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


class TransmissionSwitch(NamedTuple):
    """Whether transmitted light is wanted.

    Attributes
    ----------
    terms : "auto", "on" or "off"
        What the look says (`terms.transmission`).
    tolerance : float
        `auto` keeps the term when the brightest `SEEN_SHARE` of the skin gets `WORTH` tolerances of the mean light.
    limit : float
        Root mean square that may be left out; `auto` keeps the term above it, too.
    """

    terms: str
    tolerance: float
    limit: float = np.inf


def look_behind(
    skin: TranslucentSkin, switch: TransmissionSwitch, pass_through: Callable[..., tuple[Lobe | None, Decision]]
) -> tuple[ThinParts | None, Decision]:
    """What lies behind the texels, None where it is plain that it does not count, and the plan's line by a first look.

    Plain is that the look says `off`, or that few texels tell that `auto` is far from taking it. They also tell how
    many rays hold the noise within what is left of the tolerance.

    Parameters
    ----------
    skin : TranslucentSkin
    switch : TransmissionSwitch
    pass_through : callable
        `transmit`, but for `thin`, `switch` and `margin`.
    """
    if switch.terms == "off":
        return None, Decision("transmission", False, "off")
    few = ThinParts.of(skin, FEW_MM)
    _, line = pass_through(thin=few, switch=switch, margin=PLAIN)
    if not line.enabled:
        return None, line
    through = line.error / noise_of_rays(1.0, few.around)
    noise = max(LEFT_SHARE * switch.limit, LEAST_LEFT * switch.tolerance)
    return ThinParts.of(skin, around=rays_for(through, noise)), line


def transmit(
    diffused: DiffuseMap,
    thin: ThinParts,
    switch: TransmissionSwitch,
    lights: Mapping[str, TransmittedLight] | None = None,
    rest: Callable[[], None] = lambda: None,
    times: Float | None = None,
    margin: float = 1.0,
    again: Callable[[Lobe], Float] | None = None,
) -> tuple[Lobe | None, Decision]:
    """Transmitted light as one more lobe, and the plan's line on it.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance; lobes of the surface methods already count exp(-d^2 / 2v) through the flesh, which is then
        taken off the slab's weight.
    thin : ThinParts
        Of the same skin on the same texture.
    switch : TransmissionSwitch
    lights : mapping of str to TransmittedLight, optional
        By the names in `diffused`; of others light comes from everywhere and counts by its incidence. Each of these may
        be the only one that shines; without them all are one.
    rest : callable, optional
        Frees the memory of each lobe that was read.
    times : ndarray of shape (L, N, 3), optional
        How many times each lobe has the light that came in, of each light, as `EverywhereLight.times`.
    margin : float
        Of what may be left out: `auto` leaves out no more than this share of it.
    again : callable, optional
        Rms of what skin sends on to skin of a lobe, by light; asked where the lobe alone would be left out.

    References
    ----------
    [dEon2007], [Donner2005]
    """
    lobe = transmitted_lobe(diffused, thin, lights, rest, times)
    through, reflected = [], []
    for raster, rows, cols, _ in thin.tiles:
        through.append((lobe.rgb[raster.tile][:, rows, cols], raster.area_mm2[rows, cols]))
        reflected.append(_reflected(diffused, thin, raster, rest))
    skin_mm2 = sum(float(each.raster.area_mm2.sum()) for each in thin.tiles)
    if lights is None:
        through, reflected = ([(light.sum(axis=0)[None], area) for light, area in of] for of in (through, reflected))
    by_light, peak, of_light = contribution(through, reflected, skin_mm2)
    shows, limit, rms = WORTH * switch.tolerance, switch.limit, float(by_light.max())
    kept = switch.terms == "on" or peak > margin * shows or rms > margin * limit
    if not kept and again is not None and by_light.any():
        # Where it gathers, as in a nostril, skin may be lit by it more than by what came through there
        rms = float(np.hypot(by_light, again(lobe) / of_light).max())
        kept = rms > margin * limit
    found = f"{SEEN_SHARE:.1%} of the skin get {peak:.1%} of the mean light and more (rms {rms:.2%})"
    why = f"{switch.terms}: through thin parts {found}, worth it from {shows:.1%} (rms {limit:.2%})"
    return lobe if kept else None, Decision("transmission", kept, why, noise_of_rays(rms, thin.around) if kept else rms)


def transmitted_lobe(
    diffused: DiffuseMap,
    thin: ThinParts,
    lights: Mapping[str, TransmittedLight] | None = None,
    rest: Callable[[], None] = lambda: None,
    times: Float | None = None,
) -> Lobe:
    """Transmitted light, whether it is worth it or not.

    Parameters
    ----------
    diffused, thin, lights, rest, times
        As of `transmit`.
    """
    of_names = [(lights or {}).get(name, TransmittedLight(None, True)) for name in diffused.lights]
    rgb, scatter = {}, thin.skin.scatter
    for raster, rows, cols, far in thin.tiles:
        image = np.zeros((len(diffused.lights), *raster.shape, 3), np.float32)
        for some, there in in_parts(len(rows), far):  # what a ray brings of each light is many times the ray
            factor = factors_of_lights(thin.weights, there, of_names, thin.skin.occluder.centre_mm)
            brought = _across(diffused, thin, there, factor, rest, times)
            image[:, rows[some], cols[some]] = gathered(brought, thin.around)
        rgb[raster.tile] = image
    return Lobe(float(thin.gaussians.variance_mm2[-1]), (scatter, scatter, scatter), None, rgb)


def carried_already(diffused: DiffuseMap, thin: ThinParts, far: FarSide, times: Float | None = None) -> Image:
    """What lobes that were summed over the surface in space have of what rays bring already, (n R, 3).

    The face that a ray of length r meets at a cosine has r^2 / cosine of area a unit of solid angle: 2 pi r^2 G(v, r) a
    share of the hemisphere. Through a slab that adds up to exp(-d^2 / 2v), as it must (theory.md 7.2), and the lobe's
    sum is over that and its own side's 1.

    Parameters
    ----------
    diffused : DiffuseMap
    thin : ThinParts
    far : FarSide
        Of one of its tiles.
    times : ndarray of shape (N, 3), optional
        How many times each lobe has the light that came in.
    """
    steep = np.maximum(far.opposed, STEEPEST).astype(np.float32)[:, None]
    less = np.zeros((len(steep), 3), np.float32)
    weights = thin.gaussians.weight_rgb if times is None else thin.gaussians.weight_rgb * times
    for lobe, weight in zip(diffused.lobes, weights, strict=True):
        if lobe.method and METHODS[lobe.method].through_flesh and lobe.variance_mm2 > 0:
            part = thin.weights.thickness_mm**2 / (2 * lobe.variance_mm2)
            along = read_weights(thin.weights, (2 * part * np.exp(-part))[:, None], far) / steep
            whole = 1 + gathered(along, thin.around)
            less += along / np.repeat(whole, len(along) // max(len(whole), 1), axis=0) * weight.astype(np.float32)
    return less


def along_rays(thin: ThinParts, far: FarSide) -> Image:
    """What rays bring of even light, (n R, 3).

    Parameters
    ----------
    thin : ThinParts
    far : FarSide
        Of one of its tiles.
    """
    brought = read_weights(thin.weights, through_along(thin.weights.thickness_mm, thin.weights.through_rgb), far)
    return brought if far.held is None else brought * far.held


def _across(
    diffused: DiffuseMap,
    thin: ThinParts,
    far: FarSide,
    factor: list[Image],
    rest: Callable[[], None],
    times: Float | None,
) -> Image:
    """Light that comes along n rays, (L, n, 3), not below 0.

    Parameters
    ----------
    diffused : DiffuseMap
    thin : ThinParts
    far : FarSide
    factor : list of L ndarrays of shape (n, 3), float32
        On what rays bring, by light.
    rest, times
        As in `transmit`.
    """
    if times is None:
        less = [carried_already(diffused, thin, far)] * len(factor)
    else:
        less = [carried_already(diffused, thin, far, of_light) for of_light in times]
    of_rays = _OfLobe(along_rays(thin, far), less, factor)
    read = thin.lobe_read([lobe.variance_mm2 for lobe in diffused.lobes])
    light = _gather(diffused, thin.skin, far.face, far.uv, lambda number: of_rays if number == read else None, rest)
    if times is not None:  # what rays bring is of the light once
        light /= times[:, read, None].astype(np.float32)
    return np.maximum(light, 0, out=light)


class _OfLobe(NamedTuple):
    """What of a lobe counts at n places.

    Attributes
    ----------
    weight : ndarray of shape (n, 3), float32
    less, factor : lists of L ndarrays of shape (n, 3), float32; one of them in kernels
        What is taken off the weight, and what is on it before, by light.
    """

    weight: Image
    less: list[Image] | Image
    factor: list[Image] | Image


def _gather(
    diffused: DiffuseMap,
    skin: TranslucentSkin,
    face: Index,
    uv: Float,
    of_lobe: Callable[[int], _OfLobe | None],
    rest: Callable[[], None],
) -> Image:
    """Weighted sum of the lobes at places (n) of the texture, each light apart, shape (L, n, 3).

    Parameters
    ----------
    diffused : DiffuseMap
    skin : TranslucentSkin
    face : ndarray of shape (n,)
    uv : ndarray of shape (n, 2)
    of_lobe : callable
        Gives what of a lobe counts, by its number; None: it is not read.
    rest : callable
        As in `transmit`.
    """
    out = np.zeros((len(diffused.lights), len(face), 3), np.float32)
    mesh, udim = skin.mesh, skin.texture.udim
    of_face = tile_of_face(mesh, udim)
    places = []
    for tile in tiles_of(mesh, udim):
        pick = np.flatnonzero(of_face[face] == tile)
        places.append((tile, pick, local_uv(uv[pick], tile)))
    for i, lobe in enumerate(diffused.lobes):
        of = of_lobe(i)
        if of is None:
            continue
        for tile, pick, local in places:
            stored = lobe.rgb[tile]
            around = _Around(np.empty((len(pick), 4), np.int64), np.empty((len(pick), 2)))
            parallel_for(_look_around, len(pick), local, stored.shape[1], stored.shape[2], around)
            on_threads(partial(_add_light, stored, around, pick, of, out), len(stored))
        rest()
    return out


def _add_light(stored: Image, around: _Around, pick: Index, of: _OfLobe, out: Image, light: int) -> None:
    """Add what one light of a lobe, (L, h, w, 3), has at the places of a tile."""
    # Few of many, which may be halves; indexing by an array takes 2.5 times as long
    texels = np.take(stored[light].reshape(-1, 3), around.flat, axis=0).astype(np.float32, copy=False)
    mine = of._replace(less=of.less[light], factor=of.factor[light])
    parallel_for(_add_bilinear, len(pick), texels, around.share, pick, mine, out[light])


class _Around(NamedTuple):
    """The four texels around n places, as `texels_around` has them.

    Attributes
    ----------
    flat : ndarray of shape (n, 4), int64
        row * w + col of the two of the upper row, then of the lower one.
    share : ndarray of shape (n, 2)
        Of the lower row, and of the right column.
    """

    flat: Index
    share: Float


@kernel
def _look_around(first, stop, uv, height, width, out):  # type: ignore[no-untyped-def]
    """Texels around places of the texture.

    Parameters
    ----------
    first, stop : int
        Places.
    uv : ndarray of shape (n, 2)
        Within the tile.
    height, width : int
        Of the texture.
    out : _Around
        Written.
    """
    for n in range(first, stop):
        y0, y1, fy, x0, x1, fx = texels_around(uv[n, 0], uv[n, 1], height, width)
        out.flat[n, 0], out.flat[n, 1] = y0 * width + x0, y0 * width + x1
        out.flat[n, 2], out.flat[n, 3] = y1 * width + x0, y1 * width + x1
        out.share[n, 0], out.share[n, 1] = fy, fx


@kernel
def _add_bilinear(first, stop, texels, share, pick, of, out):  # type: ignore[no-untyped-def]
    """Add weighted light of a lobe, read bilinearly, at places of the texture.

    Parameters
    ----------
    first, stop : int
        Places.
    texels : ndarray of shape (n, 4, 3), float32
        Around each.
    share : ndarray of shape (n, 2)
        As in `_Around`.
    pick : ndarray of shape (n,)
        Row of `of` and of `out` that each place has.
    of : _OfLobe
        Of all places; its `less` and `factor` are the light's, (all, 3).
    out : ndarray of shape (all, 3)
        Added to.
    """
    for n in range(first, stop):
        at, fy, fx = pick[n], share[n, 0], share[n, 1]
        for c in range(3):
            top = texels[n, 0, c] * (1.0 - fx) + texels[n, 1, c] * fx
            bottom = texels[n, 2, c] * (1.0 - fx) + texels[n, 3, c] * fx
            weight = of.weight[at, c] * of.factor[at, c] - of.less[at, c]
            out[at, c] += weight * (top * (1.0 - fy) + bottom * fy)


def _reflected(
    diffused: DiffuseMap, thin: ThinParts, raster: AtlasRaster, rest: Callable[[], None]
) -> tuple[Image, Image]:
    """Light reflected at a sample of texels, (L, m, 3), and the areas they stand for."""
    step = max(1, min(raster.shape) // SAMPLED)
    rows, cols = (step * index for index in np.nonzero(raster.covered[::step, ::step]))
    uv = interpolate(raster, thin.skin.mesh.corner_uv)[rows, cols].astype(np.float64)
    weight = thin.gaussians.weight_rgb.astype(np.float32)
    none, ones = np.zeros((len(rows), 3), np.float32), np.ones((len(rows), 3), np.float32)
    lights = len(diffused.lights)

    def of_lobe(number: int) -> _OfLobe:
        return _OfLobe(np.repeat(weight[None, number], len(rows), axis=0), [none] * lights, [ones] * lights)

    light = _gather(diffused, thin.skin, raster.face_index[rows, cols].astype(np.int64), uv, of_lobe, rest)
    return light, raster.area_mm2[rows, cols]
