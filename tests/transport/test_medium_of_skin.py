"""Skins and the medium they stand for."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from skinbake.errors import InputError
from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance
from skinbake.profile.physiology import physiological_layers
from skinbake.profile.spectrum import WAVELENGTH_NM, reflectance_to_rgb
from skinbake.scene.skin import SkinSpec
from skinbake.transport.medium import TransportMedium
from skinbake.transport.medium_of_skin import medium_of_skin

COEFFICIENTS = {"sigma_a_per_mm": [0.032, 0.17, 0.48], "sigma_sp_per_mm": [0.74, 0.88, 1.01]}


THIN = {**COEFFICIENTS, "thickness_mm": 1.0}
BURLEY = {"model": "burley", "mean_free_path_mm": 1.0, "albedo_rgb": 0.5}


def layers(maps=(), **skin):
    return medium_of_skin(TypeAdapter(SkinSpec).validate_python(skin), maps)


def medium(**skin):
    (found,) = layers(**skin).layers
    return found


def test_a_dipole_s_medium_is_its_own():
    """Reduced coefficients with isotropic scattering."""
    found = medium(model="dipole", eta=1.3, **COEFFICIENTS)
    assert np.array_equal(found.sigma_s_per_mm, COEFFICIENTS["sigma_sp_per_mm"])
    assert (found.g, found.eta) == (0.0, 1.3)


def test_g_counts_in_transport_alone():
    """sigma_s = sigma_s' / (1 - g) there; a multipole knows reduced scattering only."""
    layer = {**COEFFICIENTS, "g": 0.75, "eta": 1.4}
    found = medium(model="transport", layers=[layer])
    np.testing.assert_allclose(found.sigma_s_per_mm * 0.25, COEFFICIENTS["sigma_sp_per_mm"])
    assert found.g == 0.75
    assert medium(model="multipole", layers=[layer]).g == 0.0


def test_equal_layers_are_one_medium():
    """Two layers that differ in thickness alone."""
    found = medium(model="transport", layers=[{**COEFFICIENTS, "thickness_mm": 1.0}, COEFFICIENTS])
    assert np.array_equal(found.sigma_a_per_mm, COEFFICIENTS["sigma_a_per_mm"])


def test_layers_keep_their_order_and_lie_below_each_other():
    """The top one first, lengths times the radius; one of no thickness is left out."""
    other = {"sigma_a_per_mm": 1.0, "sigma_sp_per_mm": 2.0}
    none = {**other, "thickness_mm": 0.0}
    found = layers(model="multipole", layers=[{**other, "thickness_mm": 0.25}, none, COEFFICIENTS], radius=2.0)
    assert found.thickness_mm == (0.5, np.inf)
    assert found.outer_mm == 0.5
    np.testing.assert_allclose(found.layers[0].sigma_t_per_mm, 1.5)
    np.testing.assert_allclose(2 * found.layers[1].sigma_s_per_mm, COEFFICIENTS["sigma_sp_per_mm"])


@pytest.mark.parametrize("maps", [(), ("melanin",), ("melanin", "haemoglobin")])
def test_physiology_is_what_its_profile_is_computed_from(maps):
    """Epidermis over dermis at every wavelength, whether a key or a map tells the pigments."""
    skin = {"model": "physiology", "melanin": 0.04, "haemoglobin": 0.01, "epidermis_mm": 0.2}
    found = layers(maps, **skin)
    want = physiological_layers(TypeAdapter(SkinSpec).validate_python(skin), WAVELENGTH_NM)
    assert [layer.thickness_mm for layer in want] == list(found.thickness_mm)
    for layer, pigment, name, share, other in zip(
        found.layers, found.pigments, ("melanin", "haemoglobin"), (0.04, 0.01), want, strict=True
    ):
        assert (pigment is not None) == (name in maps)
        added = pigment.sigma_a_per_mm * share if pigment else 0
        np.testing.assert_allclose(layer.sigma_a_per_mm + added, other.medium.sigma_a_per_mm)
        np.testing.assert_allclose(layer.sigma_s_per_mm, other.medium.sigma_sp_per_mm)
    assert np.array_equal(found.to_rgb, reflectance_to_rgb())
    assert len(layers(maps, **skin | {"epidermis_mm": 0}).layers) == 1


def test_burley_s_medium_reflects_its_albedo():
    """Its single-scattering albedo is such that a half-space gives back about A of diffuse light."""
    albedo = np.array([0.3, 0.5, 0.8])
    found = medium(model="burley", mean_free_path_mm=[0.5, 0.7, 1.0], albedo_rgb=albedo.tolist())
    np.testing.assert_allclose(1 / found.sigma_t_per_mm, [0.5, 0.7, 1.0])
    np.testing.assert_allclose(half_space_diffuse_reflectance(found.albedo), albedo, rtol=0.04)


@pytest.mark.parametrize(
    ("skin", "reason"),
    [
        ({"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1, 1, 1]]}, "no medium"),
        ({"model": "multipole", "layers": [THIN, {**COEFFICIENTS, "eta": 1.3}]}, "indices of refraction 1.4, 1.3"),
        ({"model": "transport", "layers": [THIN]}, "nothing below"),
        ({"model": "burley", "d_mm": 0.7}, "without a medium"),
        ({**BURLEY, "mean_free_path": "surface"}, "on the surface"),
        ({"model": "dipole", "sigma_a_per_mm": 1e-4, "sigma_sp_per_mm": 1e-3}, "too clear"),
        ({"model": "dipole", "sigma_a_per_mm": 1.0, "sigma_sp_per_mm": [1.0, 0.0, 1.0]}, "too clear"),
    ],
)  # fmt: skip
def test_what_has_no_medium_is_refused_with_the_reason(skin, reason):
    """Nothing is guessed."""
    with pytest.raises(InputError, match=reason):
        medium(**skin)


@pytest.mark.parametrize(
    "bad",
    [
        {"sigma_a_per_mm": -1.0},
        {"sigma_s_per_mm": np.nan},
        {"g": 1.0},
        {"eta": 0.9},
        {"sigma_a_per_mm": 0, "sigma_s_per_mm": 0},
    ],
)
def test_a_medium_that_cannot_be_is_refused(bad):
    """Each field by its name."""
    with pytest.raises(ValueError, match=next(iter(bad))):
        TransportMedium(**{"sigma_a_per_mm": np.ones(3), "sigma_s_per_mm": np.ones(3)} | bad)
