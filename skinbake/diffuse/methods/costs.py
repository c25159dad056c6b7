"""What the steps of making a lobe cost, for methods to add up and `auto` to weigh.

Processor seconds of the two-core machine that this was tuned on. Only their ratios matter: nothing is timed in a bake,
so a plan is the same on every machine.
"""

from __future__ import annotations

import numpy as np

from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur import level_size

# A texel, or a texel of each light where they multiply
_WRITE = 7e-8
_BLUR, _BLUR_SIGMA = 7e-9, 4e-9  # the second times sigma in texels
_PREDICT = 2e-8
_LOOK = 8e-9  # whether a texel is to be summed
_SUM = 4e-8
_INTERPOLATE = 1.2e-8
_RISK = 2e-8  # that a lobe left to texture space alone fails at probes which no plan saw: a second plan
_PAIR = 1.6e-10  # a target and a source
_SOURCE = 2.2e-8
_SUMMED = (1.0, 0.12, 0.04)  # share of texels that is not interpolated, from the first size summed on
_FURTHER = 0.4  # each further light that goes along, in units of the first


def texels(resources: LobeResources, level: int) -> int:
    """Number of texels of all tiles at a stored size."""
    height, width = level_size(resources.geometry.size, level)
    return height * width * len(resources.geometry.atlas)


def write_cost(resources: LobeResources, level: int) -> float:
    """Writing a lobe of any method at a stored size."""
    return _WRITE * texels(resources, level) * resources.lights


def risk_cost(resources: LobeResources) -> float:
    """A second plan, times its chance, for a lobe that is wrong where no probe has looked."""
    return _RISK * texels(resources, 0) * _along(resources.lights)


def blur_cost(resources: LobeResources, variance_mm2: float, level: int) -> float:
    """A blur in the texture at a stored size.

    Parameters
    ----------
    resources : LobeResources
    variance_mm2 : float
        Of the lobe.
    level : int
        Of the stored size.
    """
    sigma = np.sqrt(min(resources.geometry.variance_texels2(variance_mm2))) / 2**level
    return float(_BLUR + _BLUR_SIGMA * sigma) * texels(resources, level) * resources.lights


def predict_cost(resources: LobeResources, level: int) -> float:
    """Predicting where such a blur is wrong, and looking for these texels, light by light."""
    return (_PREDICT * _along(resources.lights) + _LOOK * resources.lights) * texels(resources, level)


def interpolate_cost(resources: LobeResources) -> float:
    """Interpolating one texel from half the size."""
    return _INTERPOLATE * resources.lights


def sum_cost(resources: LobeResources, variance_mm2: float, level: int, spacing: float, lights: int) -> float:
    """A surface sum for one texel.

    Parameters
    ----------
    resources : LobeResources
    variance_mm2 : float
        Of the lobe.
    level : int
        Of the stored size.
    spacing : float
        Side of the widest cluster, in sigma.
    lights : int
        Lights that are summed along with one another.
    """
    mean_texel_mm2 = resources.geometry.mean_texel_mm2
    around = (resources.rule.cut + 1) ** 2 * variance_mm2 + 4 * mean_texel_mm2 * 4**level
    pairs = np.pi * around / _source_mm2(resources, variance_mm2, spacing)
    return float(_SUM + _PAIR * pairs * _along(lights))


def sources_cost(resources: LobeResources, variance_mm2: float, spacing: float) -> float:
    """Finding a lobe's own clusters; single texels are there for the probes already.

    Parameters
    ----------
    resources : LobeResources
    variance_mm2 : float
        Of the lobe.
    spacing : float
        Side of the widest cluster, in sigma.
    """
    if resources.sums_texels(variance_mm2, spacing):
        return 0.0
    skin = texels(resources, 0) * resources.geometry.mean_texel_mm2
    return _SOURCE * skin / _source_mm2(resources, variance_mm2, spacing)


def sums_cost(resources: LobeResources, variance_mm2: float, level: int, spacing: float) -> float:
    """Surface sums for all of a stored size, interpolated from smaller sizes as far as that is done.

    Parameters
    ----------
    resources : LobeResources
    variance_mm2 : float
        Of the lobe.
    level : int
        Of the stored size.
    spacing : float
        Side of the widest cluster, in sigma.
    """
    cost, first = sources_cost(resources, variance_mm2, spacing), level
    while resources.interpolates(variance_mm2, first):
        first += 1
    for finer, summed in zip(range(first, level - 1, -1), (*_SUMMED, *(_SUMMED[-1],) * first), strict=False):
        each = summed * sum_cost(resources, variance_mm2, finer, spacing, resources.lights)
        cost += texels(resources, finer) * (each + interpolate_cost(resources))
    return cost


def _along(lights: int) -> float:
    """What lights that go along with one another take, in units of one alone."""
    return 1 + _FURTHER * (lights - 1)


def _source_mm2(resources: LobeResources, variance_mm2: float, spacing: float) -> float:
    """Skin of one source: clusters are between the widest and a quarter of it."""
    return max(0.5 * spacing**2 * variance_mm2, resources.geometry.mean_texel_mm2)
