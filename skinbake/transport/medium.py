"""The homogeneous medium that a skin stands for, where light transport can be followed through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float


@dataclass(frozen=True)
class TransportMedium:
    """Coefficients of transport in a homogeneous medium.

    Attributes
    ----------
    sigma_a_per_mm, sigma_s_per_mm : ndarrays of shape (3,)
        Absorption and scattering (not reduced).
    g : float
        Henyey-Greenstein mean cosine, 0 <= g < 1.
    eta : float
        Index inside over index outside, >= 1.

    Raises
    ------
    ValueError
        If a coefficient is negative or not finite, or a channel has neither.
    """

    sigma_a_per_mm: Float
    sigma_s_per_mm: Float
    g: float = 0.0
    eta: float = 1.0

    def __post_init__(self) -> None:
        for name in ("sigma_a_per_mm", "sigma_s_per_mm"):
            value = np.broadcast_to(np.asarray(getattr(self, name), np.float64), 3).copy()
            if not np.isfinite(value).all() or np.any(value < 0):
                raise ValueError(f"{name}: expected finite numbers >= 0, got {value.tolist()}")
            object.__setattr__(self, name, value)
        if np.any(self.sigma_t_per_mm <= 0):
            raise ValueError("sigma_a_per_mm and sigma_s_per_mm: expected one of them above 0, both are 0")
        if not 0 <= self.g < 1:
            raise ValueError(f"g: expected a number from 0 to 1, got {self.g}")
        if not self.eta >= 1:
            raise ValueError(f"eta: expected a number >= 1, got {self.eta}")

    @property
    def sigma_t_per_mm(self) -> Float:
        """Extinction."""
        return self.sigma_a_per_mm + self.sigma_s_per_mm

    @property
    def albedo(self) -> Float:
        """Single-scattering albedo."""
        return self.sigma_s_per_mm / self.sigma_t_per_mm
