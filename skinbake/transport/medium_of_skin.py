"""Which media, by depth below the surface, a skin of a look stands for."""

from __future__ import annotations

from collections.abc import Callable, Collection
from math import inf, isinf

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.profile.albedo_inversion import albedo_inversion
from skinbake.profile.physiology import (
    dermis_absorption_per_mm,
    epidermis_absorption_per_mm,
    epidermis_scattering_per_mm,
)
from skinbake.profile.spectrum import WAVELENGTH_NM, reflectance_to_rgb
from skinbake.scene.skin import (
    BurleySkin,
    DipoleSkin,
    LayerSpec,
    MultipoleSkin,
    PhysiologySkin,
    SkinSpec,
    TransportSkin,
)
from skinbake.transport.medium import Pigment, SkinLayers, TransportMedium

CLEAR_MM = 200.0  # a free path longer than this does not scatter within a head


def medium_of_skin(skin: SkinSpec, maps: Collection[str] = ()) -> SkinLayers:
    """Media that fill the mesh: of `dipole`, of the layers of `multipole`, `transport` and `physiology`, or of `burley`
    with its albedo inverted; lengths are times `skin.radius`.

    Reduced coefficients are taken with isotropic scattering (similarity), those of a `transport` layer that says `g`
    with Henyey-Greenstein scattering and sigma_s' / (1 - g).

    Parameters
    ----------
    skin : SkinSpec
    maps : collection of str
        Which of `melanin` and `haemoglobin` a map tells, place by place.

    Raises
    ------
    InputError
        The skin has no medium, layers of different indices, nothing below its last layer, or is so clear that light
        hardly meets it; the message says which.
    """
    if isinstance(skin, DipoleSkin):
        medium = TransportMedium(np.array(skin.sigma_a_per_mm), np.array(skin.sigma_sp_per_mm), 0.0, skin.eta)
        found = SkinLayers.of_one(medium)
    elif isinstance(skin, MultipoleSkin | TransportSkin):
        found = _of_layers(skin.layers, skin.model)
    elif isinstance(skin, PhysiologySkin):
        found = _of_physiology(skin, maps)
    elif isinstance(skin, BurleySkin):
        found = SkinLayers.of_one(_of_burley(skin))
    else:
        raise InputError(
            f"skin: model {skin.model} gives a profile and no medium that light could be followed through; expected "
            "dipole, physiology, multipole or transport, or burley with mean_free_path_mm, such as --set "
            "skin.preset=jensen-skin1 (skin.medium is not what a profile is computed from)"
        )
    _refuse_clear(found)
    if skin.radius == 1:
        return found
    return SkinLayers(
        tuple(layer.denser(1 / skin.radius) for layer in found.layers),
        tuple(each * skin.radius for each in found.thickness_mm),
        tuple(each and Pigment(each.name, each.sigma_a_per_mm / skin.radius) for each in found.pigments),
        found.to_rgb,
    )


def _refuse_clear(skin: SkinLayers) -> None:
    medium = skin.layers[-1]
    longest = float((1 / (medium.sigma_a_per_mm + (1 - medium.g) * medium.sigma_s_per_mm)).max())
    if longest > CLEAR_MM or np.any(medium.sigma_s_per_mm == 0):
        raise InputError(
            f"skin: too clear to follow light through: its transport mean free path is {longest:.4g} mm, expected at "
            f"most {CLEAR_MM:g}, and scattering in every channel"
        )


def _of_layers(layers: tuple[LayerSpec, ...], model: str) -> SkinLayers:
    kept = [layer for layer in layers if layer.thickness_mm > 0]
    index = [layer.eta for layer in kept]
    if min(index) != max(index):
        raise InputError(
            f"skin.layers: {model} with indices of refraction {', '.join(f'{eta:g}' for eta in index)}: light is "
            "followed through layers of one eta only, for faces between layers do not refract; expected the same eta"
        )
    if not isinf(kept[-1].thickness_mm):
        raise InputError(
            f"skin.layers: {model} with a last layer of {kept[-1].thickness_mm:g} mm and nothing below it: expected "
            "thickness_mm: .inf, a medium that fills the mesh"
        )
    media: list[TransportMedium] = []
    thickness: list[float] = []
    for layer in kept:
        g = layer.g if model == "transport" else 0.0
        medium = TransportMedium(
            np.array(layer.sigma_a_per_mm), np.array(layer.sigma_sp_per_mm) / (1 - g), g, layer.eta
        )
        if media and _alike(medium, media[-1]):
            thickness[-1] += layer.thickness_mm
        else:
            media.append(medium)
            thickness.append(layer.thickness_mm)
    return SkinLayers(tuple(media), tuple(thickness), (None,) * len(media))


def _alike(one: TransportMedium, other: TransportMedium) -> bool:
    """Whether two layers are one."""
    return (
        np.array_equal(one.sigma_a_per_mm, other.sigma_a_per_mm)
        and np.array_equal(one.sigma_s_per_mm, other.sigma_s_per_mm)
        and one.g == other.g
    )


def _of_physiology(skin: PhysiologySkin, maps: Collection[str]) -> SkinLayers:
    """Epidermis over dermis, a channel a wavelength; absorption is linear in the pigments."""
    w = WAVELENGTH_NM
    scattering = epidermis_scattering_per_mm(w)

    def layer(name: str, absorption: Callable[[float], Float], scattered: Float) -> tuple[TransportMedium, Pigment]:
        pigment = Pigment(name, absorption(1.0) - absorption(0.0))
        held = absorption(0.0 if name in maps else getattr(skin, name))
        return TransportMedium(held, scattered, 0.0, skin.eta), pigment

    parts = [
        layer("melanin", lambda share: epidermis_absorption_per_mm(w, share, skin.eumelanin), scattering),
        layer("haemoglobin", lambda share: dermis_absorption_per_mm(w, share, skin.oxygenation), scattering / 2),
    ]
    if skin.epidermis_mm == 0:
        parts = parts[1:]
    return SkinLayers(
        tuple(medium for medium, _ in parts),
        (skin.epidermis_mm, inf)[-len(parts) :],
        tuple(pigment if pigment.name in maps else None for _, pigment in parts),
        reflectance_to_rgb(),
    )


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
