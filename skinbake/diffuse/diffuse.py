"""From light that arrives to light that leaves: every Gaussian of the profile, and the error of their sum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from skinbake.atlas import Atlas, Tiles
from skinbake.diffuse.area_sum import area_sum
from skinbake.diffuse.aside import IN_MEMORY, Aside
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.draw_probes import VERIFY, VERIFY_AGAIN, draw_probes
from skinbake.diffuse.make_lobes import make_lobes
from skinbake.diffuse.memoize import LobeLight, Memoize, Memoizer
from skinbake.diffuse.memory import check_memory
from skinbake.diffuse.methods import LobePlan, method_asked_for
from skinbake.diffuse.notices import advice, squeezed_skin
from skinbake.diffuse.planning.auto import plan_auto
from skinbake.diffuse.planning.fixed import plan_fixed
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.source_light import checked_source, scaled_by, scaled_source, unscaled
from skinbake.diffuse.terms.beam import BeamLight
from skinbake.diffuse.terms.diffuse_profile import HELD, EverywhereLight
from skinbake.machine import return_freed
from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.budget import FIT, is_within
from skinbake.scene.decision import Decision
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec


def diffuse(
    source: Tiles,
    lights: tuple[str, ...],
    atlas: Atlas,
    mesh: SkinMesh,
    gaussians: GaussianSum,
    spec: DiffusionSpec,
    seed: int,
    precision: str = "half",
    progress: Callable[[str], None] | None = None,
    remember: Memoize | None = None,
    beam: BeamLight | None = None,
    weights: SkinWeights | None = None,
    plan_for: GaussianSum | None = None,
    aside: Aside = IN_MEMORY,
    everywhere: EverywhereLight | None = None,
) -> DiffuseMap:
    """Blur light by each Gaussian and measure the error of the sum.

    Parameters
    ----------
    source : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile: light that arrives, times albedo^x when it is coloured before scattering; also in the gutter.
    lights : tuple of L str
        Their names.
    atlas : Atlas
        Of the same tiles and size.
    mesh : SkinMesh
    gaussians : GaussianSum
        The profile.
    spec : DiffusionSpec
    seed : int
        Of the probes.
    precision : "half" or "float"
        What the lobes will be written as; its rounding is part of the storage error.
    progress : callable, optional
        Told in words what begins.
    remember : callable, optional
        Asked for what is known of a light already; the result is the same to the last bit.
    beam : BeamLight, optional
        In place of `source` for wider lobes.
    weights : SkinWeights, optional
        Of the Gaussians, where the skin is not the same everywhere.
    plan_for : GaussianSum, optional
        Of the same variances: what the first plan takes for the profile, which is then judged by `gaussians`.
    aside : Aside, optional
        Where lobes stand as soon as they are made and measured, and what they are made of while it is not read.
    everywhere : EverywhereLight, optional
        The part of the light that each lobe takes times a factor of its own.

    Returns
    -------
    DiffuseMap
        Lobes narrowest first. A light gives the same lobes alone as together with others (for the same plan).

    Raises
    ------
    InputError
        If a texel of `source` is not finite: named by tile, row and column; if `spec` asks for what there is not.
    MachineError
        If the memory would not do.

    References
    ----------
    [dEon2007], [Jensen2002]
    """
    tell = progress or (lambda _: None)

    # Check, and scale what float32 could not sum
    fixed = method_asked_for(spec.method, spec.normalise)
    tiles = checked_source(source, lights, atlas)
    lobes, others = len(gaussians.variance_mm2), (beam is not None) + HELD * (everywhere is not None)
    check_memory(atlas[0].shape, len(lights), len(atlas), lobes, spec.method, others, aside.on_disk)
    scaled, exponents = scaled_source(tiles)
    geometry = SkinGeometry(atlas, mesh, aside)
    weights = weights or SkinWeights.of(gaussians, SkinMaps())
    resources = LobeResources(scaled, geometry, spec, weights.scattering_share(atlas), aside)

    def as_scaled(other: Tiles) -> Tiles:
        return scaled_by(checked_source(other, lights, atlas), exponents)

    memoizer = Memoizer(
        resources,
        lights,
        remember,
        resources.with_light(as_scaled(beam.rgb)) if beam else None,
        beam.narrowest_mm2 if beam else np.inf,
        everywhere and everywhere._replace(rgb=as_scaled(everywhere.rgb)),
    )

    # Plan
    if fixed is None:
        tell("planning lobes")
        planned = SkinWeights.of(plan_for, SkinMaps()) if plan_for else weights
        # By the light that lobes have in common: where that is wrong, probes that see each one's own will show it
        plans, decisions = plan_auto(memoizer.in_common(), plan_for or gaussians, planned, seed, precision)
    else:
        plans, decisions = plan_fixed(memoizer.resources, fixed, gaussians)

    # Make and measure
    return_freed()  # arrays of other sizes than those to come
    tell("measuring points")
    probes = draw_probes(geometry, spec.probe_count, seed, VERIFY)
    arrives = area_sum(scaled, geometry.points)

    unblurred: dict[LobeLight, Lobe] = {}  # by the light that they are: the same for most of them

    def finish(number: int, tiles: Tiles) -> Lobe:
        plan, weight = plans[number], gaussians.weight_rgb[number]
        light = memoizer.light_of(plan.parameters.variance_mm2)
        if not plan.method.blurs and light in unblurred:
            return _weighed(unblurred[light], plan, weight)
        made = aside.lobe(_lobe(plan, weight, tiles, geometry, arrives, exponents))
        if not plan.method.blurs:
            unblurred[light] = made
        return made

    made = make_lobes(memoizer, plans, weights, probes, precision, tell, finish)

    # Where the probes show what the plan had not seen: plan with them, and judge by others
    if fixed is None and made.error is not None and not is_within(made.error.rms, spec.tolerance):
        tell("planning again")
        first = made.error.rms
        del made
        plans, decisions = plan_auto(memoizer, gaussians, weights, seed, precision, probes)
        probes = draw_probes(geometry, spec.probe_count, seed, VERIFY_AGAIN)
        made = make_lobes(memoizer, plans, weights, probes, precision, tell, finish)
        why = f"the first plan was wrong by {first:.3%} at probes that it had not seen; judged by others again"
        decisions.append(Decision("second plan", True, why))

    if spec.probe_count:
        decisions += [_fit(gaussians, made.blurs), *squeezed_skin(geometry)]
    met = made.error is None or is_within(made.error.rms, spec.tolerance)
    return DiffuseMap(
        lights=lights,
        lobes=tuple(replace(lobe, error=error) for lobe, error in zip(made.lobes, made.by_lobe, strict=True)),
        error=made.error,
        plan=tuple(decisions),
        tolerance_met=met,
        advice="" if met or made.error is None else advice(spec, made.error, precision),
        worst_mm=None if made.worst is None else probes.position[made.worst].astype(np.float64) + geometry.centre_mm,
    )


def _fit(gaussians: GaussianSum, blurs: float) -> Decision:
    """What the fit of the profile leaves wrong: its relative error, of the part of the light that is blurred.

    M - E = int R (E(x') - E(x)) dA: a profile that is wrong by a share changes what the blur does by that share.

    Parameters
    ----------
    gaussians : GaussianSum
    blurs : float
        Rms of what the blur does, as a share of the light that leaves.
    """
    fit = gaussians.fit_error
    why = f"skin.fit is off by {fit:.2%} of what the blur does, which is {blurs:.1%} of the light (rms)"
    return Decision(FIT, True, why, fit * blurs, f"{len(gaussians.variance_mm2)} Gaussians")


def _weighed(lobe: Lobe, plan: LobePlan, weight_rgb: Float) -> Lobe:
    """A lobe of the same pixels, which are not copied, for another Gaussian.

    Parameters
    ----------
    lobe : Lobe
    plan : LobePlan
    weight_rgb : ndarray of shape (3,)
    """
    r, g, b = weight_rgb.tolist()
    return replace(lobe, variance_mm2=plan.parameters.variance_mm2, weight_rgb=(r, g, b), rgb=dict(lobe.rgb))


def _lobe(
    plan: LobePlan, weight_rgb: Float, tiles: Tiles, geometry: SkinGeometry, arrives: Float, exponents: list[int]
) -> Lobe:
    """A lobe in the light's own brightness; its error is not yet known.

    Parameters
    ----------
    plan : LobePlan
    weight_rgb : ndarray of shape (3,)
    tiles : Tiles
        Its pixels, of scaled light.
    geometry : SkinGeometry
    arrives : ndarray of shape (3,)
        Sum of the scaled light over the skin.
    exponents : list of int
        Of the divisors of each light.
    """
    level = plan.parameters.level
    leaves = area_sum(tiles, geometry.targets(level) if level else geometry.points)
    total = np.divide(leaves, arrives, out=np.ones(3), where=arrives > 0)
    return Lobe(
        variance_mm2=plan.parameters.variance_mm2,
        weight_rgb=(float(weight_rgb[0]), float(weight_rgb[1]), float(weight_rgb[2])),
        method=plan.method.name,
        rgb={tile: unscaled(rgb, exponents) for tile, rgb in tiles.items()},
        total_rgb=(float(total[0]), float(total[1]), float(total[2])),
    )
