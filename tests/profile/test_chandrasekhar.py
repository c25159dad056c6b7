"""Closed form of the half-space."""

import numpy as np
import pytest

from skinbake.profile.chandrasekhar import chandrasekhar_h, half_space_diffuse_reflectance, half_space_reflectance


@pytest.mark.parametrize("albedo", [0.1, 0.6779, 0.9586, 0.9999])
def test_h_solves_its_integral_equation(albedo):
    """1 / H = sqrt(1 - a) + a/2 int mu' H(mu') / (mu + mu') dmu', at cosines from grazing to straight down."""
    node, weight = np.polynomial.legendre.leggauss(200)
    # Squared, for H rises like mu ln mu near 0
    x, weight = ((node + 1) / 2) ** 2, weight * (node + 1) / 2
    mu = np.array([0.01, 0.1, 0.5, 1.0])
    integral = (x * chandrasekhar_h(x, albedo) / (mu[:, None] + x) * weight).sum(axis=1)
    assert np.abs(1 / chandrasekhar_h(mu, albedo) - np.sqrt(1 - albedo) - albedo / 2 * integral).max() < 1e-7


def test_totals_of_skin_are_those_of_the_literature_table():
    """R(mu) of the red, green and blue of jensen-skin1 at equal indices, and of light from everywhere."""
    albedo = np.array([0.74 / 0.772, 0.88 / 1.05, 1.01 / 1.49])
    want = {1.0: [0.5657, 0.3253, 0.1954], 0.5: [0.6542, 0.4127, 0.2619], 0.1: [0.7557, 0.5372, 0.3712]}
    for mu, row in want.items():
        np.testing.assert_allclose(half_space_reflectance(mu, albedo), row, atol=6e-5)
    np.testing.assert_allclose(half_space_diffuse_reflectance(albedo), [0.6253, 0.3849, 0.2413], atol=6e-5)


def test_h_is_one_where_nothing_scatters_and_at_grazing():
    """H(mu, 0) = H(0, albedo) = 1, exactly."""
    assert (chandrasekhar_h([0.0, 0.3, 1.0], 0.0) == 1).all()
    assert chandrasekhar_h(0.0, 0.9) == 1


def test_an_albedo_of_one_is_refused():
    """The logarithm has no limit there that this quadrature would find."""
    with pytest.raises(ValueError, match="albedo"):
        chandrasekhar_h(0.5, 1.0)
