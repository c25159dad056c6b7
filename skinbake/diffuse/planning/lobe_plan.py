"""Which method and which stored size each lobe gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.diffuse.methods import IDENTITY, DiffusionMethod, LobeParameters
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.decision import Decision

_STORAGE_SHARE = 0.6  # of the tolerance
# Clusters of `spacing` sigma are wrong by this spacing^2, rms: 0.0014 on the same scan, 0.004 on small hard-lit shapes
CLUSTER_ERROR = 0.002
_CLUSTER_SHARE = 0.4
MIN_SPACING, MAX_SPACING = 0.4, 1.5
IDENTITY_TEXELS2 = 1e-3  # below this variance a lobe changes no texel by more than 4 x 5e-4 of its contrast


@dataclass(frozen=True)
class LobePlan:
    """How one lobe is made.

    Attributes
    ----------
    method : DiffusionMethod
    parameters : LobeParameters
    why : str
        The numbers that decided.
    """

    method: DiffusionMethod
    parameters: LobeParameters
    why: str


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
    level = method.coarsest_level(geometry.size, _stored_level(resources, method, variance_mm2))
    why = f"asked for; sigma is {np.sqrt(ratio) / 2**level:.1f} stored texels"
    return LobePlan(method, LobeParameters(variance_mm2, level, cluster_spacing(tolerance), tolerance), why)


def _stored_level(resources: LobeResources, method: DiffusionMethod, variance_mm2: float) -> int:
    """Coarsest level whose bilinear reading costs its share of the tolerance."""
    coarsest = widest_level(resources.geometry.variance_texels2(variance_mm2))
    level = 0
    while level < coarsest:
        h2 = resources.geometry.mean_texel_mm2 * 4 ** (level + 1)
        if method.bilinear_error * h2 / variance_mm2 > _STORAGE_SHARE * resources.spec.tolerance:
            break
        level += 1
    return level


def cluster_spacing(tolerance: float) -> float:
    """Side of the widest cluster, in sigma, whose error takes its share of the tolerance."""
    return float(np.clip(np.sqrt(_CLUSTER_SHARE * tolerance / CLUSTER_ERROR), MIN_SPACING, MAX_SPACING))
