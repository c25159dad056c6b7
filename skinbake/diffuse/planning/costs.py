"""What a lobe costs to make by each method, for `auto` to weigh.

Seconds of the two-core machine that this was tuned on. Only their ratios matter: nothing is timed in a bake, so a plan
is the same on every machine.
"""

from __future__ import annotations

import numpy as np

from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.blur import level_size

# Of a texel, and of a texel of each light where they multiply
_WRITE = 7e-8
_TEXTURE = 6.5e-9
_PREDICT = 5e-9
_SURFACE = 2.5e-8
_INTERPOLATE = 1.2e-8
_RISK = 2e-8  # that a lobe left to texture space alone fails at probes which no plan saw: a second plan
_PAIR = 1.6e-10  # of a target and a source
_SOURCE = 2.2e-8
_FURTHER = 0.4  # of what one light takes, for each one more that goes along
_SUMMED = (1.0, 0.12, 0.04)  # share of texels that is not interpolated, from the first size summed on
_SCATTERED = 2.5  # lanes to a texel that is summed, where its neighbours are not
_BESIDE = 0.02  # of the texels lie in the gutter, where a hybrid lobe sums all


def write_cost(resources: LobeResources, level: int) -> float:
    """Of storing any lobe."""
    return _WRITE * _texels(resources, level) * resources.lights


def risk_cost(resources: LobeResources) -> float:
    """Of a second plan, times its chance, for a lobe that texture space alone makes or that is left unblurred."""
    return _RISK * _texels(resources, 0) * _along(resources.lights)


def texture_cost(resources: LobeResources, level: int) -> float:
    """Of a blur in the texture."""
    return _TEXTURE * _texels(resources, level) * resources.lights


def hybrid_cost(
    resources: LobeResources, variance_mm2: float, level: int, spacing: float, share: float
) -> tuple[float, float]:
    """Of a hybrid lobe of which a share of the texels is summed; and the spacing of its sources that costs least.

    A few sums over single texels are sooner done than a lobe's clusters are found.
    """
    texels, lights = _texels(resources, level), resources.lights
    summed = (share + _BESIDE) * _SCATTERED * texels * lights
    cost, spacing = min(
        (
            _sources_cost(resources, variance_mm2, each) + summed * _sum_cost(resources, variance_mm2, level, each, 1),
            each,
        )
        for each in (0.0, spacing)
    )
    return texture_cost(resources, level) + _PREDICT * texels * _along(lights) + cost, spacing


def surface_cost(resources: LobeResources, variance_mm2: float, level: int, spacing: float) -> float:
    """Of surface sums, interpolated from smaller sizes as far as that is done."""
    cost, first = _sources_cost(resources, variance_mm2, spacing), level
    while resources.interpolates(variance_mm2, first):
        first += 1
    for finer, summed in zip(range(first, level - 1, -1), (*_SUMMED, *(_SUMMED[-1],) * first), strict=False):
        each = summed * _sum_cost(resources, variance_mm2, finer, spacing, resources.lights)
        cost += _texels(resources, finer) * (each + _INTERPOLATE * resources.lights)
    return cost


def _texels(resources: LobeResources, level: int) -> int:
    height, width = level_size(resources.size, level)
    return height * width * len(resources.atlas)


def _along(lights: int) -> float:
    """What lights that go along with one another take, in units of one alone."""
    return 1 + _FURTHER * (lights - 1)


def _sum_cost(resources: LobeResources, variance_mm2: float, level: int, spacing: float, lights: int) -> float:
    """Of one texel."""
    around = (resources.cut + 1) ** 2 * variance_mm2 + 4 * resources.surface.mean_texel_mm2 * 4**level
    pairs = np.pi * around / _source_mm2(resources, variance_mm2, spacing)
    return float(_SURFACE + _PAIR * pairs * _along(lights))


def _sources_cost(resources: LobeResources, variance_mm2: float, spacing: float) -> float:
    """Of a lobe's own clusters; single texels are there for the probes already."""
    if resources.sums_texels("surface", variance_mm2, spacing):
        return 0.0
    skin = _texels(resources, 0) * resources.surface.mean_texel_mm2
    return _SOURCE * skin / _source_mm2(resources, variance_mm2, spacing)


def _source_mm2(resources: LobeResources, variance_mm2: float, spacing: float) -> float:
    """Skin of one source: clusters are between the widest and a quarter of it."""
    return max(0.5 * spacing**2 * variance_mm2, resources.surface.mean_texel_mm2)
