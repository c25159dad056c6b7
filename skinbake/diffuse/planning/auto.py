"""Method `auto`: the cheapest method and stored size for each lobe that together meet the tolerance, as measured.

Candidates are tried at planning probes only (a surface sum needs no more than the texels that a reader of the probe
would touch), against the exact integral there. Half of these probes are drawn where the light changes, for that is
where errors are. Errors of lobes are added as they are, with their signs and weights, so a lobe of little weight may be
rough. Surface sums cost the most to try and are the most exact: they are taken for exact until a search has chosen
them, are then tried, and the search done again.

A search starts from the most accurate candidate of each lobe and takes, one after another, the exchange that saves most
for the error it adds, while the verifying probes can be expected to find the sum within the tolerance: its mean square
error plus two standard deviations of what that many probes would measure. What no probe has hit is not in these:
texture space alone is wrong in few places, but there by more than the light itself, so it pays a premium for that.

A root mean square forgives what an eye does not: a line along a seam, far off but thin. So no exchange may leave more
than three thousandths of the skin further off than ten tolerances, or than a tenth of the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from skinbake.diffuse.draw_probes import PLAN, draw_probes
from skinbake.diffuse.error import weighted_sum
from skinbake.diffuse.memoize import LobeLight, Memoizer
from skinbake.diffuse.methods import METHODS, REFERENCE, LobeParameters, LobePlan
from skinbake.diffuse.methods.costs import risk_cost, write_cost
from skinbake.diffuse.methods.method import Trial
from skinbake.diffuse.planning.judge import Judge
from skinbake.diffuse.planning.rules import IDENTITY_TEXELS2, cluster_spacing, stored_level
from skinbake.diffuse.planning.search import PEAK_SHARE, Candidate, search
from skinbake.diffuse.probes import Probes, joined_probes
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.surface_space.clusters import contrast
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.decision import Decision

PROBES = 1000
VERIFYING = 2000  # probes that a plan allows for where no probes will judge it
MARGIN = 0.9  # of the tolerance, for what the planning probes did not see
MAX_LEVELS = 4
SHOWN_TEXELS2 = 2.5  # a size is halved while the variance of the lobe there is this: 0.8 of a stored texel are left
PEAK = 10.0  # tolerances of the mean
SEEN = 0.1  # of the mean: no less than this counts as a peak


def plan_auto(
    memoizer: Memoizer,
    gaussians: GaussianSum,
    weights: SkinWeights,
    seed: int,
    precision: str,
    also: Probes | None = None,
) -> tuple[tuple[LobePlan, ...], list[Decision]]:
    """Choose, measure and explain.

    Parameters
    ----------
    memoizer : Memoizer
        Runs the methods.
    gaussians : GaussianSum
    weights : SkinWeights
        What each Gaussian counts in the sum.
    seed : int
        Of the planning probes.
    precision : "half" or "float"
        What the lobes will be written as.
    also : Probes, optional
        Probes at which an earlier plan failed: they are part of this one's, and must not judge it.

    Returns
    -------
    plans : tuple of LobePlan
    decisions : list of Decision
        One a lobe, and one for the sum.
    """
    resources = memoizer.resources
    where = {tile: contrast(lit.points, lit.pyramid) for tile, lit in resources.lit.items()}
    probes = draw_probes(resources.geometry, PROBES, seed, PLAN, where)
    if also is not None:
        probes = joined_probes(probes, also)

    # What each lobe should be at the probes, and what each candidate makes of it: one lobe after another, as each may
    # have a light of its own, of which all that it is made of follows
    exact, options, seen = list[Float](), list[list[Candidate]](), set[LobeLight]()
    alone, counts = list[Callable[[Float], float]](), weights.counts_at_probes(probes)
    for variance in gaussians.variance_mm2.tolist():
        exact.append(memoizer.at_probes(REFERENCE, LobeParameters(variance), probes))
        of, light = memoizer.of_lobe(variance), memoizer.light_of(variance)
        of.rest()
        alone.append(partial(_error_alone, probes.weight, exact[-1], counts if variance > 0 else np.ones((1, 1))))
        trial = _trial(of, variance, probes, exact[-1], precision == "half")
        options.append(_candidates(trial, alone[-1], light in seen))
        seen.add(light)
        del of  # the next lobe's needs room

    # Search; try the sums that were chosen; search again, until all that is chosen has been tried
    weight_rgb = weights.at_probes(probes)
    want = weighted_sum(exact, weight_rgb)
    tolerance = resources.spec.tolerance
    judge = Judge(want, probes.weight, resources.spec.probe_count or VERIFYING, max(PEAK * tolerance, SEEN))
    limit = MARGIN * tolerance
    chosen = search(options, weight_rgb, judge, limit)
    while any(not lobe[k].tried for lobe, k in zip(options, chosen, strict=True)):
        for i, (lobe, k) in enumerate(zip(options, chosen, strict=True)):
            if not lobe[k].tried:
                lobe[k] = _tried(memoizer, probes, alone[i], lobe[k])
        chosen = search(options, weight_rgb, judge, limit)

    taken = [lobe[k] for lobe, k in zip(options, chosen, strict=True)]
    plans = tuple(_explained(options[i], i, taken, weight_rgb, judge) for i in range(len(taken)))
    return plans, _decisions(plans, weight_rgb, judge, limit, [lobe.read for lobe in taken])


def _error_alone(weight: Float, exact: Float, counts: Float, read: Float) -> float:
    """How wrong a lobe is, a share of itself, where it counts: rms over the probes.

    Parameters
    ----------
    weight : ndarray of shape (P,)
        Of the probes.
    exact, read : ndarrays of shape (P, 3 L)
        The lobe at the probes, as it should be and as it is.
    counts : ndarray of shape (P, 1) or (1, 1)
        Of `SkinWeights.counts_at_probes`.
    """
    return Judge(exact * counts, weight, len(exact)).rms((read - exact) * counts)


def _trial(resources: LobeResources, variance: float, probes: Probes, exact: Float, half: bool) -> Trial:
    """What methods are told when they are asked for candidates.

    Parameters
    ----------
    resources : LobeResources
        What the lobe is made of.
    variance : float
        Of the lobe, mm^2.
    probes : Probes
    exact : ndarray of shape (P, 3 L)
        The lobe at the probes.
    half : bool
        Whether files will hold binary16.
    """
    geometry, tolerance = resources.geometry, resources.spec.tolerance
    texels2 = geometry.variance_texels2(variance)
    widest = min(widest_level(texels2, SHOWN_TEXELS2), MAX_LEVELS)
    finest = max(each.bilinear_error for each in METHODS.values())
    # Finer sizes than by rule no method needs
    first = stored_level(finest, variance, geometry.mean_texel_mm2, tolerance, widest)
    levels = range(first, widest + 1) if min(texels2) >= IDENTITY_TEXELS2 else range(0)
    return Trial(resources, variance, levels, cluster_spacing(tolerance), probes, exact, half)


def _candidates(trial: Trial, alone: Callable[[Float], float], again: bool) -> list[Candidate]:
    """What all methods propose, from the full size down.

    Parameters
    ----------
    trial : Trial
    alone : callable
        How wrong the lobe is, by what is read at the probes.
    again : bool
        Whether a narrower lobe is of the same light: unblurred both are one image, which is written once.
    """
    resources, found = trial.resources, []
    for each in METHODS.values():
        for parameters, cost, read, tried in each.candidates(trial):
            if each.blurs or not again:
                cost += write_cost(resources, parameters.level)
            if each.misses_unseen:
                cost += risk_cost(resources)
            found.append(Candidate(each, parameters, cost, read, alone(read), tried))
    resources.rest()
    return sorted(found, key=lambda candidate: candidate.parameters.level)


def _tried(memoizer: Memoizer, probes: Probes, alone: Callable[[Float], float], lobe: Candidate) -> Candidate:
    """A candidate with what its sums read at the probes."""
    read = memoizer.read_stored(lobe.method, lobe.parameters, probes)
    memoizer.resources.rest()
    return replace(lobe, read=read, error=alone(read), tried=True)


def _explained(
    options: Sequence[Candidate], index: int, taken: Sequence[Candidate], weight_rgb: Float, judge: Judge
) -> LobePlan:
    """What a lobe costs in error, and what the next cheaper choice would have made of the sum."""
    mine = taken[index]
    why = f"alone wrong by {mine.error:.3%}"
    cheaper = [c for c in options if c.cost < mine.cost and c.tried]
    if cheaper:
        other = max(cheaper, key=lambda c: c.cost)
        reads = [lobe.read for lobe in (*taken[:index], other, *taken[index + 1 :])]
        with_other = judge.rms(weighted_sum(reads, weight_rgb) - judge.want)
        size = f"size / {2**other.parameters.level}"
        why += f"; {other.method.name} at {size} would make the sum wrong by {with_other:.3%}"
    if mine.method.blurs:
        unblurred = next(c for c in options if not c.method.blurs)
        why += f"; left unblurred the lobe is wrong by {unblurred.error:.3%}"
    return LobePlan(mine.method, mine.parameters, why)


def _decisions(
    plans: Sequence[LobePlan], weight_rgb: Float, judge: Judge, limit: float, reads: Sequence[Float]
) -> list[Decision]:
    """One a lobe, and one for the sum."""
    error = weighted_sum(reads, weight_rgb) - judge.want
    expected, likely = judge.rms(error), judge.unlucky_rms(error)
    decisions = [
        Decision(
            f"lobe_{i}",
            plan.method.blurs,
            f"v = {plan.parameters.variance_mm2:.4g} mm^2: {plan.method.name} at size / {2**plan.parameters.level}; "
            f"{plan.why}",
        )
        for i, plan in enumerate(plans)
    ]
    decisions.append(
        Decision(
            "lobes together",
            likely <= limit,
            f"rms {expected:.3%}, at most {likely:.3%} with bad luck, at {len(judge.want)} planning probes, wanted "
            f"{limit:.3%}; {judge.peaks(error):.2%} of the skin off by more than {judge.peak:.0%} of the mean, wanted "
            f"{PEAK_SHARE:.2%}",
        )
    )
    return decisions
