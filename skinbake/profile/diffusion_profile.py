"""Interface of scattering models: R(r), T(r), totals, and nodes to fit at."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float
from skinbake.profile.fit_nodes import FitNodes, FrequencyNodes, geometric

RGB = 3


def as_radii(radius_mm: ArrayLike) -> Float:
    """Radii as a float64 array of shape (N,).

    Raises
    ------
    ValueError
        If a radius is negative or not finite.
    """
    radius = np.atleast_1d(np.asarray(radius_mm, dtype=np.float64))
    if radius.ndim != 1 or not np.isfinite(radius).all() or np.any(radius < 0):
        raise ValueError(f"radius_mm: expected finite numbers >= 0, got {radius.tolist()}")
    return radius


class DiffusionProfile(ABC):
    """Light that leaves at distance r from where it entered, per unit flux that entered; linear RGB."""

    model: str

    # Detail a fit does not look at, where R rises as 1/r and its norm would be infinite; 0 where R is finite
    footprint_mm: float = 0.0

    @abstractmethod
    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r), mm^-2, shape (N, 3)."""

    @property
    @abstractmethod
    def total_reflectance(self) -> Float:
        """2 pi int R r dr, shape (3,)."""

    @abstractmethod
    def fit_nodes(self) -> FitNodes:
        """Nodes at which a fit compares itself with the model."""

    def transmittance(self, radius_mm: ArrayLike) -> Float:
        """T(r) below the lowest layer without its delta at r = 0, mm^-2, shape (N, 3)."""
        return np.zeros((len(as_radii(radius_mm)), RGB))

    @property
    def total_transmittance(self) -> Float:
        """All light that leaves below, `sharp_transmittance` included, shape (3,)."""
        return np.zeros(RGB)

    @property
    def sharp_transmittance(self) -> Float:
        """Part of the total that leaves exactly below its entry, shape (3,): a delta that no table of T(r) can hold."""
        return np.zeros(RGB)

    def stderr(self, radius_mm: ArrayLike) -> Float | None:
        """Standard error of R(r), mm^-2, shape (N, 3); None where the model is not statistical."""
        return None

    @property
    def relative_noise(self) -> Float | None:
        """Standard error in the norm of the fit, relative to the profile, shape (3,); None where the model is not
        statistical.

        No fit can be much nearer to the model than that.
        """
        return None

    @property
    def total_stderr(self) -> Float | None:
        """Standard error of the total reflectance, shape (3,); None where the model is not statistical."""
        return None


class SpectralProfile(DiffusionProfile):
    """A profile whose Hankel transform is known in closed form."""

    @abstractmethod
    def hankel(self, s_per_mm: Float) -> Float:
        """R~(s), shape (M, 3); at s = 0 the total reflectance."""

    @property
    @abstractmethod
    def lengths_mm(self) -> tuple[float, float]:
        """Shortest and longest length that shape the profile, mm. R~ falls as exp(-s shortest) or faster."""

    @property
    def total_reflectance(self) -> Float:
        """Total reflectance R~(0), shape (3,)."""
        return self.hankel(np.zeros(1))[0]

    def fit_nodes(self) -> FitNodes:
        """Frequencies, evenly spaced in ln s, over everything the profile contains."""
        shortest, longest = self.lengths_mm
        s = geometric(1e-6 / longest, 45 / shortest)
        return FrequencyNodes(s, self.hankel(s), self.total_reflectance, self.footprint_mm)


@dataclass(frozen=True)
class Evaluated:
    """A profile's values at given radii.

    Attributes
    ----------
    radius_mm : ndarray of shape (N,)
    reflectance_per_mm2, transmittance_per_mm2, stderr_per_mm2 : ndarray of shape (N, 3)
        R(r), T(r) without its delta, and the standard error of R(r), None where the model is not statistical.
    total_reflectance, total_transmittance, sharp_transmittance, total_stderr : ndarray of shape (3,)
    model : str
    """

    radius_mm: Float
    reflectance_per_mm2: Float
    transmittance_per_mm2: Float
    total_reflectance: Float
    total_transmittance: Float
    sharp_transmittance: Float
    stderr_per_mm2: Float | None = None
    total_stderr: Float | None = None
    model: str = field(default="")


def evaluate(profile: DiffusionProfile, radius_mm: ArrayLike) -> Evaluated:
    """Reflectance, transmittance, totals and errors of a profile at the given radii (mm, shape (N,)).

    Raises
    ------
    ValueError
        If a radius is negative or not finite.
    """
    radius = as_radii(radius_mm)
    return Evaluated(
        radius,
        profile.reflectance(radius),
        profile.transmittance(radius),
        profile.total_reflectance,
        profile.total_transmittance,
        profile.sharp_transmittance,
        profile.stderr(radius),
        profile.total_stderr,
        profile.model,
    )
