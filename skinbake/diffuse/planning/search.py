"""Searches the cheapest candidates, one for each lobe, whose sum meets a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters
from skinbake.diffuse.planning.judge import Judge
from skinbake.numerics import Float

PEAK_SHARE = 0.003  # of the skin may be further off


@dataclass(frozen=True)
class Candidate:
    """One way to make a lobe.

    Attributes
    ----------
    method : DiffusionMethod
    parameters : LobeParameters
    cost : float
        Estimated, in the unit of `methods.costs`.
    read : ndarray of shape (P, 3 L)
        What would be read at the planning probes.
    error : float
        Of this lobe alone, relative rms.
    tried : bool
        False: in `read` surface sums are taken for exact, for now.
    """

    method: DiffusionMethod
    parameters: LobeParameters
    cost: float
    read: Float
    error: float
    tried: bool = True


def search(options: Sequence[Sequence[Candidate]], weight_rgb: Float, judge: Judge, limit: float) -> list[int]:
    """The candidate of each lobe, as an index into its options.

    Parameters
    ----------
    options : sequence of sequences of Candidate
        By lobe.
    weight_rgb : ndarray of shape (N, 3) or (N, P, 3)
        Of the lobes in the sum.
    judge : Judge
    limit : float
        Relative rms that the sum is to keep, with bad luck.
    """
    lights = judge.want.shape[1] // 3
    weights = [np.tile(w, lights) for w in weight_rgb]
    useful = [_undominated(lobe) for lobe in options]
    chosen = [undominated[-1] for undominated in useful]
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


def _undominated(lobe: Sequence[Candidate]) -> list[int]:
    """Candidates that none is both cheaper and less wrong than; the least wrong comes last."""
    found: list[int] = []
    for k in sorted(range(len(lobe)), key=lambda k: (lobe[k].cost, lobe[k].error)):
        if not found or lobe[k].error < lobe[found[-1]].error:
            found.append(k)
    return found
