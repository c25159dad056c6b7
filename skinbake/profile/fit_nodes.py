"""Nodes of a fit: places where the r-weighted norm of theory.md 4.2 is a plain sum of squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skinbake.numerics import Float

STEPS_PER_DECADE = 16


class FitNodes(Protocol):
    """A model's values at M nodes, and the values of unit Gaussians there.

    Attributes
    ----------
    target : ndarray of shape (M, C)
    root_weight : ndarray of shape (M,)
        Square root of each node's quadrature weight.
    total : ndarray of shape (C,)
        Total reflectance of the model.
    """

    @property
    def target(self) -> Float: ...  # noqa: D102
    @property
    def root_weight(self) -> Float: ...  # noqa: D102
    @property
    def total(self) -> Float: ...  # noqa: D102

    def basis(self, variance_mm2: Float) -> tuple[Float, Float]:
        """Unit Gaussians at the nodes and their derivatives by ln v, each (M, K)."""

    def window_share(self, variance_mm2: Float) -> Float:
        """Share of the model's light under exp(-r^2 / 2v), shape (J, C), for J variances: a smooth stand-in for the
        CDF.
        """


@dataclass(frozen=True)
class FrequencyNodes:
    """Nodes in the Hankel domain: a Gaussian is exp(-v s^2 / 2), and by Parseval the norm is int s F~^2 ds / 4 pi^2.

    `footprint_mm` is the sigma of a Gaussian through which model and fit are both seen; 0 for none. Without it the norm
    of a profile that rises as 1/r is infinite.
    """

    s_per_mm: Float  # (M,), geometric
    target: Float  # (M, C)
    total: Float  # (C,)
    footprint_mm: float = 0.0

    @property
    def step(self) -> float:
        """Spacing of ln s."""
        return float(np.log(self.s_per_mm[-1] / self.s_per_mm[0]) / (len(self.s_per_mm) - 1))

    @property
    def root_weight(self) -> Float:
        """Square root of the quadrature weight, s sqrt(h) / 2 pi times the footprint's transform, shape (M,)."""
        s = self.s_per_mm
        return s * np.sqrt(self.step) * np.exp(-((self.footprint_mm * s) ** 2) / 2) / (2 * np.pi)

    def basis(self, variance_mm2: Float) -> tuple[Float, Float]:
        """Unit Gaussians exp(-v s^2 / 2) at the nodes and their derivatives by ln v, each (M, K)."""
        exponent = self.s_per_mm[:, None] ** 2 * variance_mm2 / 2
        value = np.exp(-exponent)
        return value, -exponent * value

    def window_share(self, variance_mm2: Float) -> Float:
        """Share of the light under exp(-r^2 / 2v), v int R~ exp(-v s^2 / 2) s ds / R~(0), shape (J, C)."""
        value, _ = self.basis(variance_mm2)
        light = (value * self.s_per_mm[:, None] ** 2).T @ self.target
        return variance_mm2[:, None] * self.step * light / np.where(self.total > 0, self.total, 1)


@dataclass(frozen=True)
class AnnulusNodes:
    """Nodes on annuli, for profiles known by their mean over each: Monte Carlo and tables."""

    edge_mm: Float  # (M + 1,), ascending from 0
    target: Float  # (M, C), mean of R over the annulus
    total: Float  # (C,)

    @property
    def _ring(self) -> Float:
        """Difference of the squared radii of each annulus, mm^2, shape (M,)."""
        return np.diff(self.edge_mm**2)

    @property
    def root_weight(self) -> Float:
        """Square root of int r dr over each annulus, shape (M,)."""
        return np.sqrt(self._ring / 2)

    def basis(self, variance_mm2: Float) -> tuple[Float, Float]:
        """Means of unit Gaussians over the annuli, mm^-2, and their derivatives by ln v, each (M, K)."""
        exponent = self.edge_mm[:, None] ** 2 / (2 * variance_mm2)
        area = np.pi * self._ring[:, None]
        # Energy inside r is -expm1(-r^2 / 2v): the differences keep their digits at the centre
        return np.diff(-np.expm1(-exponent), axis=0) / area, np.diff(-exponent * np.exp(-exponent), axis=0) / area

    def window_share(self, variance_mm2: Float) -> Float:
        """Share of the light under exp(-r^2 / 2v), shape (J, C): each annulus counts with the mean of the window over
        it.
        """
        value, _ = self.basis(variance_mm2)
        light = 2 * np.pi * variance_mm2[:, None] * ((value * np.pi * self._ring[:, None]).T @ self.target)
        return light / np.where(self.total > 0, self.total, 1)


def geometric(first: float, last: float, per_decade: int = STEPS_PER_DECADE) -> Float:
    """Geometric grid from `first` to `last`, both included, with at least `per_decade` steps a decade.

    Parameters
    ----------
    first, last : float
        Above 0.
    per_decade : int
    """
    return np.geomspace(first, last, int(np.ceil(np.log10(last / first) * per_decade)) + 1)
