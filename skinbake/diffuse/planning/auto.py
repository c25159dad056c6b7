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

from dataclasses import dataclass, replace

import numpy as np

from skinbake.diffuse.diffuse_map import Decision
from skinbake.diffuse.error import weighted_sum
from skinbake.diffuse.evaluator import LobeEvaluator
from skinbake.diffuse.planning.costs import hybrid_cost, risk_cost, surface_cost, texture_cost, write_cost
from skinbake.diffuse.planning.lobe_plan import IDENTITY_TEXELS2, LobePlan, cluster_spacing
from skinbake.diffuse.probes import PLAN, Probes, draw_probes, joined_probes
from skinbake.diffuse.surface_space.clusters import contrast
from skinbake.diffuse.texture_space.blur import widest_level
from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum

PROBES = 1000
VERIFYING = 2000  # probes, for whose luck a plan allows that no probes will judge
MARGIN = 0.9  # of the tolerance, for what the planning probes did not see
LUCK = 2.0  # standard deviations of the measured mean square
MAX_LEVELS = 4
PEAK = 10.0  # tolerances of the mean
SEEN = 0.1  # of the mean: no less than this counts as a peak
PEAK_SHARE = 0.003  # of the skin may be further off
LOOSE = (2.0, 8.0, 32.0)  # tolerances that the blur of a hybrid lobe may be off by, as predicted


@dataclass(frozen=True)
class Candidate:
    """One way to make a lobe.

    Attributes
    ----------
    cost : float
        Estimated, arbitrary unit.
    read : ndarray of shape (P, C)
        What would be read at the planning probes.
    error : float
        Of this lobe alone, relative rms.
    tried : bool
        False: in `read` sums are the exact integral, for now.
    """

    method: str
    level: int
    spacing: float
    threshold: float
    cost: float
    read: Float
    error: float
    tried: bool = True


def plan_auto(
    diffuser: LobeEvaluator, gaussians: GaussianSum, seed: int, precision: str, also: Probes | None = None
) -> tuple[tuple[LobePlan, ...], list[Decision]]:
    """Choose, measure and explain.

    Parameters
    ----------
    also : Probes, optional
        Probes at which an earlier plan failed: they are part of this one's, and must not judge it.

    Returns
    -------
    plans : tuple of LobePlan
    lines : list of Decision
        A line a lobe, and one for the sum.
    """
    points = [p for p, _, _ in diffuser.surface.tiles]
    where = [contrast(points, pyramid) for points, _, pyramid in diffuser.surface.tiles]
    probes = draw_probes(diffuser.atlas, diffuser.mesh, points, PROBES, seed, PLAN, where)
    if also is not None:
        probes = joined_probes(probes, also)
    exact = [diffuser.reference(float(v), probes) for v in gaussians.variance_mm2]
    options = [
        _candidates(diffuser, float(v), probes, want, precision == "half")
        for v, want in zip(gaussians.variance_mm2, exact, strict=True)
    ]
    want = weighted_sum(exact, gaussians.weight_rgb)
    tolerance = diffuser.spec.tolerance
    judge = _Judge(want, probes.weight, diffuser.spec.probes or VERIFYING, max(PEAK * tolerance, SEEN))
    limit = MARGIN * tolerance
    chosen = _search(options, gaussians.weight_rgb, judge, limit)
    while any(not lobe[k].tried for lobe, k in zip(options, chosen, strict=True)):
        for i, (lobe, k) in enumerate(zip(options, chosen, strict=True)):
            if not lobe[k].tried:
                lobe[k] = _tried(diffuser, float(gaussians.variance_mm2[i]), probes, exact[i], lobe[k])
        chosen = _search(options, gaussians.weight_rgb, judge, limit)
    reads = [lobe[k].read for lobe, k in zip(options, chosen, strict=True)]
    error = weighted_sum(reads, gaussians.weight_rgb) - want
    expected, likely = judge.rms(error), judge.unlucky_rms(error)
    plans, lines = [], []
    for i, (lobe, k) in enumerate(zip(options, chosen, strict=True)):
        plan = _explain(lobe, lobe[k], i, reads, gaussians, judge)
        plans.append(plan)
        lines.append(
            Decision(
                f"lobe_{i}",
                plan.method != "identity",
                f"v = {gaussians.variance_mm2[i]:.4g} mm^2: {plan.method} at size / {2**plan.level}; {plan.why}",
            )
        )
    lines.append(
        Decision(
            "lobes together",
            likely <= limit,
            f"rms {expected:.3%}, at most {likely:.3%} with bad luck, at {len(probes)} planning probes, wanted "
            f"{limit:.3%}; {judge.peaks(error):.2%} of the skin off by more than {judge.peak:.0%} of the mean, wanted "
            f"{PEAK_SHARE:.2%}",
        )
    )
    return tuple(plans), lines


def _candidates(diffuser: LobeEvaluator, variance: float, probes: Probes, exact: Float, half: bool) -> list[Candidate]:
    """The identity first; surface sums untried."""
    judge = _Judge(exact, probes.weight, len(probes))
    spacing = cluster_spacing(diffuser.spec.tolerance)
    thresholds = [loose * diffuser.spec.tolerance for loose in LOOSE]
    found: list[Candidate] = []

    def add(method: str, level: int, spacing: float, threshold: float, cost: float, read: Float) -> None:
        cost += write_cost(diffuser, level)
        tried = method in ("identity", "texture")
        if tried:
            cost += risk_cost(diffuser)
        found.append(Candidate(method, level, spacing, threshold, cost, read, judge.rms(read - exact), tried))

    add("identity", 0, 0.0, 0.0, 0.0, diffuser.read(diffuser.source, probes, half))
    if min(diffuser.variance_texels2(variance)) < IDENTITY_TEXELS2:
        return found
    coarsest = min(widest_level(diffuser.variance_texels2(variance)), MAX_LEVELS)
    for level in range(coarsest + 1):
        texture, shares = diffuser.hybrid_blur(variance, level, thresholds, probes)
        add("texture", level, 0.0, 0.0, texture_cost(diffuser, level), texture)
        for threshold, share in zip(thresholds, shares, strict=True):
            summed = float(np.mean(probes.weight[:, None] * (share > 0)))
            cost, of_sums = hybrid_cost(diffuser, variance, level, spacing, summed)
            read = texture + np.repeat(share, 3, axis=1) * (exact - texture)
            add("hybrid", level, of_sums, threshold, cost, read)
        add("surface", level, spacing, 0.0, surface_cost(diffuser, variance, level, spacing), exact)
    return found


def _tried(diffuser: LobeEvaluator, variance: float, probes: Probes, exact: Float, lobe: Candidate) -> Candidate:
    """A candidate with what its sums read at the probes."""
    if lobe.method == "hybrid":
        read = diffuser.read_hybrid(variance, lobe.level, lobe.spacing, lobe.threshold, probes)
    else:
        read = diffuser.read_surface(variance, lobe.level, lobe.spacing, probes)
    return replace(lobe, read=read, error=_Judge(exact, probes.weight, len(probes)).rms(read - exact), tried=True)


class _Judge:
    """Errors at weighted probes, relative to the light that should leave."""

    def __init__(self, want: Float, weight: Float, verifying: int, peak: float = 1.0) -> None:
        self.want, self.weight, self.verifying, self.peak = want, weight, verifying, peak
        self.mean_square = float(np.mean(weight * (want * want).sum(axis=1))) if len(want) else 0.0
        self.mean = float(np.mean(weight * want.mean(axis=1))) if len(want) else 0.0

    def peaks(self, error: Float) -> float:
        """Share of the skin that is off by more than `peak` of the mean light that should leave."""
        if not len(error):
            return 0.0
        far = np.abs(error).max(axis=1) > self.peak * self.mean
        return float(self.weight[far].sum() / self.weight.sum())

    def rms(self, error: Float) -> float:
        """Relative root mean square over the skin."""
        return self._relative(self._moments(error)[0])

    def unlucky_rms(self, error: Float) -> float:
        """The same as that many other probes may find it."""
        second, fourth = self._moments(error)
        return self._relative(second + LUCK * float(np.sqrt(fourth / self.verifying)))

    def _moments(self, error: Float) -> tuple[float, float]:
        square = np.einsum("pc,pc->p", error, error)
        if not len(square):
            return 0.0, 0.0
        return float(np.mean(self.weight * square)), float(np.mean(self.weight * square * square))

    def _relative(self, mean_square: float) -> float:
        if self.mean_square > 0:
            return float(np.sqrt(mean_square / self.mean_square))
        return 0.0 if mean_square == 0 else float("inf")


def _search(options: list[list[Candidate]], weight_rgb: Float, judge: _Judge, limit: float) -> list[int]:
    """Indices into `options`."""
    lights = judge.want.shape[1] // 3
    weights = [np.tile(w, lights) for w in weight_rgb]
    useful = [_undominated(lobe) for lobe in options]
    chosen = [of_lobe[-1] for of_lobe in useful]
    total = sum(lobe[k].read * w for lobe, k, w in zip(options, chosen, weights, strict=True)) - judge.want
    while True:
        here, peaks = judge.unlucky_rms(total), max(judge.peaks(total), PEAK_SHARE)
        best: tuple[float, int, int, Float] | None = None
        for i, lobe in enumerate(options):
            for k in useful[i]:
                candidate = lobe[k]
                saved = lobe[chosen[i]].cost - candidate.cost
                if saved <= 0:
                    continue
                changed = total + (candidate.read - lobe[chosen[i]].read) * weights[i]
                error = judge.unlucky_rms(changed)
                gain = saved / max(error**2 - here**2, 1e-12)
                if error <= limit and (best is None or gain > best[0]) and judge.peaks(changed) <= peaks:
                    best = (gain, i, k, changed)
        if best is None:
            return chosen
        _, i, k, total = best
        chosen[i] = k


def _undominated(lobe: list[Candidate]) -> list[int]:
    """Candidates that none is both cheaper and less wrong than; the least wrong comes last."""
    found: list[int] = []
    for k in sorted(range(len(lobe)), key=lambda k: (lobe[k].cost, lobe[k].error)):
        if not found or lobe[k].error < lobe[found[-1]].error:
            found.append(k)
    return found


def _explain(
    lobe: list[Candidate],
    taken: Candidate,
    index: int,
    reads: list[Float],
    gaussians: GaussianSum,
    judge: _Judge,
) -> LobePlan:
    """What the lobe costs in error, and what the next cheaper choice would have made of the sum."""
    why = f"alone wrong by {taken.error:.3%}"
    cheaper = [c for c in lobe if c.cost < taken.cost and c.tried]
    if cheaper:
        other = max(cheaper, key=lambda c: c.cost)
        others = [*reads[:index], other.read, *reads[index + 1 :]]
        with_other = judge.rms(weighted_sum(others, gaussians.weight_rgb) - judge.want)
        why += f"; {other.method} at size / {2**other.level} would make the sum wrong by {with_other:.3%}"
    if taken.method != "identity":
        why += f"; left unblurred the lobe is wrong by {lobe[0].error:.3%}"
    return LobePlan(taken.method, taken.level, taken.spacing, taken.threshold, why)
