"""Skin described by what it is made of: melanin above, blood below; theory.md 3.9."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.haemoglobin import blood_absorption_per_mm
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.scene.skin import PhysiologySkin


def epidermis_scattering_per_mm(wavelength_nm: Float) -> Float:
    """Reduced scattering of the epidermis, 1/mm, shape of the wavelengths; the dermis has half of it. theory.md 3.9.

    The formula has been misread as 1/cm.
    """
    return 14.74 * wavelength_nm**-0.22 + 2.2e11 * wavelength_nm**-4.0


def melanin_absorption_per_mm(wavelength_nm: Float) -> tuple[Float, Float]:
    """Absorption of pure eumelanin and of pure pheomelanin, 1/mm, each of the shape of the wavelengths."""
    return 6.6e10 * wavelength_nm**-3.33, 2.9e14 * wavelength_nm**-4.75


def baseline_absorption_per_mm(wavelength_nm: Float) -> Float:
    """Absorption of skin without melanin and blood, 1/mm, shape of the wavelengths."""
    return 0.0244 + 8.53 * np.exp(-(wavelength_nm - 154) / 66.2)


def epidermis_absorption_per_mm(wavelength_nm: Float, melanin: float, eumelanin: float) -> Float:
    """Absorption of the epidermis, 1/mm, shape of the wavelengths.

    Parameters
    ----------
    wavelength_nm : ndarray
    melanin : float
        Volume fraction of melanin.
    eumelanin : float
        Share of eumelanin in it; the rest is pheomelanin.
    """
    brown, red = melanin_absorption_per_mm(wavelength_nm)
    pigment = eumelanin * brown + (1 - eumelanin) * red
    return melanin * pigment + (1 - melanin) * baseline_absorption_per_mm(wavelength_nm)


def dermis_absorption_per_mm(wavelength_nm: Float, haemoglobin: float, oxygenation: float) -> Float:
    """Absorption of the dermis, 1/mm, shape of the wavelengths.

    Parameters
    ----------
    wavelength_nm : ndarray
    haemoglobin : float
        Volume fraction of blood.
    oxygenation : float
        Oxygenated share of it.

    Raises
    ------
    ValueError
        If a wavelength lies outside 380 to 780 nm.
    """
    oxygenated, deoxygenated = blood_absorption_per_mm(wavelength_nm)
    blood = oxygenation * oxygenated + (1 - oxygenation) * deoxygenated
    return haemoglobin * blood + (1 - haemoglobin) * baseline_absorption_per_mm(wavelength_nm)


def physiological_layers(skin: PhysiologySkin, wavelength_nm: Float) -> tuple[Layer, ...]:
    """Epidermis over a semi-infinite dermis, one channel a wavelength.

    References
    ----------
    [Donner2006]
    """
    scattering = epidermis_scattering_per_mm(wavelength_nm)
    epidermis = Medium(epidermis_absorption_per_mm(wavelength_nm, skin.melanin, skin.eumelanin), scattering)
    dermis = Medium(dermis_absorption_per_mm(wavelength_nm, skin.haemoglobin, skin.oxygenation), scattering / 2)
    return Layer(epidermis, skin.epidermis_mm, skin.eta), Layer(dermis, np.inf, skin.eta)
