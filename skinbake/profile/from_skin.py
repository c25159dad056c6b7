"""Profile of the `skin:` part of a look."""

from __future__ import annotations

from math import isinf

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.profile.better_dipole import BetterDipole
from skinbake.profile.burley import burley_shape
from skinbake.profile.diffusion_profile import DiffusionProfile
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import BetterDipoleProfile, BurleyProfile, DipoleProfile, GaussianProfile, LayeredProfile
from skinbake.profile.scaled import scaled_profile
from skinbake.scene.skin import (
    BurleySkin,
    DipoleSkin,
    GaussiansSkin,
    LayerSpec,
    MultipoleSkin,
    PhysiologySkin,
    SkinSpec,
    TableSkin,
    TransportSkin,
)


def profile_of(
    skin: SkinSpec, table: tuple[Float, Float] | None = None, photons: int | None = None, seed: int | None = None
) -> DiffusionProfile:
    """Scattering model that a skin names, `skin.radius` times as wide.

    Parameters
    ----------
    skin : SkinSpec
    table : (radius_mm of shape (N,), rgb of shape (N, 3)), optional
        Content of a `table` model's file; this module opens none.
    photons, seed : int, optional
        In place of a `transport` model's own.

    Raises
    ------
    InputError
        If a `table` model comes without its table.
    """
    return scaled_profile(_unscaled(skin, table, photons, seed), skin.radius)


def _unscaled(
    skin: SkinSpec, table: tuple[Float, Float] | None, photons: int | None, seed: int | None
) -> DiffusionProfile:
    """The model of radius 1.

    Parameters
    ----------
    skin, table, photons, seed
        As `profile_of`.
    """
    if isinstance(skin, DipoleSkin):
        medium = Medium(np.array(skin.sigma_a_per_mm), np.array(skin.sigma_sp_per_mm))
        if skin.variant == "better":
            return BetterDipoleProfile(BetterDipole(medium, skin.eta))
        return DipoleProfile(medium, skin.eta, skin.boundary)
    if isinstance(skin, MultipoleSkin):
        return LayeredProfile(tuple(map(as_layer, skin.layers)), boundary=skin.boundary, thin_layers=skin.thin_layers)
    if isinstance(skin, TransportSkin):
        from skinbake.profile.transport import trace_layers

        return trace_layers(
            tuple(map(as_layer, skin.layers)),
            photons or skin.photons,
            skin.seed if seed is None else seed,
            incidence=skin.incidence,
        )
    if isinstance(skin, PhysiologySkin):
        from skinbake.profile.physiology import physiological_layers
        from skinbake.profile.spectrum import WAVELENGTH_NM, reflectance_to_rgb

        layers = physiological_layers(skin, WAVELENGTH_NM)
        return LayeredProfile(layers, reflectance_to_rgb(), skin.boundary, model="physiology")
    if isinstance(skin, BurleySkin):
        albedo = np.array(skin.albedo_rgb)
        if skin.d_mm is not None:
            return BurleyProfile(np.array(skin.d_mm), albedo)
        return BurleyProfile(np.array(skin.mean_free_path_mm) / burley_shape(albedo, skin.mean_free_path), albedo)
    if isinstance(skin, GaussiansSkin):
        return GaussianProfile(given_gaussians(skin))
    assert isinstance(skin, TableSkin)
    if table is None:
        raise InputError(f"{skin.path}: expected the table to be read before its profile is made")
    from skinbake.profile.table import TableProfile

    return TableProfile(*table)


def given_gaussians(skin: GaussiansSkin) -> GaussianSum:
    """The Gaussians of the configuration, ascending, those of equal variance merged; weights as given."""
    variance, place = np.unique(np.array(skin.variance_mm2), return_inverse=True)
    weight = np.zeros((len(variance), 3))
    np.add.at(weight, place, np.array(skin.weight_rgb))
    return GaussianSum(variance, weight, np.zeros(3), weight.sum(axis=0), "gaussians", "none")


def as_layer(spec: LayerSpec) -> Layer:
    """Layer that a configuration's layer describes."""
    thickness = np.inf if isinf(spec.thickness_mm) else spec.thickness_mm
    return Layer(Medium(np.array(spec.sigma_a_per_mm), np.array(spec.sigma_sp_per_mm)), thickness, spec.eta, spec.g)
