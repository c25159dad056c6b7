"""Method `auto`: the cheapest method and stored size for each lobe that together meet the tolerance, as measured."""

from __future__ import annotations

from skinbake.diffuse.diffuse_map import PlanLine
from skinbake.diffuse.diffuser import Diffuser
from skinbake.diffuse.plan import LobePlan, fixed_plan, plan_lines
from skinbake.profile.gaussian_sum import GaussianSum


def plan_auto(
    diffuser: Diffuser, gaussians: GaussianSum, seed: int, precision: str
) -> tuple[tuple[LobePlan, ...], list[PlanLine]]:
    """Surface for every lobe."""
    plans = tuple(fixed_plan(diffuser, "surface", float(v)) for v in gaussians.variance_mm2)
    return plans, plan_lines(plans, gaussians)
