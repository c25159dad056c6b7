"""Makes every lobe of a plan, in an order that holds little in memory at a time, and measures how wrong they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from skinbake.atlas import Tiles
from skinbake.diffuse.diffuse_map import MeasuredError
from skinbake.diffuse.error import measure_error, relative_rms, weighted_sum
from skinbake.diffuse.memoize import Memoizer
from skinbake.diffuse.methods import REFERENCE, LobeParameters, LobePlan
from skinbake.diffuse.probes import Probes, light_at_probes, read_at_probes
from skinbake.diffuse.resources import Resource
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.texture_space.blur import level_size
from skinbake.machine import return_freed
from skinbake.numerics import Float

T = TypeVar("T")


class MadeLobes(NamedTuple, Generic[T]):
    """Lobes in the order of their plans, and their errors at the probes.

    Attributes
    ----------
    lobes : list
        What `finish` has made of each.
    error : MeasuredError, optional
        Of the weighted sum; None without probes.
    by_lobe : list of MeasuredError or None
        Of each lobe alone, where it counts.
    worst : int, optional
        Number of the probe at which the sum is most wrong.
    blurs : float
        Rms at the probes of what the blur does, as a share of the light that leaves.
    """

    lobes: list[T]
    error: MeasuredError | None
    by_lobe: list[MeasuredError | None]
    worst: int | None = None
    blurs: float = 0.0


def make_lobes(
    memoizer: Memoizer,
    plans: Sequence[LobePlan],
    weights: SkinWeights,
    probes: Probes,
    precision: str,
    tell: Callable[[str], None],
    finish: Callable[[int, Tiles], T],
) -> MadeLobes[T]:
    """Every lobe; the error of their sum and of each, if there are probes.

    Parameters
    ----------
    memoizer : Memoizer
        Runs the methods.
    plans : sequence of LobePlan
    weights : SkinWeights
        Of the lobes in the sum.
    probes : Probes
        May be none.
    precision : "half" or "float"
        What the lobes will be written as.
    tell : callable
        Told in words what begins.
    finish : callable
        Takes the number of a lobe, and its pixels (L, h, w, 3) a tile, once they are measured: all lobes as floats
        would be more than all that they are made of.
    """
    # What lobes share is larger than they are: those that need most come first, and what none needs any more is let go
    needs = [plan.method.needs(memoizer.resources, plan.parameters) for plan in plans]
    # A lobe with a light of its own is measured where it is made: what follows from that light is dear
    own = {i for i, plan in enumerate(plans) if memoizer.light_of(plan.parameters.variance_mm2)[1] is not None}
    for i in own if len(probes) else ():
        needs[i] |= REFERENCE.needs(memoizer.resources, plans[i].parameters)
    order = sorted(range(len(plans)), key=lambda i: [resource not in needs[i] for resource in Resource])
    memoizer.release(set(Resource) - needs[order[0]] - {Resource.TEXELS})
    exact: dict[int, Float] = {}

    def measure_exactly(of: Iterable[int]) -> None:
        for i in of if len(probes) else ():
            exact[i] = memoizer.at_probes(REFERENCE, LobeParameters(plans[i].parameters.variance_mm2), probes)

    tell("measuring lobes exactly")
    measure_exactly(i for i in range(len(plans)) if i not in own)
    memoizer.resources.rest()
    made: dict[int, T] = {}
    unreduced: dict[int, Float] = {}
    read: dict[int, Float] = {}
    for place, i in enumerate(order):
        memoizer.release(set(Resource).difference(*(needs[later] for later in order[place:])))
        method, parameters = plans[i].method, plans[i].parameters
        tell(f"lobe {i}: {method.name}")
        lobe = memoizer.map(method, parameters)
        if i in own:
            measure_exactly([i])
        _check_size(method.name, lobe, memoizer.resources.source, parameters.level)
        if len(probes):
            tell(f"measuring lobe {i}")
            unreduced[i] = (
                memoizer.at_probes(method, parameters, probes) if method.continuous else read_at_probes(lobe, probes)
            )
            read[i] = read_at_probes(lobe, probes, precision == "half")
        memoizer.resources.rest()
        made[i] = finish(i, lobe)
        del lobe
        return_freed()
        memoizer.release_lobe(parameters.variance_mm2)

    lobes = [made[i] for i in range(len(plans))]
    if not len(probes):
        return MadeLobes(lobes, None, [None] * len(plans))
    found = [[values[i] for i in range(len(plans))] for values in (read, unreduced, exact)]
    weight_rgb = weights.at_probes(probes)
    stored, unreduced_sum, want = (weighted_sum(values, weight_rgb) for values in found)
    worst = int(np.abs(stored - want).max(axis=1).argmax())
    counts = weights.counts_at_probes(probes)
    by_lobe: list[MeasuredError | None] = [
        measure_error(*(values * counts if plan.parameters.variance_mm2 > 0 else values for values in each))
        for plan, each in zip(plans, zip(*found, strict=True), strict=True)
    ]
    arrived = light_at_probes(memoizer.resources.source, probes)
    blurs = relative_rms(weighted_sum([arrived] * len(plans), weight_rgb), want)
    return MadeLobes(lobes, measure_error(stored, unreduced_sum, want), by_lobe, worst, blurs)


def _check_size(name: str, made: Tiles, source: Tiles, level: int) -> None:
    """Hold a method to the size that the plan states.

    Parameters
    ----------
    name : str
        Of the method.
    made, source : Tiles
        The lobe, and the light at the full size.
    level : int
        The lobe is wanted at the full size halved this many times.

    Raises
    ------
    ValueError
        It made another size, or other tiles.
    """
    for tile, light in source.items():
        lights, height, width, channels = light.shape
        want = (lights, *level_size((height, width), level), channels)
        if tile not in made or made[tile].shape != want:
            got = made[tile].shape if tile in made else None
            raise ValueError(
                f"method {name}, tile {tile}: expected a lobe of shape {want}, got {got}; see coarsest_level"
            )
