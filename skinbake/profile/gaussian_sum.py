"""The boundary between scattering theory and blurring: a sum of radial Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float, gaussian_2d
from skinbake.profile.weight_table import WeightTable

VISIBLE_ERROR = 0.03  # relative error of a fit from which on an eye may see it


@dataclass(frozen=True)
class GaussianSum:
    """Diffusion profile R(r) = sum_i weight_rgb[i] G(variance_mm2[i], r), narrowest first.

    Attributes
    ----------
    variance_mm2 : ndarray of shape (N,)
        Shared by the channels, ascending; 0 is the identity (light that leaves where it arrived).
    weight_rgb : ndarray of shape (N, 3)
        Total diffuse reflectance per channel, or 1 when normalised to white.
    relative_error_rgb : ndarray of shape (3,)
        r-weighted relative error of the fit against the model, the worst of a table; 0 for a given sum.
    energy_rgb : ndarray of shape (3,)
        Total diffuse reflectance of the model before any normalisation.
    model, normalise : str
        Where the profile came from ("dipole", "gaussians", ...) and "white" or "none".
    table : WeightTable, optional
        Weights that differ over the skin; `weight_rgb` is then that of the maps' mean values.
    edge_error_rgb : ndarray of shape (3,), optional
        Error of the fit as edges of light see it (`skinbake.profile.edge_error`); None where nobody has looked.
    """

    variance_mm2: Float
    weight_rgb: Float
    relative_error_rgb: Float
    energy_rgb: Float
    model: str = "gaussians"
    normalise: str = "white"
    table: WeightTable | None = None
    edge_error_rgb: Float | None = None

    def __post_init__(self) -> None:
        n = len(self.variance_mm2)
        if self.weight_rgb.shape != (n, 3) or n == 0:
            raise ValueError(
                f"weight_rgb: expected shape ({n}, 3) with at least one Gaussian, got {self.weight_rgb.shape}"
            )
        if not (np.isfinite(self.variance_mm2).all() and np.isfinite(self.weight_rgb).all()):
            raise ValueError("GaussianSum: variances and weights must be finite")
        if np.any(self.variance_mm2 < 0) or np.any(np.diff(self.variance_mm2) <= 0):
            raise ValueError("variance_mm2: expected ascending values >= 0")

    @property
    def fit_error(self) -> float:
        """Share of what the blur does that the fit leaves wrong, of the worst channel."""
        error = self.relative_error_rgb if self.edge_error_rgb is None else self.edge_error_rgb
        return float(error.max(initial=0.0))

    def too_far_off(self, tolerance: float | None = None) -> bool:
        """Whether the fit, of skin that maps vary the worst, is off by more than `tolerance`, or than an eye sees."""
        return float(self.relative_error_rgb.max(initial=0.0)) > (tolerance or VISIBLE_ERROR)

    def evaluate(self, radius_mm: ArrayLike) -> Float:
        """R(r), mm^-2, shape (len(radius_mm), 3); Gaussians of zero variance are deltas and left out."""
        wide = self.variance_mm2 > 0
        values = gaussian_2d(self.variance_mm2[None, wide], np.atleast_1d(np.asarray(radius_mm, float))[:, None])
        return values @ self.weight_rgb[wide]
