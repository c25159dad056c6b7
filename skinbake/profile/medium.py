"""Optical coefficients of one homogeneous medium, and the diffusion lengths that follow from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinbake.numerics import Float


@dataclass(frozen=True)
class Medium:
    """Absorption and reduced scattering per channel; theory.md 1.1 to 1.5.

    Attributes
    ----------
    sigma_a_per_mm, sigma_sp_per_mm : ndarray of shape (C,)
        Absorption and reduced scattering; each >= 0, not both 0 in one channel.

    Raises
    ------
    ValueError
        If a coefficient is negative or not finite, or both are 0.
    """

    sigma_a_per_mm: Float
    sigma_sp_per_mm: Float

    def __post_init__(self) -> None:
        for name in ("sigma_a_per_mm", "sigma_sp_per_mm"):
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=np.float64))
            if not np.isfinite(value).all() or np.any(value < 0):
                raise ValueError(f"{name}: expected finite numbers >= 0, got {value.tolist()}")
            object.__setattr__(self, name, value)
        if self.sigma_a_per_mm.shape != self.sigma_sp_per_mm.shape:
            raise ValueError("sigma_a_per_mm and sigma_sp_per_mm: expected the same number of channels")
        if np.any(self.sigma_tp_per_mm == 0):
            raise ValueError("sigma_a_per_mm and sigma_sp_per_mm: expected one of them above 0, both are 0")

    @cached_property
    def sigma_tp_per_mm(self) -> Float:
        """Reduced extinction sigma_t', 1/mm, shape (C,); theory.md 1.1."""
        return self.sigma_a_per_mm + self.sigma_sp_per_mm

    @cached_property
    def albedo(self) -> Float:
        """Reduced albedo alpha' = sigma_s' / sigma_t', shape (C,); theory.md 1.2."""
        return self.sigma_sp_per_mm / self.sigma_tp_per_mm

    @cached_property
    def absorbed(self) -> Float:
        """Share w = sigma_a / sigma_t' = 1 - alpha', without the subtraction; theory.md 1.2."""
        return self.sigma_a_per_mm / self.sigma_tp_per_mm

    @cached_property
    def diffusion_mm(self) -> Float:
        """Diffusion coefficient D = 1 / (3 sigma_t'), mm, shape (C,); theory.md 1.3."""
        return 1 / (3 * self.sigma_tp_per_mm)

    @cached_property
    def sigma_tr_per_mm(self) -> Float:
        """Effective transport coefficient, 1/mm, shape (C,); theory.md 1.4."""
        return np.sqrt(3 * self.sigma_a_per_mm) * np.sqrt(self.sigma_tp_per_mm)

    @cached_property
    def free_path_mm(self) -> Float:
        """Transport mean free path z_r = 1 / sigma_t', the depth of the real source, mm, shape (C,); theory.md 1.5."""
        return 1 / self.sigma_tp_per_mm

    def extrapolation_mm(self, boundary: float) -> Float:
        """Height z_b = 2 A D above the face at which the fluence extrapolates to 0, mm, shape (C,); theory.md 1.5."""
        return 2 * boundary * self.diffusion_mm
