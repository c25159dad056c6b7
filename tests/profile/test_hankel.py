import numpy as np
import pytest

from skinbake.profile.hankel import inverse_hankel
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import LayeredProfile

RADII = np.array([0.0, 1e-6, 0.1, 1.0, 8.0, 60.0, 400.0])


@pytest.mark.parametrize("sigma_tr", [0.0, 0.3, 2.0])
def test_exponential_pair(sigma_tr):
    """exp(-g z) comes back as z (1 + sigma_tr D) exp(-sigma_tr D) / (2 pi D^3), near and far, to 9 digits."""
    z = 0.7
    found = inverse_hankel(lambda s: np.exp(-z * np.sqrt(sigma_tr**2 + s * s)), RADII, np.array([sigma_tr]), z, z)
    distance = np.hypot(RADII, z)
    expected = z * (1 + sigma_tr * distance) * np.exp(-sigma_tr * distance) / (2 * np.pi * distance**3)
    np.testing.assert_allclose(found[0], expected, rtol=1e-9)


def test_beyond_underflow_is_zero():
    """Where exp(-sigma_tr r) is below the smallest float the result is 0, without warnings."""
    found = inverse_hankel(lambda s: np.exp(-np.sqrt(4 + s * s)), np.array([1e4]), np.array([2.0]), 1.0, 1.0)
    assert found[0, 0] == 0


def test_layers_come_back_with_their_light(three_layer_skin):
    """2 pi int r R dr of three layers is their total, and R is nowhere negative."""
    r = np.geomspace(1e-4, 300, 600)
    values = three_layer_skin.reflectance(r)
    assert (values >= 0).all()
    total = 2 * np.pi * np.trapezoid(values * r[:, None] ** 2, np.log(r), axis=0)
    np.testing.assert_allclose(total, three_layer_skin.total_reflectance, rtol=1e-4)


def test_vectors(agrees, three_layers):
    """Published R(r) and T(r) of a slab and of three layers."""
    medium = Medium(np.array([0.01]), np.array([1.0]))
    one = LayeredProfile((Layer(medium, 1.0, 1.4),), to_rgb=np.ones((3, 1)))
    r = [0.1, 1, 3]
    agrees("slab_space", [one.reflectance(r)[:, 0], one.transmittance(r)[:, 0]])
    r = [0.2, 0.5, 2]
    agrees("skin3_R_red_guarded", LayeredProfile(three_layers).reflectance(r)[:, 0])
    agrees("skin3_R_red", LayeredProfile(three_layers, thin_layers="continued").reflectance(r)[:, 0])
