"""Judges sums of lobes at planning probes: how wrong they are, and what other probes may find."""

from __future__ import annotations

import numpy as np

from skinbake.diffuse.error import LEAST_SEEN, by_light, seen_by
from skinbake.numerics import Float

LUCK = 2.0  # standard deviations of the measured mean square


class Judge:
    """Errors at weighted probes, relative to the light that should leave: of all lights, or the worst one of them.

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
        square = by_light(want)
        # Lights that so many other probes will judge each by itself
        seen = seen_by(square, weight[:, None]) * (verifying / max(len(want), 1)) >= LEAST_SEEN
        self._own = np.flatnonzero(seen) if len(seen) > 1 else np.empty(0, np.int64)
        self._mean_square = self._moments(want)[0]
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
        return self._relative(second + LUCK * np.sqrt(fourth / self.verifying))

    def _moments(self, error: Float) -> tuple[Float, Float]:
        """Mean square and mean fourth power of all lights together and of those that are judged alone, (1 + K,)."""
        if not len(error):
            return np.zeros(1 + len(self._own)), np.zeros(1 + len(self._own))
        square = np.einsum("pc,pc->p", error, error)[:, None]
        if len(self._own):
            square = np.hstack([square, by_light(error)[:, self._own]])
        weighted = self.weight[:, None] * square
        return weighted.mean(axis=0), (weighted * square).mean(axis=0)

    def _relative(self, mean_square: Float) -> float:
        """Root of the largest share."""
        lit = self._mean_square > 0
        if (mean_square[~lit] > 0).any():
            return float("inf")
        return float(np.sqrt((mean_square[lit] / self._mean_square[lit]).max(initial=0.0)))
