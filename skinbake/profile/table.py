"""A profile given by its values at some radii."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float, monotone_cubic
from skinbake.profile.diffusion_profile import DiffusionProfile, as_radii
from skinbake.profile.fit_nodes import AnnulusNodes

PARTS = 4  # annuli between two radii of the table
MOST_ANNULI = 4096


@dataclass(frozen=True)
class TableProfile(DiffusionProfile):
    """Monotone cubic through ln R (R where it is not positive); constant inside the first radius, 0 past the last.

    Attributes
    ----------
    table_radius_mm : ndarray of shape (N,)
        Ascending, at least two.
    table_rgb : ndarray of shape (N, 3)
        mm^-2.

    Raises
    ------
    ValueError
        If the shapes or the order are wrong, or a value is not finite.
    """

    table_radius_mm: Float
    table_rgb: Float
    model: str = "table"

    def __post_init__(self) -> None:
        radius = as_radii(self.table_radius_mm)
        if len(radius) < 2 or np.any(np.diff(radius) <= 0):
            raise ValueError("r_mm: expected at least two ascending radii")
        if self.table_rgb.shape != (len(radius), 3) or not np.isfinite(self.table_rgb).all():
            raise ValueError(f"R, G, B: expected finite values of shape ({len(radius)}, 3), got {self.table_rgb.shape}")

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r) between the table's radii, mm^-2, shape (N, 3).

        Raises
        ------
        ValueError
            If a radius is negative or not finite.
        """
        radius = as_radii(radius_mm)
        first, last = self.table_radius_mm[0], self.table_radius_mm[-1]
        inside = np.clip(radius, first, last)
        values = np.empty((len(radius), 3))
        for c in range(3):
            column = self.table_rgb[:, c]
            if (column > 0).all():
                values[:, c] = np.exp(monotone_cubic(self.table_radius_mm, np.log(column), inside))
            else:
                values[:, c] = monotone_cubic(self.table_radius_mm, column, inside)
        return np.where((radius > last)[:, None], 0.0, values)

    @property
    def total_reflectance(self) -> Float:
        """2 pi int R r dr of the interpolated table, shape (3,)."""
        return self._nodes.total

    def fit_nodes(self) -> AnnulusNodes:
        """Means over annuli, four between two radii of the table, or fewer where it has more than 1024 rows."""
        return self._nodes

    @cached_property
    def _nodes(self) -> AnnulusNodes:
        ends = np.unique(np.append(0.0, self.table_radius_mm))
        share = np.arange(PARTS) / PARTS
        edge = np.append((ends[:-1, None] + np.diff(ends)[:, None] * share).ravel(), ends[-1])
        # Three-point Gauss rule in r^2, which is area
        node, weight = np.polynomial.legendre.leggauss(3)
        area = edge**2
        at = np.sqrt((area[1:, None] + area[:-1, None] + np.diff(area)[:, None] * node) / 2)
        mean = np.einsum("mkc,k->mc", self.reflectance(at.ravel()).reshape(*at.shape, 3), weight / 2)
        total = np.pi * np.diff(area) @ mean
        if len(mean) > MOST_ANNULI:
            # Neighbours are taken together: a fit holds some thousand values for each annulus
            first = np.arange(0, len(mean), -(-len(mean) // MOST_ANNULI))
            share = np.diff(area)
            mean = np.add.reduceat(share[:, None] * mean, first) / np.add.reduceat(share, first)[:, None]
            edge = np.append(edge[first], edge[-1])
        return AnnulusNodes(edge, mean, total)
