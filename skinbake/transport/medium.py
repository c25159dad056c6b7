"""What a skin is made of, where light transport can be followed through it: a medium, or layers of several."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isinf

import numpy as np

from skinbake.numerics import Float


@dataclass(frozen=True)
class TransportMedium:
    """Coefficients of transport in a homogeneous medium.

    Attributes
    ----------
    sigma_a_per_mm, sigma_s_per_mm : ndarrays of shape (C,)
        Absorption and scattering (not reduced), of R, G and B or of any number of wavelengths.
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
            value = np.asarray(getattr(self, name), np.float64)
            value = np.broadcast_to(value, value.shape if value.size > 1 else 3).copy()
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

    def denser(self, factor: float) -> TransportMedium:
        """The medium in which every path is `factor` times as short."""
        sigma_a, sigma_s = self.sigma_a_per_mm * factor, self.sigma_s_per_mm * factor
        return replace(self, sigma_a_per_mm=sigma_a, sigma_s_per_mm=sigma_s)


@dataclass(frozen=True)
class Pigment:
    """What a map adds to a layer's absorption.

    Attributes
    ----------
    name : str
        Of the map.
    sigma_a_per_mm : ndarray of shape (C,)
        Per unit of the map's value.
    """

    name: str
    sigma_a_per_mm: Float


@dataclass(frozen=True)
class SkinLayers:
    """Layers by depth below the surface; the last one goes on inwards.

    Attributes
    ----------
    layers : tuple of TransportMedium
        Top first, of one index. A layer with a pigment is what is left without it.
    thickness_mm : tuple of float
        Of each; the last is infinite.
    pigments : tuple of Pigment or None
        Of each layer.
    to_rgb : ndarray of shape (3, C), optional
        What makes RGB of the layers' channels; None where they are R, G and B.

    Raises
    ------
    ValueError
        If there is no layer, their numbers or channels differ, their indices do, or a thickness cannot be.
    """

    layers: tuple[TransportMedium, ...]
    thickness_mm: tuple[float, ...]
    pigments: tuple[Pigment | None, ...]
    to_rgb: Float | None = None

    def __post_init__(self) -> None:
        if not self.layers or not len(self.layers) == len(self.thickness_mm) == len(self.pigments):
            raise ValueError("layers: expected one thickness and one pigment, or None, for each layer, at least one")
        if any(layer.eta != self.layers[0].eta for layer in self.layers):
            raise ValueError("eta: expected one index of refraction for all layers")
        if any(layer.sigma_a_per_mm.shape != self.layers[0].sigma_a_per_mm.shape for layer in self.layers):
            raise ValueError("layers: expected the same channels in every layer")
        if not isinf(self.thickness_mm[-1]) or not all(0 < each < inf for each in self.thickness_mm[:-1]):
            raise ValueError(f"thickness_mm: expected numbers above 0 and then inf, got {self.thickness_mm}")

    @staticmethod
    def of_one(medium: TransportMedium) -> SkinLayers:
        """One medium that fills the skin."""
        return SkinLayers((medium,), (inf,), (None,))

    @property
    def outer_mm(self) -> float:
        """Depth of the last layer."""
        return float(sum(self.thickness_mm[:-1]))
