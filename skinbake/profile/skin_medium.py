"""What a skin is made of, as far as it says so: layers through which light can be followed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.albedo_inversion import albedo_inversion
from skinbake.profile.from_skin import as_layer
from skinbake.profile.incidence import WALKS, Incidence, reflect_slanted
from skinbake.profile.layers import Layer, without_empty
from skinbake.profile.medium import Medium
from skinbake.scene.skin import (
    BurleySkin,
    DipoleSkin,
    GaussiansSkin,
    MultipoleSkin,
    PhysiologySkin,
    SkinSpec,
    TableSkin,
    TransportSkin,
)


@dataclass(frozen=True)
class SkinMedium:
    """Layers of a skin.

    Attributes
    ----------
    layers : tuple of Layer
        Top first, of one index; empty where the skin does not say what it is made of.
    to_rgb : ndarray of shape (3, C), optional
        What makes RGB of the layers' channels; None where they are R, G and B.
    why : str
        Why there are no layers.
    named : bool
        Whether a profile that is not computed from it names this medium: its totals are not the profile's.
    """

    layers: tuple[Layer, ...] = ()
    to_rgb: Float | None = None
    why: str = ""
    named: bool = False

    @property
    def identity(self) -> list[Any]:
        """Plain values that tell this medium from others."""
        return [
            [
                *(layer.medium.sigma_a_per_mm.tolist(), layer.medium.sigma_sp_per_mm.tolist()),
                *(layer.thickness_mm, layer.eta, layer.g),
            ]
            for layer in self.layers
        ]


def skin_medium(skin: SkinSpec) -> SkinMedium:
    """Layers that a skin's model is about, all lengths times `skin.radius`; or why it has none."""
    medium = _unscaled_medium(skin)
    if skin.radius == 1:
        return medium
    return replace(medium, layers=tuple(_widened(layer, skin.radius) for layer in medium.layers))


def _widened(layer: Layer, factor: float) -> Layer:
    """A layer in which every path is `factor` times as long."""
    medium = Medium(layer.medium.sigma_a_per_mm / factor, layer.medium.sigma_sp_per_mm / factor)
    return replace(layer, medium=medium, thickness_mm=layer.thickness_mm * factor)


def _unscaled_medium(skin: SkinSpec) -> SkinMedium:
    """Layers of a skin of radius 1."""
    if isinstance(skin, DipoleSkin):
        medium = Medium(np.array(skin.sigma_a_per_mm), np.array(skin.sigma_sp_per_mm))
        return SkinMedium((Layer(medium, np.inf, skin.eta),))
    if isinstance(skin, MultipoleSkin | TransportSkin):
        layers = without_empty(tuple(map(as_layer, skin.layers)))
        if any(layer.eta != layers[0].eta for layer in layers):
            return SkinMedium(why="its layers have different indices")
        return SkinMedium(layers)
    if isinstance(skin, BurleySkin):
        if skin.mean_free_path_mm is None or skin.mean_free_path == "surface":
            return SkinMedium(why="burley by a length on the surface is a shape without a medium")
        albedo, sigma_t = albedo_inversion(np.array(skin.albedo_rgb), "wrenninge"), 1 / np.array(skin.mean_free_path_mm)
        return SkinMedium((Layer(Medium((1 - albedo) * sigma_t, albedo * sigma_t), np.inf, 1.0),))
    if isinstance(skin, PhysiologySkin):
        from skinbake.profile.physiology import physiological_layers
        from skinbake.profile.spectrum import WAVELENGTH_NM, reflectance_to_rgb

        return SkinMedium(without_empty(physiological_layers(skin, WAVELENGTH_NM)), reflectance_to_rgb())
    if isinstance(skin, GaussiansSkin | TableSkin) and skin.medium is not None:
        return replace(skin_medium(skin.medium), named=True)
    return SkinMedium(why=f"model {skin.model} gives a profile, and skin.medium names no medium")


def medium_incidence(medium: SkinMedium) -> Incidence:
    """R(mu) of a medium, in RGB; where it scatters forwards some seconds of walks.

    Raises
    ------
    ValueError
        If the medium has no layers.
    """
    if not medium.layers:
        raise ValueError(f"medium: expected layers, got none: {medium.why}")
    if medium.to_rgb is None:
        return reflect_slanted(medium.layers)
    # Noise of many wavelengths averages out in three colours
    found = reflect_slanted(medium.layers, max(1, 3 * WALKS // medium.to_rgb.shape[1]))
    return Incidence(
        found.cosine,
        np.maximum(found.reflectance_rgb @ medium.to_rgb.T, 0),
        np.maximum(found.diffuse_rgb @ medium.to_rgb.T, 0),
    )
