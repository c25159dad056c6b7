"""Which method and which stored size each lobe gets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.diffuse.diffuse_map import Decision
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.profile.gaussian_sum import GaussianSum

# Bilinear reading of texels of side h is wrong by this (h / sigma)^2, rms: measured on a scan whose texels vary 7.7 x
BILINEAR_ERROR = {
    "surface": 0.055,
    "hybrid": 0.055,
    "reference": 0.055,
    "texture": 0.008,
    "stretch": 0.008,
}  # these two are smooth in UV
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
    method : str
        "identity", "texture", "stretch", "hybrid", "surface" or "reference".
    level : int
        Stored at the full size halved this many times.
    spacing : float
        Of surface sums: widest cluster in sigma.
    threshold : float
        Of `hybrid`: predicted error of the blur, over a light's mean, from which on sums take its place.
    why : str
        The numbers that decided.
    """

    method: str
    level: int
    spacing: float
    threshold: float
    why: str


def plan_lobes(resources: LobeResources, gaussians: GaussianSum) -> tuple[LobePlan, ...]:
    """The plan of a fixed method: sizes by the rule of bilinear reading, nothing measured."""
    return tuple(fixed_plan(resources, resources.spec.method, float(v)) for v in gaussians.variance_mm2)


def fixed_plan(resources: LobeResources, method: str, variance_mm2: float) -> LobePlan:
    """One lobe by a given method, stored as small as the tolerance allows."""
    texel_mm2 = resources.mm_per_texel[0] * resources.mm_per_texel[1]
    ratio = variance_mm2 / texel_mm2 if texel_mm2 > 0 else 0.0
    if ratio < IDENTITY_TEXELS2:
        return LobePlan("identity", 0, 0.0, 0.0, f"sigma is {np.sqrt(ratio):.3f} texel: nothing to blur")
    level = storage_level(resources, method, variance_mm2, resources.spec.tolerance)
    if method == "stretch":  # its blocks are whole texels
        while level and (resources.size[0] % (1 << level) or resources.size[1] % (1 << level)):
            level -= 1
    spacing = cluster_spacing(resources.spec.tolerance)
    return LobePlan(
        method,
        level,
        spacing,
        resources.spec.tolerance,
        f"asked for; sigma is {np.sqrt(ratio) / 2**level:.1f} stored texels",
    )


def storage_level(resources: LobeResources, method: str, variance_mm2: float, tolerance: float) -> int:
    """Coarsest level whose bilinear reading costs its share of the tolerance, by the estimate above."""
    coarsest = widest_level(resources.variance_texels2(variance_mm2))
    level = 0
    while level < coarsest:
        h2 = resources.surface.mean_texel_mm2 * 4 ** (level + 1)
        if BILINEAR_ERROR[method] * h2 / variance_mm2 > _STORAGE_SHARE * tolerance:
            break
        level += 1
    return level


def cluster_spacing(tolerance: float) -> float:
    """Spacing whose error takes its share of the tolerance."""
    return float(np.clip(np.sqrt(_CLUSTER_SHARE * tolerance / CLUSTER_ERROR), MIN_SPACING, MAX_SPACING))


def plan_lines(plans: tuple[LobePlan, ...], gaussians: GaussianSum) -> list[Decision]:
    """The plan as a person reads it."""
    return [
        Decision(f"lobe_{i}", p.method != "identity", f"v = {v:.4g} mm^2, {p.method}, size / {2**p.level}: {p.why}")
        for i, (p, v) in enumerate(zip(plans, gaussians.variance_mm2, strict=True))
    ]
