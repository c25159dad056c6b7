"""Judges sums of lobes at planning probes: how wrong they are, and what other probes may find."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float

LUCK = 2.0  # standard deviations of the measured mean square


class Judge:
    """Errors at weighted probes, relative to the light that should leave.

    Parameters
    ----------
    want : ndarray of shape (P, 3 L)
        The light that should leave.
    weight : ndarray of shape (P,)
        Of the probes.
    verifying : int
        Number of the other probes that will judge the bake.
    peak : float
        Error, over the mean light, from which on a probe counts as far off.
    """

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
        """The same, as so many other probes may find it with bad luck."""
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
