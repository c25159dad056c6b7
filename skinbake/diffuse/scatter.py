"""Light leaving the skin of a look: `diffuse` and `transmit` with what the look says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import hypot, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.atlas import Atlas
from skinbake.diffuse.aside import IN_MEMORY, Aside
from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.diffuse_map import DiffuseMap
from skinbake.diffuse.light_entering import LightEntering, albedo_of, light_entering
from skinbake.diffuse.memoize import Kind, Make, Values
from skinbake.diffuse.memory import check_memory, disk_needed_bytes
from skinbake.diffuse.notices import too_much
from skinbake.diffuse.skin_weights import SkinWeights, uniform_scatter
from skinbake.diffuse.small_blur import SmallBlur
from skinbake.diffuse.terms.curvature import curve_skin
from skinbake.diffuse.terms.diffuse_profile import HELD
from skinbake.diffuse.terms.even_share import hold_back, part_even_light
from skinbake.diffuse.terms.skin_view import SkinView
from skinbake.diffuse.terms.thin_parts import ThinParts, TranslucentSkin
from skinbake.diffuse.terms.transmission import (
    TransmissionSwitch,
    TransmittedLight,
    look_behind,
    transmit,
    transmitted_lobe,
)
from skinbake.diffuse.thin_light import SentOn, SmallLight, sent_again, sent_on
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.scene_data import SceneData
from skinbake.machine import free_disk_bytes, return_freed
from skinbake.profile import GaussianSum
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.fit import more_gaussians
from skinbake.profile.skin_medium import skin_medium
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.budget import is_within, left_wrong
from skinbake.scene.decision import TOTAL_LIGHT, Decision, Decisions
from skinbake.scene.skin import SkinSpec
from skinbake.scene.spec import SceneSpec

LIKELY_LOBES = 6  # before the profile is fitted
# (kind of result, digest of each light by name, how to make those of some names) -> values by name
Remember = Callable[[Kind, Mapping[str, str], Make], Mapping[str, Values]]


def scatter(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    skin: EnteredSkin,
    say: Callable[[str], None] | None = None,
    remember: Remember | None = None,
    base: EnteredSkin | None = None,
    aside: Aside = IN_MEMORY,
    view: SkinView | None = None,
    thin: ThinParts | None = None,
) -> DiffuseMap:
    """Lobes of the light that enters, times albedo^x (x = 1: pre-scatter texturing), and light through thin parts.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
        Of the look.
    scene : SceneData
    atlas : Atlas
    irradiance : tuple of IrradianceMap
        Of the same tiles.
    skin : EnteredSkin
    say : callable, optional
        Told in words what begins.
    remember : callable, optional
        As in `diffuse`, with a digest of the light behind each name.
    base : EnteredSkin, optional
        Another skin, of the same variances, whose light and plan this one takes: its blurs are then the other's.
    aside : Aside, optional
        Where lobes stand that are made, and what they are made of.
    view : SkinView, optional
        As in `light_entering`.
    thin : ThinParts, optional
        Of this skin on this texture, where somebody has looked behind it already and found it worth it: light comes
        through, whatever the look says, and is not weighed.
    """
    tell = say or (lambda text: None)
    tell("light that enters the skin")
    return_freed()  # tracing takes other arrays
    gaussians, weights = skin.gaussians, SkinWeights.of(skin.gaussians, scene.maps)
    entering = light_entering(spec, decisions, scene, atlas, irradiance, base or skin, aside, view)
    lights, before = irradiance[0].lights, (*decisions.of_look, *irradiance[0].decided)
    spent = left_wrong((*before, *entering.plan), lights, 0.0)
    of_blur = decisions.budget.of_blur(spec.diffusion, spent)  # the same for skins that share blurs
    if base is not None:
        entering = _curved_as(entering, spec, decisions, scene, skin)
    aside.rest()
    return_freed()
    known = partial(_by_digest, remember, entering.digests()) if remember else None
    curved = entering.curved
    budget = decisions.budget
    bends = None if curved is None or curved.spreads_beams_alone else curved  # what it changes is not rounded before
    diffused = diffuse(
        entering.rgb,
        entering.names,
        atlas,
        scene.mesh,
        gaussians,
        of_blur,
        seed=spec.output.seed,
        precision=spec.output.precision,
        progress=say,
        remember=known,
        beam=entering.beam,
        weights=weights,
        plan_for=base and base.gaussians,
        aside=aside._replace(lobe=IN_MEMORY.lobe) if bends else aside,
        everywhere=entering.everywhere,
    )
    plan, skin_light = entering.plan, entering.skin_light
    through_by = {name: _transmitted(spec, entering.slanted, name) for name in entering.names}
    # What each light's terms have left, the blur's error taken as measured
    blur = diffused.error.rms if diffused.error else of_blur.tolerance
    spent = left_wrong((*before, *plan), lights, blur)
    limit = sqrt(max(budget.tolerance**2 - spent**2, 0.0))
    tell("light through thin parts")
    through_skin = TranslucentSkin(
        scene.mesh, scene.occluder, spec.texture, gaussians, entering.mean_albedo, skin_medium(spec.skin),
        uniform_scatter(gaussians, spec.skin), curved,
    )  # fmt: skip
    times = entering.everywhere and entering.everywhere.times(entering.rgb)
    switch = TransmissionSwitch(spec.terms.transmission, spec.diffusion.tolerance, limit)
    again = skin_light and partial(sent_again, skin_light, diffused.lights)
    pass_through = partial(transmit, diffused, lights=through_by, rest=aside.rest, times=times, again=again)
    known_thin, line = thin is not None, Decision("transmission", True, "found to be worth it")
    if thin is None:
        thin, line = look_behind(through_skin, switch, pass_through)
    arrived = SmallLight.of(entering.rgb, thin) if thin and skin_light else None
    even_rgb, everywhere = entering.even_rgb, entering.everywhere and entering.everywhere._replace(rgb={})
    del entering
    through = None
    if thin is not None and known_thin:
        through = transmitted_lobe(diffused, thin, through_by, aside.rest, times)
    elif thin is not None:
        through, line = pass_through(thin=thin, switch=switch)
    straight, small_blur = None, None
    otherwise = [False] * len(diffused.lights) if times is None else [bool((each != 1).any()) for each in times]
    if through is not None and thin is not None:
        if skin_light or everywhere:
            small = skin_light.view.atlas if skin_light else tuple(tile.raster for tile in thin.tiles)
            small_blur = SmallBlur(small, scene.mesh, gaussians, scene.maps, spec.diffusion, diffused.lobes, everywhere)
        enters = [even_rgb * albedo_of(scene.maps, tile.raster, scene.mesh) for tile in thin.tiles]
        even = small_blur.of_even_light() if small_blur and any(otherwise) else None
        straight, kept = part_even_light(diffused, thin, bends, enters, weights, times, even)
        hold_back(through, thin, kept)
    thin = None  # its rays take more memory than a lobe
    return_freed()
    lobes = bends.applied(diffused.lobes, straight, aside.lobe) if bends else diffused.lobes
    if through is not None and arrived is not None and skin_light is not None and small_blur is not None:
        sent = sent_on(
            through, lobes, arrived, diffused.lights, skin_light, small_blur, spec, scene, gaussians, aside.rest,
            curved=bends, otherwise=otherwise,
        )  # fmt: skip
        through, plan = sent.lobe, tuple(_with_sent_on(line, sent) for line in plan)
    through = through and aside.lobe(through)
    if gaussians.table is not None:
        plan = (table_decision(gaussians, gaussians.table, spec.skin), *plan)
    plan = (*plan, *diffused.plan, line)
    left = left_wrong((*before, *plan), lights, blur)
    met = diffused.error is None or is_within(left, budget.tolerance)
    return replace(
        diffused,
        lobes=lobes + ((through,) if through else ()),
        plan=plan,
        tolerance_met=met,
        advice="" if met else diffused.advice or too_much((*before, *plan), left, budget.tolerance),
    )


def _by_digest(remember: Remember, digests: Mapping[str, str], kind: Kind, names: tuple[str, ...], make: Make) -> Any:
    """What is known of the lights that these names stand for."""
    return remember(kind, {name: digests[name] for name in names}, make)


def _with_sent_on(line: Decision, sent: SentOn) -> Decision:
    """The plan's line with what skin sends on of light that came through the flesh, where it is about that."""
    name, _, term = line.term.rpartition(".")
    if term != "interreflection" or name not in sent.more:
        return line
    why = f"{line.why}; {sent.more[name]:.2%} more of light that came through the flesh"
    return replace(line, why=why, error=hypot(line.error, sent.error[name]))


def _curved_as(
    entering: LightEntering, spec: SceneSpec, decisions: Decisions, scene: SceneData, skin: EnteredSkin
) -> LightEntering:
    """Light that enters a base, with what curvature makes of the lobes of the skin itself, and its line of the plan.

    Parameters
    ----------
    entering, spec, decisions, scene, skin
        As of `scatter`.
    """
    terms = spec.terms
    curved, line = curve_skin(
        scene.mesh, spec.texture, skin.gaussians, skin.medium, terms.curvature, decisions.budget.negligible,
        terms.beam != "off",
    )  # fmt: skip
    plan = tuple(line if each.term == line.term else each for each in entering.plan)
    return replace(entering, curved=curved, plan=plan)


def _transmitted(spec: SceneSpec, slanted: frozenset[str], name: str) -> TransmittedLight:
    """What is known of a stored light: of a sum of several, that most of it counts by its incidence or does not."""
    if name != TOTAL_LIGHT:
        return TransmittedLight(spec.light(name), name in slanted)
    return TransmittedLight(spec.lights[0] if len(spec.lights) == 1 else None, 2 * len(slanted) > len(spec.lights))


def table_decision(gaussians: GaussianSum, table: WeightTable, skin: SkinSpec) -> Decision:
    """The plan's line on skin that varies: what varies it, and how near its Gaussians come to every profile of it.

    Parameters
    ----------
    gaussians : GaussianSum
    table : WeightTable
        Theirs.
    skin : SkinSpec
    """
    parts = [f"{name} {nodes[0]:.3g} to {nodes[-1]:.3g}" for name, nodes in zip(table.names, table.nodes, strict=False)]
    if table.scatters:
        parts.append("a share that does not scatter")
    why = "by maps: " + ", ".join(parts)
    if table.names:
        where, error = table.worst
        node = ", ".join(f"{name} {value:.3g}" for name, value in where.items())
        count = np.count_nonzero(gaussians.variance_mm2)
        why += (
            f"; its {count} Gaussians are off by at most {error:.2%} (at {node}; {table.between_rgb.max():.2%} between)"
        )
        if more := more_gaussians(gaussians, skin.fit):
            why += f"; more of them come nearer: skin.fit: {{gaussians: {more}}}"
    return Decision("skin varies", True, why)


def other_lights(spec: SceneSpec) -> int:
    """How many lights are held at a time that lobes may blur besides the first: another of wider lobes (`terms.beam`),
    and those of `terms.diffuse_profile`, where it is on: `auto` will most likely leave it out.
    """
    asked = (spec.terms.beam != "off") + HELD * (spec.terms.diffuse_profile == "on")
    return asked if skin_medium(spec.skin).layers else 0


def refuse_too_large(spec: SceneSpec, decisions: Decisions, tiles: int, on_disk: bool = True) -> None:
    """Stop before anything is rasterised that this machine cannot hold.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
    tiles : int
        How many.
    on_disk : bool
        Whether results stand in files, as in a bake into a folder.

    Raises
    ------
    MachineError
        More memory is needed than there is.
    """
    lights = len(decisions.stored_lights)
    others = other_lights(spec)
    size, otherwise = spec.texture.size[::-1], ""
    if on_disk:
        folder, files = Path(spec.output.dir), disk_needed_bytes(size, lights, tiles, others)
        free = free_disk_bytes(folder)
        if files > free:  # what the disk does not take stays in memory
            on_disk = False
            room = f"{files / 2**30:.0f} GiB of temporary files in {folder} ({free / 2**30:.0f} free)"
            otherwise = f", or make room for {room}"
    check_memory(size, lights, tiles, LIKELY_LOBES, spec.diffusion.method, others, on_disk, otherwise)
