"""Report of a fit: its error, its energy, and the curves to plot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.profile.diffusion_profile import DiffusionProfile
from skinbake.profile.fit_nodes import FitNodes
from skinbake.profile.gaussian_sum import GaussianSum

CURVE_POINTS = 160


@dataclass(frozen=True)
class Curve:
    """Model and fit at the same radii, mm^-2, in the unit of the fit (white: each channel's light is 1)."""

    radius_mm: Float  # (N,), geometric
    model_rgb: Float  # (N, 3)
    fit_rgb: Float  # (N, 3)


@dataclass(frozen=True)
class FitReport:
    """A sum of Gaussians, the profile it stands for, and what the fit cost.

    Attributes
    ----------
    gaussians : GaussianSum
    profile : DiffusionProfile
    tolerance : float or None
        What was asked of the worst channel, if anything was.
    tolerance_met : bool
    scattered : float
        Share of the light that the profile is about; the rest leaves where it arrives.
    """

    gaussians: GaussianSum
    profile: DiffusionProfile
    tolerance: float | None = None
    tolerance_met: bool = True
    scattered: float = 1.0

    @property
    def relative_error_rgb(self) -> Float:
        """r-weighted relative error (theory.md 4.2) before normalisation, shape (3,)."""
        return self.gaussians.relative_error_rgb

    @property
    def energy_rgb(self) -> Float:
        """Total diffuse reflectance of the model, shape (3,)."""
        return self.gaussians.energy_rgb

    @property
    def energy_ratio_rgb(self) -> Float:
        """Light of the fit over light of the model, 1 where the energy was kept, shape (3,)."""
        sums = self.gaussians.weight_rgb.sum(axis=0)
        return sums if self.gaussians.normalise == "white" else safe_div(sums, self.energy_rgb)

    @property
    def scale_rgb(self) -> Float:
        """Factor from the model's R(r) to the unit of the fit, shape (3,)."""
        return self.scattered * (safe_div(1, self.energy_rgb) if self.gaussians.normalise == "white" else np.ones(3))

    @property
    def condition_number(self) -> float:
        """Condition number of the scaled Gram matrix, theory.md 4.4: how much weights can trade places unnoticed."""
        v = self.gaussians.variance_mm2[self.gaussians.variance_mm2 > 0]
        if v.size == 0:
            return 1.0
        return float(np.linalg.cond(2 * np.sqrt(v[:, None] * v) / (v[:, None] + v)))

    @cached_property
    def curve(self) -> Curve:
        """Model and fit at geometric radii, from well inside the narrowest to well outside the widest Gaussian."""
        r = curve_radii(self.gaussians)
        return Curve(r, self.profile.reflectance(r) * self.scale_rgb, self.gaussians.evaluate(r))

    @property
    def largest_residual_rgb(self) -> Float:
        """Greatest |r R - r fit| over greatest r R beyond the profile's footprint, shape (3,)."""
        return self._residual[0]

    @property
    def largest_residual_radius_mm(self) -> Float:
        """Radius of that greatest difference, mm, shape (3,)."""
        return self._residual[1]

    @cached_property
    def _residual(self) -> tuple[Float, Float]:
        """Greatest difference, relative, and its radius; each of shape (3,)."""
        curve = self.curve
        r = curve.radius_mm[:, None]
        seen = r >= self.profile.footprint_mm
        off = np.where(seen, np.abs(r * (curve.fit_rgb - curve.model_rgb)), 0)
        peak = np.where(seen, np.abs(r * curve.model_rgb), 0).max(axis=0)
        return safe_div(off.max(axis=0), peak), curve.radius_mm[off.argmax(axis=0)]


def curve_radii(gaussians: GaussianSum) -> Float:
    """Geometric radii, mm, shape (CURVE_POINTS,), that show every Gaussian."""
    v = gaussians.variance_mm2[gaussians.variance_mm2 > 0]
    if v.size == 0:
        return np.geomspace(0.01, 10, CURVE_POINTS)
    return np.geomspace(np.sqrt(v[0]) / 20, np.sqrt(v[-1]) * 5, CURVE_POINTS)


def error_against(gaussians: GaussianSum, nodes: FitNodes) -> tuple[Float, Float, Float]:
    """Distance of Gaussians from another profile, theory.md 4.2.

    Parameters
    ----------
    gaussians : GaussianSum
    nodes : FitNodes
        Nodes of the other profile.

    Returns
    -------
    as_is, scale, scaled : ndarrays of shape (3,)
        Error as they are, the scale that fits best, and the error at that scale.
    """
    wide = gaussians.variance_mm2 > 0
    value, _ = nodes.basis(gaussians.variance_mm2[wide])
    weighted = value * nodes.root_weight[:, None] @ gaussians.weight_rgb[wide]
    wanted = nodes.target * nodes.root_weight[:, None]
    norm = np.linalg.norm(wanted, axis=0)
    scale = safe_div(np.sum(weighted * wanted, axis=0), np.sum(weighted**2, axis=0))
    as_is = safe_div(np.linalg.norm(weighted - wanted, axis=0), norm)
    return as_is, scale, safe_div(np.linalg.norm(weighted * scale - wanted, axis=0), norm)
