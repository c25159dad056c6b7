"""Which homogeneous medium a skin of a look stands for."""

from __future__ import annotations

from dataclasses import replace
from math import isinf

import numpy as np

from skinbake.errors import InputError
from skinbake.profile.albedo_inversion import albedo_inversion
from skinbake.scene.skin import BurleySkin, DipoleSkin, LayerSpec, MultipoleSkin, SkinSpec, TransportSkin
from skinbake.transport.medium import TransportMedium

CLEAR_MM = 200.0  # a free path longer than this does not scatter within a head


def medium_of_skin(skin: SkinSpec) -> TransportMedium:
    """Medium that fills the mesh: of `dipole`, of one layer, or of `burley` with its albedo inverted; lengths are times
    `skin.radius`.

    Reduced coefficients are taken with isotropic scattering (similarity), those of a layer that says `g` with
    Henyey-Greenstein scattering and sigma_s' / (1 - g).

    Raises
    ------
    InputError
        The skin has no medium, has several, or its medium is so clear that light hardly meets it; the message says
        which.
    """
    if isinstance(skin, DipoleSkin):
        medium = TransportMedium(np.array(skin.sigma_a_per_mm), np.array(skin.sigma_sp_per_mm), 0.0, skin.eta)
    elif isinstance(skin, MultipoleSkin | TransportSkin):
        medium = _of_layers(skin.layers, skin.model)
    elif isinstance(skin, BurleySkin):
        medium = _of_burley(skin)
    else:
        raise InputError(
            f"skin: model {skin.model} gives a profile and no medium that light could be followed through; expected "
            "dipole, burley with mean_free_path_mm, or multipole or transport with one layer, such as --set "
            "skin.preset=jensen-skin1 (skin.medium is not what a profile is computed from)"
        )
    if skin.radius != 1:
        medium = replace(
            medium,
            sigma_a_per_mm=medium.sigma_a_per_mm / skin.radius,
            sigma_s_per_mm=medium.sigma_s_per_mm / skin.radius,
        )
    longest = float((1 / (medium.sigma_a_per_mm + (1 - medium.g) * medium.sigma_s_per_mm)).max())
    if longest > CLEAR_MM or np.any(medium.sigma_s_per_mm == 0):
        raise InputError(
            f"skin: too clear to follow light through: its transport mean free path is {longest:.4g} mm, expected at "
            f"most {CLEAR_MM:g}, and scattering in every channel"
        )
    return medium


def _of_layers(layers: tuple[LayerSpec, ...], model: str) -> TransportMedium:
    kept = [layer for layer in layers if layer.thickness_mm > 0]
    first = kept[0]
    if any(layer.model_dump(exclude={"thickness_mm"}) != first.model_dump(exclude={"thickness_mm"}) for layer in kept):
        raise InputError(
            f"skin: {model} with {len(kept)} different layers: light can be followed through one homogeneous medium "
            "only; expected one layer"
        )
    if not isinf(kept[-1].thickness_mm):
        raise InputError(
            f"skin: {model} with a layer of {kept[-1].thickness_mm:g} mm and nothing below it: expected "
            "thickness_mm: .inf, a medium that fills the mesh"
        )
    g = first.g if model == "transport" else 0.0
    return TransportMedium(np.array(first.sigma_a_per_mm), np.array(first.sigma_sp_per_mm) / (1 - g), g, first.eta)


def _of_burley(skin: BurleySkin) -> TransportMedium:
    if skin.mean_free_path_mm is None:
        raise InputError("skin: burley by d_mm is a shape without a medium; expected mean_free_path_mm and albedo_rgb")
    if skin.mean_free_path == "surface":
        raise InputError(
            "skin: mean_free_path: surface is a length on the surface; expected searchlight or diffuse, the path in "
            "the volume"
        )
    albedo = albedo_inversion(np.array(skin.albedo_rgb), "wrenninge")
    sigma_t = 1 / np.array(skin.mean_free_path_mm)
    return TransportMedium((1 - albedo) * sigma_t, albedo * sigma_t, 0.0, 1.0)
