"""Error of light through a basis on lights that it was not made from: each is also baked, at a smaller size.

A sky's bake is off itself, by the noise of its directions: 1 % where 128 of them are traced. So it is baked by two
halves of them that know nothing of each other: the product of what a basis is off of the one and of the other is, on
average, the square of its own error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles, interpolate
from skinbake.diffuse.scatter import scatter
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.terms.skin_view import SkinView
from skinbake.diffuse.terms.thin_parts import ThinParts
from skinbake.irradiance.light_texels import light_texels
from skinbake.irradiance.scene_data import SceneData
from skinbake.kernels.threads import on_threads
from skinbake.numerics import Float
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.relight.basis import LightBasis
from skinbake.relight.grey_lights import summed
from skinbake.relight.light_error import KindError
from skinbake.relight.scattering import summed_lobes
from skinbake.relight.unseen_lights import UnseenLight
from skinbake.scene.budget import budget_of
from skinbake.scene.decision import Decisions
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
AT_ONCE = 32  # lights in memory
BINS = 4096  # of values, of which one is put in order
LIT_WITHIN = 0.0025  # tolerance of their irradiance, between texels whose shadows are traced


class DirectBake(NamedTuple):
    """What a bake of a light needs.

    Attributes
    ----------
    spec : SceneSpec
        With the size of `atlas`, every term on or off, and no lights.
    decisions : Decisions
    scene : SceneData
    atlas : Atlas
    skin : EnteredSkin
    view : SkinView, optional
        What the skin sees of itself, found once for all lights.
    thin : ThinParts, optional
        What lies behind it, too, where light comes through.
    """

    spec: SceneSpec
    decisions: Decisions
    scene: SceneData
    atlas: Atlas
    skin: EnteredSkin
    view: SkinView | None
    thin: ThinParts | None


def baked_lights(bake: DirectBake, lights: Sequence[UnseenLight]) -> Tiles:
    """M of lights by the pipeline of a bake, before what of the albedo comes after scattering, (L, H, W, 3) a tile.

    Parameters
    ----------
    bake : DirectBake
    lights : sequence of UnseenLight
    """
    spec = bake.spec.model_copy(update={"lights": tuple(each.light for each in lights)})
    environments = {each.light.name: each.radiance for each in lights if each.radiance is not None}
    scene = bake.scene.lit_by(environments)
    names = tuple(each.light.name for each in lights)
    decisions = Decisions(bake.decisions.energy_conservation, True, names, budget_of(spec))
    irradiance = light_texels(
        bake.atlas, scene.mesh, scene.maps, spec.lights, spec.shadows, spec.specular,
        decisions.energy_conservation.enabled, environments, spec.output.seed, LIT_WITHIN, scene.occluder,
    )  # fmt: skip
    made = scatter(spec, decisions, scene, bake.atlas, irradiance, bake.skin, view=bake.view, thin=bake.thin)
    alone = np.array([lobe.weight_rgb for lobe in made.lobes])
    weights = SkinWeights(alone, bake.skin.gaussians.table, scene.maps)
    return {raster.tile: summed_lobes(made.lobes, weights, raster.tile, raster.shape) for raster in bake.atlas}


def judge_basis(
    bake: DirectBake,
    basis: LightBasis,
    textures: Tiles,
    lights: Sequence[UnseenLight],
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, KindError]:
    """Error by kind of light.

    Parameters
    ----------
    bake : DirectBake
    basis : LightBasis
    textures : dict of int to ndarray of shape (T, H, W, 3)
        Of the basis, of the size of the bake's atlas.
    lights : sequence of UnseenLight
    say : callable
        Told what begins.
    """
    return judge_bases(bake, [(basis, textures)], lights, say)[0]


def judge_bases(
    bake: DirectBake,
    bases: Sequence[tuple[LightBasis, Tiles]],
    lights: Sequence[UnseenLight],
    say: Callable[[str], None] = lambda _: None,
) -> list[dict[str, KindError]]:
    """Errors of several bases by the same bakes, each as `judge_basis` gives it.

    Parameters
    ----------
    bake : DirectBake
    bases : sequence of (LightBasis, textures)
    lights : sequence of UnseenLight
    say : callable
        Told what begins.
    """
    found: list[dict[str, list[_LightError]]] = [{} for _ in bases]
    for start in range(0, len(lights), AT_ONCE):
        some = lights[start : start + AT_ONCE]
        say(f"relighting: judging by {some[0].kind.replace('_', ' ')}, {start + len(some)} of {len(lights)}")
        twice = {k: again for k, each in enumerate(some) if (again := each.drawn_again)}
        exact = baked_lights(bake, [*some, *twice.values()])
        second = {k: len(some) + place for place, k in enumerate(twice)}
        for (basis, textures), errors in zip(bases, found, strict=True):
            for each, error in zip(some, _errors(bake, basis, textures, some, exact, second), strict=True):
                errors.setdefault(each.kind, []).append(error)
    return [{kind: _of_kind(errors) for kind, errors in each.items()} for each in found]


class _LightError(NamedTuple):
    """Error of one light."""

    light: UnseenLight
    rms: float
    texels: Float
    area_mm2: Float
    clamped: float
    at: dict[str, object]


def _errors(
    bake: DirectBake,
    basis: LightBasis,
    textures: Tiles,
    lights: Sequence[UnseenLight],
    exact: Tiles,
    second: dict[int, int],
) -> list[_LightError]:
    """Error of each light.

    Parameters
    ----------
    bake, basis, textures
        As of `judge_basis`.
    lights : sequence of UnseenLight
    exact : dict of int to ndarray of shape (L or more, H, W, 3)
        By tile: M of these lights, and after them of those that are baked twice.
    second : dict of int to int
        By the number of a light, where in `exact` it is the second time.
    """
    found: dict[int, _LightError] = {}

    def judge(k: int) -> None:
        amount = basis.of_harmonics @ lights[k].harmonics(basis.order)
        of_tiles = {
            tile: (summed(textures[tile], basis, amount), images[k], images[second.get(k, k)])
            for tile, images in exact.items()
        }
        found[k] = _error(lights[k], of_tiles, bake.atlas, bake.scene.mesh)

    on_threads(judge, len(lights))
    return [found[k] for k in range(len(lights))]


def _error(
    light: UnseenLight, of_tiles: dict[int, tuple[Image, Image, Image]], atlas: Atlas, mesh: SkinMesh
) -> _LightError:
    """Error of one light over the skin.

    Parameters
    ----------
    light : UnseenLight
    of_tiles : dict of int to (ndarray, ndarray, ndarray)
        By tile: M through the basis, not yet clamped, and as baked by either half of the directions, (H, W, 3).
    atlas : Atlas
    mesh : SkinMesh
    """
    wrong, right, negative, area, where = [], [], [], [], []
    square = whole = 0.0
    for raster in atlas:
        there = raster.area_mm2 > 0
        through, one, other = (image[there].astype(np.float64) for image in of_tiles[raster.tile])
        shown, weight = np.maximum(through, 0), raster.area_mm2[there][:, None].astype(np.float64)
        square += float((weight * (shown - one) * (shown - other)).sum())
        whole += float((weight * one * other).sum())
        baked = (one + other) / 2
        wrong.append(shown - baked)
        right.append(baked)
        negative.append(np.maximum(-through, 0))
        area.append(raster.area_mm2[there].astype(np.float64))
        rows, columns = np.nonzero(there)
        where.append(np.stack([np.full(len(rows), raster.tile), rows, columns], axis=1))
    off, exact, below, weight = (np.concatenate(each) for each in (wrong, right, negative, area))
    mean = (weight[:, None] * exact).sum() / (3 * weight.sum())
    texel = np.sqrt((off**2).mean(axis=1)) / max(mean, 1e-30)
    tile, row, column = (int(value) for value in np.concatenate(where)[texel.argmax()])
    raster = next(each for each in atlas if each.tile == tile)
    place = interpolate(raster, mesh.corner_position_mm)[row, column]
    height, width = raster.shape
    at = {
        "tile": tile,
        "uv": [round((column + 0.5) / width, 5), round(1 - (row + 0.5) / height, 5)],
        "position_mm": [round(float(value), 2) for value in place],
        "of_mean": round(float(texel.max()), 4),
    }
    clamped = float((weight[:, None] * below).sum() / max((weight[:, None] * exact).sum(), 1e-30))
    return _LightError(light, float(np.sqrt(max(square, 0.0) / max(whole, 1e-30))), texel, weight, clamped, at)


def _of_kind(errors: list[_LightError]) -> KindError:
    """Errors of lights of one kind as one."""
    worst = max(errors, key=lambda each: each.rms)
    texels = np.concatenate([each.texels for each in errors])
    weight = np.concatenate([each.area_mm2 for each in errors])
    told: dict[str, object] = {"name": worst.light.light.name}
    if worst.light.radiance is None:
        told["direction"] = [round(float(v), 5) for v in worst.light.light.direction]  # type: ignore[union-attr]
    return KindError(
        len(errors),
        float(np.sqrt(np.mean([each.rms**2 for each in errors]))),
        _quantile(texels, weight, 0.95),
        worst.rms,
        told,
        worst.at,
        float(np.mean([each.clamped for each in errors])),
    )


def _quantile(values: Float, weight: Float, share: float) -> float:
    """The least of the values, not below 0, that a share of the weight does not exceed: sorts one bin of them."""
    place = (values * ((BINS - 1) / max(float(values.max()), 1e-30))).astype(np.int32)
    reached = np.cumsum(np.bincount(place, weight, BINS))
    wanted = share * reached[-1]
    number = int(np.searchsorted(reached, wanted))
    there = np.flatnonzero(place == number)
    there = there[np.argsort(values[there], kind="stable")]
    before = reached[number - 1] if number else 0.0
    at = int(np.searchsorted(before + np.cumsum(weight[there]), wanted))
    return float(values[there[min(at, len(there) - 1)]])
