"""Transfer: textures of light from everywhere, scattering included, and how any light is made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles, limited_size
from skinbake.atlas.look_atlas import look_atlas
from skinbake.diffuse.memory import memory_needed_bytes
from skinbake.diffuse.skin_weights import scatter_of
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.errors import MachineError
from skinbake.irradiance.environment_share import NO_OIL
from skinbake.irradiance.oil_albedo import oil_table
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.slant import Slant, decide_incidence, slant_of
from skinbake.machine import physical_memory_bytes
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.relight.basis import LightBasis
from skinbake.relight.basis_irradiance import Passage, basis_irradiance
from skinbake.relight.choose_basis import choose_basis
from skinbake.relight.grey_lights import keep_light
from skinbake.relight.harmonics import harmonics, harmonics_of_sky
from skinbake.relight.judge_basis import DirectBake, judge_basis
from skinbake.relight.light_error import KindError
from skinbake.relight.open_sky import OpenSky, open_sky, visibility_harmonics
from skinbake.relight.passing_images import let_go, passing_zeros
from skinbake.relight.scattering import Scattering
from skinbake.relight.seen_skin import seen_skin
from skinbake.relight.unseen_lights import choosing_skies, unseen_lights
from skinbake.scene.budget import budget_of
from skinbake.scene.decision import Decision, Decisions
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.spec import RelightSpec, SceneSpec

Say = Callable[[str], None]
DEFAULT_SIZE = 1024
ORDER = 14  # of the harmonics in which lights are described to a fitted basis
CHOOSING, POINTS = 8, 8192  # skies and points of the skin by which a basis is chosen
LIT_BYTES, AT_ONCE = 9 << 27, 8  # of lights that are lit together, and how many of them are blurred together
LEAST_TOGETHER = 5  # times as many that are lit together, whatever their bytes
JUDGED_WITHIN = 0.005  # tolerance of the blurs that are compared


@dataclass(frozen=True)
class Transfer:
    """What is left of a skin for lights that come later.

    Attributes
    ----------
    basis : LightBasis
    textures : dict of int to ndarray of shape (T, H, W, 3), float32
        By tile: M under the lights of the basis, before what of the albedo comes after scattering; one each in colour,
        then grey ones as `keep_light` puts them there.
    visibility : dict of int to ndarray of shape (3, h, w, 3)
        By tile: what is open to the sky, as `visibility_harmonics` gives it.
    error : mapping of str to KindError
        On lights that the basis was not made from.
    judged_at : (width, height)
        Size at which that was measured.
    plan : tuple of Decision
    """

    basis: LightBasis
    textures: Tiles
    visibility: Tiles
    error: Mapping[str, KindError]
    judged_at: tuple[int, int]
    plan: tuple[Decision, ...]


def transfer_size(spec: SceneSpec) -> tuple[int, int]:
    """Width and height of the textures of `relight`, in the proportion of the look's."""
    assert spec.relight is not None
    return limited_size(spec.texture.size, spec.relight.size or DEFAULT_SIZE)


def at_texture_size(spec: SceneSpec, size: tuple[int, int]) -> SceneSpec:
    """The look with a texture of another size, and a gutter as wide on the skin."""
    gutter = max(2, -(-spec.texture.gutter * size[0] // spec.texture.size[0]))
    texture = spec.texture.model_copy(update={"size": size, "gutter": gutter, "reduce": "off"})
    return spec.model_copy(update={"texture": texture})


def make_transfer(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    skin: EnteredSkin,
    say: Say = lambda _: None,
) -> Transfer:
    """Textures of a look's `relight`, and their error; theory.md 10.6.

    Parameters
    ----------
    spec : SceneSpec
        With `relight`. Its lights are not used.
    decisions : Decisions
    scene : SceneData
    skin : EnteredSkin
    say : callable
        Told in words what begins.

    Raises
    ------
    MachineError
        More memory is needed than there is.
    """
    relight = spec.relight
    assert relight is not None
    spec = spec.model_copy(update={"lights": ()})  # whatever they are, the textures are the same
    decisions = Decisions(decisions.energy_conservation, True, (), budget_of(spec))
    full = at_texture_size(spec, transfer_size(spec))
    slant, lines = _slant(spec, skin, decisions.budget.negligible)
    passage = Passage(
        spec.specular, oil_table(spec.specular) if decisions.energy_conservation.enabled else NO_OIL, slant,
        scatter_of(skin.gaussians, spec.skin, scene.maps),
    )  # fmt: skip
    say("relighting: tracing what is open to the sky")
    texels = scene.sky_texels(spec.texture)  # which the plans of the look's own skies ask
    if max(texels.size) > max(full.texture.size):
        texels = scene.sky_texels(full.texture)
    small = at_texture_size(spec, texels.size)
    sky = open_sky(full, scene, texels)
    say("relighting: choosing lights")
    basis, line = _choose(relight, scene, sky, passage, spec.output.seed)
    lines += [line, *_left_out(spec)]

    say(f"relighting: {basis.textures} textures of {len(basis)} lights")
    atlas = look_atlas(full.texture, scene.mesh)
    _check_memory(full, basis.textures + _lit_at_once(atlas, basis), len(atlas), len(skin.gaussians.variance_mm2))
    textured = TexturedSkin(scene.mesh, scene.occluder, full.texture.size, full.texture.udim)
    look_around = cache(lambda: seen_skin(sky, textured))
    scattering = Scattering(full, decisions, scene, atlas, skin, slant, look_around, say)
    textures = _scattered(scattering, atlas, scene, sky, passage, basis, say)
    lines += scattering.lines

    # The same at the size at which lights are also baked
    judged = _judged(small, slant is not None, lines)
    close = Decisions(decisions.energy_conservation, True, (), budget_of(judged))
    again = Scattering(judged, close, scene, sky.atlas, skin, slant, look_around)
    compared = _scattered(again, sky.atlas, scene, sky, passage, basis, lambda _: None)
    entered = skin if slant else skin._replace(incidence=None)
    bake = DirectBake(judged, close, scene, sky.atlas, entered, again.view, again.thin)
    error = judge_basis(bake, basis, compared, unseen_lights(spec.output.seed), say)
    # What they leave wrong is in the measured error, and no part of what lights of the look may be wrong by
    plan = tuple(replace(line, error=0.0) for line in lines)
    return Transfer(basis, textures, visibility_harmonics(sky), error, small.texture.size, plan)


def _check_memory(spec: SceneSpec, textures: int, tiles: int, lobes: int) -> None:
    """Refuse early what this machine cannot hold.

    Parameters
    ----------
    spec : SceneSpec
        Of the textures' size.
    textures, tiles, lobes : int

    Raises
    ------
    MachineError
        With the memory it would need and what to change.
    """
    width, height = spec.texture.size
    blurred = memory_needed_bytes((height, width), AT_ONCE, tiles, lobes, spec.diffusion.method)
    needed, there = (textures + 1) * 12 * width * height * tiles + blurred, physical_memory_bytes()
    if needed > there:
        raise MachineError(
            f"relighting by {textures} textures of {tiles} x {width} x {height} texels needs about "
            f"{needed / 2**30:.0f} GiB of memory, this machine has {there / 2**30:.0f} GiB: lower relight.size or "
            "relight.textures"
        )


def _slant(spec: SceneSpec, skin: EnteredSkin, negligible: float) -> tuple[Slant | None, list[Decision]]:
    """Factors of slanted light, where they are worth it for suns, and the plan's line.

    Parameters
    ----------
    spec : SceneSpec
    skin : EnteredSkin
    negligible : float
        Error below which they are left out.
    """
    switch = spec.terms.incidence
    if skin.incidence is None or switch == "off":
        why = "off" if switch == "off" else f"{switch}: {skin.medium.why}"
        return None, [Decision("relight.incidence", False, why)]
    slant = slant_of(skin.incidence, skin.reference_rgb)
    sun = DirectionalLight(name="relight", type="directional", direction=(0, -1, 0), irradiance=(1, 1, 1))
    line = decide_incidence(sun, slant, None, switch, negligible)
    return slant if line.enabled else None, [line]


def _left_out(spec: SceneSpec) -> list[Decision]:
    """What a bake of the same lights might have and these textures have not."""
    why = {
        "beam": "auto: light that enters at a slant is not shifted, for it comes from everywhere at once",
        "diffuse_profile": "auto: a light of the basis may be part of a sky or of a sun, which have different ones",
    }
    return [Decision(f"relight.{term}", False, why[term]) for term in why if getattr(spec.terms, term) != "off"]


def _choose(
    spec: RelightSpec, scene: SceneData, sky: OpenSky, passage: Passage, seed: int
) -> tuple[LightBasis, Decision]:
    """The basis, by the irradiance of points of equal area under harmonics and under some skies."""
    of_skies = np.stack([harmonics_of_sky(each, ORDER)[:, 1] for each in choosing_skies(seed, CHOOSING)], axis=1)
    light = (harmonics(sky.towards, ORDER) * (4 * np.pi / len(sky.towards))).astype(np.float32)
    lit = [
        basis_irradiance(raster, scene, sky, passage, light, texels)[..., 1].T
        for raster, texels in zip(sky.atlas, _points(sky.atlas), strict=True)
    ]
    return choose_basis(spec, np.concatenate(lit).astype(np.float64), of_skies, seed)


def _points(atlas: Atlas) -> list[NDArray[np.int64]]:
    """Texels of each tile, some twice, that stand for equal areas."""
    area = [np.cumsum(raster.area_mm2.ravel(), dtype=np.float64) for raster in atlas]
    whole = max(sum(float(each[-1]) for each in area), 1e-30)
    places = [(np.arange(round(POINTS * each[-1] / whole)) + 0.5) / POINTS * whole for each in area]
    return [np.minimum(np.searchsorted(a, p), len(a) - 1) for a, p in zip(area, places, strict=True)]


def _lit_at_once(atlas: Atlas, basis: LightBasis) -> int:
    """How many lights are lit together, the even one among them: to read what is open takes as long as 100 lights."""
    of_one = 12 * sum(raster.coverage.size for raster in atlas)
    return min(max(LIT_BYTES // (AT_ONCE * of_one), LEAST_TOGETHER) * AT_ONCE, len(basis) + 1)


def _scattered(
    scattering: Scattering, atlas: Atlas, scene: SceneData, sky: OpenSky, passage: Passage, basis: LightBasis, say: Say
) -> Tiles:
    """M under each light of a basis as its textures, (T, H, W, 3) a tile.

    A light that is negative in places goes with so much even light that it is not, which is taken off again.

    Parameters
    ----------
    scattering : Scattering
    atlas : Atlas
    scene : SceneData
    sky : OpenSky
    passage : Passage
    basis : LightBasis
    say : callable
    """
    part = 4 * np.pi / len(sky.towards)
    light = basis.from_directions(sky.towards)
    lifted = np.maximum(-light.min(axis=0), 0) / part
    columns = np.concatenate([np.full((len(light), 1), part), light + lifted * part], axis=1).astype(np.float32)
    columns = np.maximum(columns, 0)
    out = {raster.tile: np.empty((basis.textures, *raster.shape, 3), np.float32) for raster in atlas}
    even: Tiles = {}
    at_once = _lit_at_once(atlas, basis)
    for start in range(0, len(basis) + 1, at_once):
        some = columns[:, start : start + at_once]
        lit = {r.tile: basis_irradiance(r, scene, sky, passage, some, zeros=passing_zeros) for r in atlas}
        for begin in range(0, some.shape[1], AT_ONCE):
            number = start + begin - 1  # of the first of these lights; even light comes before all
            say(f"relighting: scattering {min(number + AT_ONCE, len(basis))} of {len(basis)}")
            batch = {tile: images[begin : begin + AT_ONCE] for tile, images in lit.items()}
            for tile, images in scattering.exitance(batch).items():
                let_go(batch[tile])
                even.setdefault(tile, images[0].copy())
                for k, image in enumerate(images, number):
                    if k >= 0:
                        image -= np.float32(lifted[k]) * even[tile]
                        keep_light(out[tile], basis, k, image)
            del images, image  # or they would be in memory beside the next ones
    return out


def _judged(small: SceneSpec, slanted: bool, lines: list[Decision]) -> SceneSpec:
    """The look in which lights are baked to be compared: small, blurred closely, with the same terms."""
    of_term = {line.term.removeprefix("relight."): line.enabled for line in lines}
    switches = {
        "incidence": "on" if slanted else "off",
        "beam": "off",
        "diffuse_profile": "off",
        "curvature": "on" if of_term.get("curvature") else "off",
        # As near as the blur is: `on` would trace the finest there is for each light
        "interreflection": "auto" if of_term.get("interreflection") else "off",
        "transmission": "on" if of_term.get("transmission") else "off",
    }
    diffusion = small.diffusion.model_copy(
        update={"probes": 0, "tolerance": min(JUDGED_WITHIN, small.diffusion.tolerance)}
    )
    output = small.output.model_copy(update={"lights": "separate", "precision": "float"})
    terms = small.terms.model_copy(update=switches)
    return small.model_copy(update={"diffusion": diffusion, "terms": terms, "output": output, "lights": ()})
