"""Variances by variable projection: for given variances the best weights are known, so only ln v is searched."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fit_nodes import FitNodes
from skinbake.profile.starts import dense_fit, merged
from skinbake.profile.weights import best_weights, zero_sum_basis

# Consecutive variances stay this far apart: closer ones make the scaled Gram matrix singular, theory.md 4.4
MIN_RATIO = 2.0
MIN_RATIO_SIGNED = 1.25
SHARE_RANGE = (1e-4, 0.99)  # shares of the light under a window exp(-r^2 / 2v) that bound the variances
# Shares of the light between which the starting variances are spread geometrically
STARTS = ((0.02, 0.98), (0.05, 0.9), (0.2, 0.97), (0.005, 0.99), (0.1, 0.7), (0.002, 0.8))
SHORT_LOOK = 12  # evaluations
FINALISTS = 2
WALL = 10.0  # residual for each e-fold beyond the range, against fit residuals well below 1


@dataclass(frozen=True)
class Projection:
    """Variances, their best weights, and the relative error (theory.md 4.2) of each channel.

    Attributes
    ----------
    variance_mm2 : ndarray of shape (K,)
    weight : ndarray of shape (K, C)
    error : ndarray of shape (C,)
    """

    variance_mm2: Float  # (K,)
    weight: Float  # (K, C)
    error: Float  # (C,)


class Fitter:
    """Fits any number of Gaussians to the same nodes.

    Parameters
    ----------
    nodes : FitNodes
    exact_energy : bool
        Weights of a channel sum to the model's total.
    signed : bool
        Weights may be negative.

    Raises
    ------
    ValueError
        If the profile is not finite, or dark in every channel.

    References
    ----------
    [Golub1973], [dEon2007]
    """

    def __init__(self, nodes: FitNodes, exact_energy: bool = True, signed: bool = False) -> None:
        if not (np.isfinite(nodes.target).all() and np.isfinite(nodes.total).all()):
            raise ValueError("profile: expected finite values to fit, got NaN or infinity")
        self.nodes = nodes
        self.exact_energy = exact_energy
        self.signed = signed
        wanted = nodes.target * nodes.root_weight[:, None]
        self.norm = np.linalg.norm(wanted, axis=0)
        self.lit = (self.norm > 0) & (nodes.total > 0)
        if not self.lit.any():
            raise ValueError("profile: reflects no light in any channel, there is nothing to fit")
        # A dark channel keeps zero weights; the others count alike
        self.wanted = wanted / np.where(self.lit, self.norm, 1)
        self.min_log_ratio = np.log(MIN_RATIO_SIGNED if signed else MIN_RATIO)
        self.log_range = self._log_variance_at(SHARE_RANGE[0])[0], self._log_variance_at(SHARE_RANGE[1])[1]
        self._last: tuple[Float, tuple[Float, Float, Float]] | None = None

    def fit(self, count: int, starts: Iterable[Float] = ()) -> Projection:
        """Best `count` Gaussians found from several starting points, and from `starts` (each of `count` variances).

        Raises
        ------
        ValueError
            If `count` is below 1.
        """
        return self.project(best_variances([self], count, [*starts, *self._starts(count)]))

    def project(self, variance_mm2: Float) -> Projection:
        """Best weights for variances of shape (K,), mm^2."""
        columns, _, weight = self._weights(np.log(variance_mm2))
        error = np.linalg.norm(columns @ weight - self.wanted, axis=0)
        return Projection(variance_mm2, weight * np.where(self.lit, self.norm, 0), np.where(self.lit, error, 0))

    def _weights(self, log_v: Float) -> tuple[Float, Float, Float]:
        """Weighted columns, their slopes by ln v, and the best weights; kept, since the Jacobian is asked for after
        its residual.
        """
        if self._last is None or not np.array_equal(self._last[0], log_v):
            self._last = log_v.copy(), self._best(log_v)
        return self._last[1]

    def _best(self, log_v: Float) -> tuple[Float, Float, Float]:
        """Weighted columns (M, K), their slopes by ln v (M, K), and the best weights (K, C)."""
        value, slope = self.nodes.basis(np.exp(log_v))
        columns = value * self.nodes.root_weight[:, None]
        slope = slope * self.nodes.root_weight[:, None]
        # The problem in as many rows as there are columns
        q, r = np.linalg.qr(columns)
        reduced = q.T @ self.wanted
        weight = np.zeros(reduced.shape)
        for c in np.flatnonzero(self.lit):
            total = self.nodes.total[c] / self.norm[c] if self.exact_energy else None
            weight[:, c] = best_weights(r, reduced[:, c], total, self.signed)
        return columns, slope, weight

    def _residual(self, log_v: Float, widest: float) -> Float:
        """Misfit of every channel in one row, and last a wall that keeps the widest variance in range: that of the
        widest of the profiles which share it, or a narrow one would cut the others' tails off.
        """
        columns, _, weight = self._weights(log_v)
        beyond = max(0.0, log_v[-1] - widest)
        return np.append((columns @ weight - self.wanted).T.ravel(), WALL * beyond)

    def _jacobian(self, log_v: Float, widest: float) -> Float:
        """Derivative of the residual by ln v, with the weights' own response projected out (Kaufman's form)."""
        columns, slope, weight = self._weights(log_v)
        blocks = []
        for c in range(weight.shape[1]):
            block = slope * weight[:, c]
            free = weight[:, c] != 0
            movable = columns[:, free]
            if self.exact_energy and free.any():
                movable = movable @ zero_sum_basis(int(free.sum()))
            if movable.shape[1]:
                q, _ = np.linalg.qr(movable)
                block = block - q @ (q.T @ block)
            blocks.append(block)
        wall = np.zeros((1, len(log_v)))
        wall[0, -1] = WALL * (log_v[-1] > widest)
        return np.concatenate([*blocks, wall])

    @cached_property
    def _dense(self) -> tuple[Float, list[Float]]:
        """Grid of ln v and importances, as `dense_fit`."""
        return dense_fit(self.nodes, self.wanted, self.log_range)

    def _log_variance_at(self, share: float) -> tuple[float, float]:
        """Value of ln v whose window holds `share` of the light: the least and the greatest over the lit channels."""
        log_v, shares = self._window
        at = [np.interp(share, shares[:, c], log_v) for c in np.flatnonzero(self.lit)]
        return float(min(at)), float(max(at))

    @cached_property
    def _window(self) -> tuple[Float, Float]:
        """Grid of ln v, shape (J,), and the shares of light under its windows, shape (J, C)."""
        log_v = np.linspace(np.log(1e-14), np.log(1e18), 1200)
        shares = np.maximum.accumulate(self.nodes.window_share(np.exp(log_v)), axis=0)
        return log_v, shares / shares[-1].clip(1e-300)

    def _starts(self, count: int) -> list[Float]:
        """Starting variances, (count,) each: from the dense fit, and spread geometrically over the light.

        Raises
        ------
        ValueError
            If `count` is below 1.
        """
        if count < 1:
            raise ValueError(f"gaussians: expected at least 1, got {count}")
        log_v, importances = self._dense
        starts = [np.exp(merged(log_v, importance, count)) for importance in importances]
        for low, high in STARTS if count > 1 else ((0.3, 0.3), (0.7, 0.7)):
            first, last = self._log_variance_at(low)[0], self._log_variance_at(high)[1]
            starts.append(np.exp(np.linspace(first, max(last, first + (count - 1) * self.min_log_ratio), count)))
        return starts


def shared_variances(fitters: Sequence[Fitter], count: int) -> Float:
    """The `count` variances, mm^2, that suit several profiles together: each has weights of its own.

    Parameters
    ----------
    fitters : sequence of Fitter
        One a profile, all with the same options.
    count : int
    """
    middle = fitters[len(fitters) // 2]
    log_v, importances = middle._dense
    starts = [np.exp(merged(log_v, importance, count)) for importance in importances]
    for low, high in (STARTS[0], STARTS[-1]) if count > 1 else ((0.5, 0.5),):
        first = min(fitter._log_variance_at(low)[0] for fitter in fitters)
        last = max(fitter._log_variance_at(high)[1] for fitter in fitters)
        starts.append(np.exp(np.linspace(first, max(last, first + (count - 1) * middle.min_log_ratio), count)))
    # One profile's optimum is sharp, that of many is not: the best start is enough
    return best_variances(fitters, count, starts, finalists=1)


def best_variances(fitters: Sequence[Fitter], count: int, starts: Iterable[Float], finalists: int = FINALISTS) -> Float:
    """Variances, mm^2, (count,), with the least sum of squared errors over all profiles, channel by channel.

    Parameters
    ----------
    fitters : sequence of Fitter
    count : int
    starts : iterable of ndarrays of shape (count,)
        Variances to begin from.
    finalists : int
        How many of the starts are followed to the end, after a short look from all.
    """
    from scipy.optimize import least_squares

    # Unknowns are the first ln v and the gaps, so that the order and the least ratio are plain bounds
    cumulate = np.tril(np.ones((count, count)))
    lower = np.full(count, fitters[0].min_log_ratio)
    lower[0] = min(fitter.log_range[0] for fitter in fitters)
    upper = np.full(count, np.inf)
    upper[0] = widest = max(fitter.log_range[1] for fitter in fitters)

    def search(x: Float, evaluations: int) -> Float:
        found = least_squares(
            lambda x: np.concatenate([fitter._residual(cumulate @ x, widest) for fitter in fitters]),
            np.clip(x, lower + 1e-6, upper - 1e-6),
            jac=lambda x: np.concatenate([fitter._jacobian(cumulate @ x, widest) for fitter in fitters]) @ cumulate,
            bounds=(lower, upper),
            ftol=1e-9,
            xtol=1e-8,
            gtol=1e-10,
            max_nfev=evaluations,
        )
        return np.asarray(found.x)

    def squared_error(x: Float) -> float:
        errors = [fitter.project(np.exp(cumulate @ x)).error for fitter in fitters]
        return float(sum(error @ error for error in errors))

    # A short look from every start, then the better ones to the end
    log_starts = [np.log(np.sort(start)) for start in starts]
    looks = [search(np.diff(log_v, prepend=0.0), SHORT_LOOK) for log_v in log_starts]
    best = sorted(looks, key=squared_error)[:finalists]
    ends = [search(x, 60) for x in best]
    return np.exp(cumulate @ min(ends, key=squared_error))
