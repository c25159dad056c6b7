import numpy as np
import pytest

from skinbake.profile import GaussianSum, evaluate
from skinbake.profile.better_dipole import BetterDipole
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import (
    BetterDipoleProfile,
    BurleyProfile,
    DipoleProfile,
    GaussianProfile,
    LayeredProfile,
)

MEDIUM = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
SUM = GaussianSum(np.array([0.1, 2.0]), np.array([[0.3, 0.2, 0.1], [0.2, 0.1, 0.0]]), np.zeros(3), np.ones(3))
PROFILES = [
    DipoleProfile(MEDIUM, 1.3),
    DipoleProfile(MEDIUM, 1.3, "exact"),
    BetterDipoleProfile(BetterDipole(MEDIUM, 1.3)),
    LayeredProfile((Layer(MEDIUM, 0.8, 1.4), Layer(MEDIUM, 0.3, 1.3))),
    BurleyProfile(np.array([0.2, 0.7, 1.5]), np.array([0.9, 0.5, 0.1])),
    GaussianProfile(SUM),
]


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: type(p).__name__)
def test_profile_integrates_to_its_total(profile):
    """2 pi int r R dr equals the total that the model states, in every channel; so it does for T less its delta."""
    r = np.geomspace(1e-6, 400, 700)

    def integral(values):
        return 2 * np.pi * np.trapezoid(values * r[:, None] ** 2, np.log(r), axis=0)

    np.testing.assert_allclose(integral(profile.reflectance(r)), profile.total_reflectance, rtol=1e-4)
    through = profile.total_transmittance - profile.sharp_transmittance
    np.testing.assert_allclose(integral(profile.transmittance(r)), through, rtol=1e-3, atol=1e-12)


def test_thick_layer_is_a_dipole():
    """One semi-infinite layer gives the dipole's R(r); so does a finite one that is thick enough."""
    r = np.array([0.0, 0.05, 1.0, 6.0])
    expected = DipoleProfile(MEDIUM, 1.3).reflectance(r)
    np.testing.assert_allclose(LayeredProfile((Layer(MEDIUM, np.inf, 1.3),)).reflectance(r), expected, rtol=1e-9)
    np.testing.assert_allclose(LayeredProfile((Layer(MEDIUM, 200.0, 1.3),)).reflectance(r), expected, rtol=1e-9)


def test_evaluate_gathers_everything():
    """One call holds R, T, totals, and no standard error for a model that is not statistical."""
    values = evaluate(PROFILES[3], [0.1, 1.0])
    assert values.reflectance_per_mm2.shape == values.transmittance_per_mm2.shape == (2, 3)
    assert values.stderr_per_mm2 is None
    assert (values.total_reflectance + values.total_transmittance < 1).all()


@pytest.mark.parametrize("radius", [[-1.0], [np.nan], [np.inf], [[1.0, 2.0]]])
def test_impossible_radii_are_refused(radius):
    """Negative, non-finite and two-dimensional radii are named."""
    with pytest.raises(ValueError, match="radius_mm"):
        PROFILES[0].reflectance(radius)
