"""Plans of lobes by one method: stored sizes by rule, nothing measured."""

from __future__ import annotations

import numpy as np

from skinbake.diffuse.methods import IDENTITY, DiffusionMethod, LobeParameters, LobePlan
from skinbake.diffuse.planning.rules import IDENTITY_TEXELS2, cluster_spacing, stored_level
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.decision import Decision


def plan_fixed(
    resources: LobeResources, method: DiffusionMethod, gaussians: GaussianSum
) -> tuple[tuple[LobePlan, ...], list[Decision]]:
    """Plans of all lobes by one method: sizes by the rule of bilinear reading, nothing measured.

    Parameters
    ----------
    resources : LobeResources
    method : DiffusionMethod
        That the look asks for.
    gaussians : GaussianSum

    Returns
    -------
    plans : tuple of LobePlan
    decisions : list of Decision
        One a lobe.
    """
    plans = tuple(plan_lobe(resources, method, float(v)) for v in gaussians.variance_mm2)
    decisions = [
        Decision(
            f"lobe_{i}",
            plan.method.blurs,
            f"v = {v:.4g} mm^2, {plan.method.name}, size / {2**plan.parameters.level}: {plan.why}",
        )
        for i, (plan, v) in enumerate(zip(plans, gaussians.variance_mm2, strict=True))
    ]
    return plans, decisions


def plan_lobe(resources: LobeResources, method: DiffusionMethod, variance_mm2: float) -> LobePlan:
    """The plan of one lobe by a given method, stored as small as the tolerance allows; `identity` if it is too narrow.

    Parameters
    ----------
    resources : LobeResources
    method : DiffusionMethod
    variance_mm2 : float
        Of the lobe.
    """
    geometry, tolerance = resources.geometry, resources.spec.tolerance
    texel_mm2 = geometry.mm_per_texel[0] * geometry.mm_per_texel[1]
    ratio = variance_mm2 / texel_mm2 if texel_mm2 > 0 else 0.0
    if ratio < IDENTITY_TEXELS2:
        why = f"sigma is {np.sqrt(ratio):.3f} texel: nothing to blur"
        return LobePlan(IDENTITY, LobeParameters(variance_mm2), why)
    coarsest = widest_level(geometry.variance_texels2(variance_mm2))
    level = stored_level(method.bilinear_error, variance_mm2, geometry.mean_texel_mm2, tolerance, coarsest)
    level = method.coarsest_level(geometry.size, level)
    why = f"asked for; sigma is {np.sqrt(ratio) / 2**level:.1f} stored texels"
    return LobePlan(method, LobeParameters(variance_mm2, level, cluster_spacing(tolerance), tolerance), why)
