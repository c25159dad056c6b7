import numpy as np
import pytest

from skinbake.profile.better_dipole import BetterDipole
from skinbake.profile.dipole import albedo_of_total, dipole_reflectance, dipole_total
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium
from skinbake.profile.slab import half_space

A = boundary_factor(1.3)
SKIN1 = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
RADII = np.geomspace(1e-5, 300, 6000)


def plane_integral(values):
    return 2 * np.pi * np.trapezoid(values * RADII**2, np.log(RADII), axis=-1)


def test_profile_integrates_to_its_total():
    """2 pi int r R dr is the closed-form albedo, for the classic and the better dipole."""
    np.testing.assert_allclose(plane_integral(dipole_reflectance(SKIN1, A, RADII)), dipole_total(SKIN1, A), rtol=1e-6)
    better = BetterDipole(SKIN1, 1.3)
    np.testing.assert_allclose(
        plane_integral(better.reflectance(RADII)), better.hankel(np.zeros((1, 1)))[:, 0], rtol=1e-6
    )


def test_reflectance_near_one_keeps_its_difference():
    """1 - R_d follows the square root of absorption down to 1e-18, where subtraction gives 0."""
    absorbed = 1e-18
    m = Medium(np.array([absorbed]), np.array([1.0]))
    _, loss = half_space(m, A, np.zeros((1, 1)))
    x = np.sqrt(3 * absorbed)
    assert loss[0, 0] == pytest.approx(x * (1 + 2 * A / 3), rel=1e-8)


@pytest.mark.parametrize("total", [1e-6, 0.03, 0.5, 0.98, 1 - 1e-6])
def test_albedo_inverts_the_total(total):
    """The albedo found for a total gives that total back."""
    albedo = albedo_of_total(total, A)
    m = Medium(np.array([1 - albedo]), np.array([albedo]))
    assert dipole_total(m, A)[0] == pytest.approx(total, rel=1e-7)


@pytest.mark.parametrize("total", [0.0, 1.0, -0.1, float("nan")])
def test_impossible_totals_are_refused(total):
    """Totals outside (0, 1) have no albedo."""
    with pytest.raises(ValueError, match="inside"):
        albedo_of_total(total, A)


def test_better_dipole_survives_no_absorption():
    """Without absorption the better dipole's total is 1, not 0/0."""
    lossless = BetterDipole(Medium(np.zeros(1), np.ones(1)), 1.4)
    assert lossless.hankel(np.zeros((1, 1)))[0, 0] == pytest.approx(1, abs=1e-12)


def test_vectors(agrees):
    """Published values of section 2."""
    red = Medium(SKIN1.sigma_a_per_mm[:1], SKIN1.sigma_sp_per_mm[:1])
    agrees("dipole_R_skin1R", dipole_reflectance(red, A, np.array([0.0, 0.1, 1.0, 5.0, 20.0]))[0])
    agrees("dipole_Rd_skin1", dipole_total(SKIN1, A))
    agrees("alpha_of_Rd", albedo_of_total(0.5, A))
    better = BetterDipole(red, 1.3)
    agrees("better_skin1R", [better.reflectance(np.ones(1))[0, 0], better.hankel(np.zeros((1, 1)))[0, 0]])
