"""A profile as wide as another one times a factor: R(r / k) / k^2."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float
from skinbake.profile.diffusion_profile import DiffusionProfile, as_radii
from skinbake.profile.fit_nodes import AnnulusNodes, FitNodes, FrequencyNodes
from skinbake.profile.gaussian_sum import GaussianSum


@dataclass(frozen=True)
class ScaledProfile(DiffusionProfile):
    """A profile with every length multiplied; it gives back as much light as before.

    Attributes
    ----------
    of : DiffusionProfile
    factor : float
    """

    of: DiffusionProfile
    factor: float

    @property
    def model(self) -> str:  # type: ignore[override]
        """Name of the model."""
        return self.of.model

    @property
    def footprint_mm(self) -> float:  # type: ignore[override]
        """Detail that a fit does not look at, mm."""
        return self.of.footprint_mm * self.factor

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r / k) / k^2, mm^-2, shape (N, 3)."""
        return self.of.reflectance(as_radii(radius_mm) / self.factor) / self.factor**2

    @property
    def total_reflectance(self) -> Float:
        """Total reflectance, shape (3,)."""
        return self.of.total_reflectance

    def fit_nodes(self) -> FitNodes:
        """Nodes at which a fit compares itself with the model."""
        return scaled_nodes(self.of.fit_nodes(), self.factor)

    def transmittance(self, radius_mm: ArrayLike) -> Float:
        """T(r / k) / k^2 without its delta, mm^-2, shape (N, 3)."""
        return self.of.transmittance(as_radii(radius_mm) / self.factor) / self.factor**2

    @property
    def total_transmittance(self) -> Float:
        """All light that leaves below, shape (3,)."""
        return self.of.total_transmittance

    @property
    def sharp_transmittance(self) -> Float:
        """Part of it that leaves exactly below its entry, shape (3,)."""
        return self.of.sharp_transmittance

    def stderr(self, radius_mm: ArrayLike) -> Float | None:
        """Standard error of R(r), mm^-2, shape (N, 3)."""
        found = self.of.stderr(as_radii(radius_mm) / self.factor)
        return None if found is None else found / self.factor**2

    @property
    def relative_noise(self) -> Float | None:
        """Standard error in the norm of the fit, shape (3,)."""
        return self.of.relative_noise

    @property
    def total_stderr(self) -> Float | None:
        """Standard error of the total reflectance, shape (3,)."""
        return self.of.total_stderr


def scaled_profile(profile: DiffusionProfile, factor: float) -> DiffusionProfile:
    """The profile `factor` times as wide; itself for 1."""
    return profile if factor == 1 else ScaledProfile(profile, factor)


def scaled_gaussians(gaussians: GaussianSum, factor: float) -> GaussianSum:
    """Gaussians of a profile `factor` times as wide; themselves for 1."""
    return gaussians if factor == 1 else replace(gaussians, variance_mm2=gaussians.variance_mm2 * factor**2)


def scaled_nodes(nodes: FitNodes, factor: float) -> FitNodes:
    """Nodes of the profile `factor` times as wide.

    Raises
    ------
    TypeError
        If it is not known how to scale such nodes.
    """
    if isinstance(nodes, FrequencyNodes):
        return replace(nodes, s_per_mm=nodes.s_per_mm / factor, footprint_mm=nodes.footprint_mm * factor)
    if isinstance(nodes, AnnulusNodes):
        return replace(nodes, edge_mm=nodes.edge_mm * factor, target=np.asarray(nodes.target) / factor**2)
    raise TypeError(f"scaled_nodes: expected FrequencyNodes or AnnulusNodes, got {type(nodes).__name__}")
