"""How many rays each texel sends to look for skin: more where it is large and where what it sees is mixed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

NOISE_FALL = 0.85  # exponent by which rays on a lattice lose their noise, on a head and about a hill
FEWEST, MOST = 4, 1024
_SAMPLE = 4096  # texels that say how many rays all of them need
_HALVINGS = 60


def ray_counts(area_mm2: Float, seen: Float, shared: Float, rays: float) -> NDArray[np.int64]:
    """Rays of each texel, powers of 2, that leave as little noise of all light from skin as `rays` from each, (n,).

    The fewest in all: a texel's rays are doubled as long as that takes off more of the sum of squares, a ray, than
    doubling another's (theory.md 9.7).

    Parameters
    ----------
    area_mm2 : ndarray of shape (n,)
    seen : ndarray of shape (n,)
        About which share of the view is skin, between 0 and 1.
    shared : ndarray of shape (n,)
        Times its own that its light is worth by the rays of its neighbours, 1 or more.
    rays : float
    """
    some = slice(None, None, max(1, len(area_mm2) // _SAMPLE))
    allowed = float((area_mm2[some] * _noise(seen[some], np.full_like(seen[some], rays))).sum())
    steps = [float(step) for step in 2.0 ** np.arange(np.log2(FEWEST), np.log2(MOST))]
    # What is gained by doubling, a ray; the threshold by bisection of its logarithm
    gains = [_gain(area_mm2[some], seen[some], shared[some], step) for step in steps]
    low, high = -80.0, 20.0
    for _ in range(_HALVINGS):
        least = 2 ** (0.5 * (low + high))
        count = FEWEST * 2.0 ** np.sum([gain >= least for gain in gains], axis=0)
        left = float((area_mm2[some] * _noise(seen[some], count * shared[some])).sum())
        low, high = (low, np.log2(least)) if left > allowed else (np.log2(least), high)
    found = np.full(len(area_mm2), FEWEST, np.int64)
    for step in steps:
        found[_gain(area_mm2, seen, shared, step) >= 2**low] *= 2
    return found


def _noise(seen: Float, rays: Float) -> Float:
    """Squared noise of the share of the view that is skin: of rays that meet none or few, as if by chance; then less.

    Parameters
    ----------
    seen : ndarray of shape (n,)
    rays : ndarray of shape (n,)
    """
    square = seen * (1 - seen)
    found: Float = square / rays * (1 + square * rays) ** (1 - 2 * NOISE_FALL)
    return found


def _gain(area_mm2: Float, seen: Float, shared: Float, rays: float) -> Float:
    """Squared noise that doubling the rays takes off, a ray, (n,)."""
    found: Float = area_mm2 * (_noise(seen, rays * shared) - _noise(seen, 2 * rays * shared)) / rays
    return found
