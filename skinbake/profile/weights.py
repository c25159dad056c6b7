"""The linear half of a fit: weights of given columns, non-negative or signed, with a given sum or free."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float


def best_weights(columns: Float, wanted: Float, total: float | None = None, signed: bool = False) -> Float:
    """Weights w that minimise |columns w - wanted|; theory.md 4.3.

    Parameters
    ----------
    columns : ndarray of shape (K, K) or (M, K)
    wanted : ndarray of shape (K,) or (M,)
    total : float, optional
        Exact sum of the weights.
    signed : bool
        Allow negative weights.

    Returns
    -------
    ndarray of shape (K,)
        Weights; those at the bound are exactly 0.

    References
    ----------
    [Lawson1974]
    """
    count = columns.shape[1]
    free = np.ones(count, dtype=bool)
    weights = _solve(columns, wanted, total, free)
    if signed or (weights >= 0).all():
        return weights

    # Active set, one column in or out at a time; starts from the best single column and never leaves the feasible set
    if total is None:
        free[:] = False
        weights = np.zeros(count)
    else:
        misfit = [np.linalg.norm(columns[:, k] * total - wanted) for k in range(count)]
        free = np.arange(count) == int(np.argmin(misfit))
        weights = np.where(free, total, 0.0)
    for _ in range(8 * count):
        gain = columns.T @ (wanted - columns @ weights)
        if total is not None:
            gain -= gain[free].mean()
        gain[free] = -np.inf
        entering = int(np.argmax(gain))
        if gain[entering] <= 1e-13 * np.linalg.norm(columns[:, entering]) * np.linalg.norm(wanted):
            break
        free[entering] = True
        trial = _solve(columns, wanted, total, free)
        while (trial[free] < 0).any():
            falling = free & (trial < 0)
            share = np.where(falling, weights / np.where(falling, weights - trial, 1), np.inf)
            leaving = int(np.argmin(share))
            weights = weights + min(share[leaving], 1.0) * (trial - weights)
            free[leaving] = False
            weights[~free] = 0
            trial = _solve(columns, wanted, total, free)
        weights = trial
    return weights


def _solve(columns: Float, wanted: Float, total: float | None, free: np.ndarray) -> Float:
    """Least squares for the free columns, the others 0, with a given sum if there is one."""
    weights = np.zeros(columns.shape[1])
    part = columns[:, free]
    if total is None:
        weights[free] = np.linalg.lstsq(part, wanted, rcond=None)[0]
        return weights
    # Even shares meet the sum; the rest moves in the space of zero sum
    count = part.shape[1]
    even = np.full(count, total / count)
    basis = zero_sum_basis(count)
    weights[free] = (
        even + basis @ np.linalg.lstsq(part @ basis, wanted - part @ even, rcond=None)[0] if count > 1 else even
    )
    return weights


def zero_sum_basis(count: int) -> Float:
    """Orthonormal columns spanning the vectors of length `count` that sum to 0, shape (count, count - 1)."""
    basis = np.zeros((count, count - 1))
    for k in range(1, count):
        basis[:k, k - 1] = 1
        basis[k, k - 1] = -k
        basis[:, k - 1] /= np.sqrt(k * (k + 1))
    return basis
