"""Profiles know no unit, give no light away, and grow darker as more is absorbed, for any medium."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.profile import fit_report
from skinbake.profile.better_dipole import BetterDipole
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import BetterDipoleProfile, BurleyProfile, DipoleProfile, LayeredProfile
from skinbake.scene.skin import FitSpec

coefficients = st.floats(-6, 3).map(lambda exponent: 10.0**exponent)
scales = st.sampled_from([1e-3, 0.1, 10.0, 25.4, 1e3])
indices = st.floats(1.0, 2.0)


def models(a, s, eta, unit=1.0):
    """Profiles of one medium in each model; `unit` is how many of the new unit make an old one."""
    medium = Medium(np.full(3, a) / unit, np.full(3, s) / unit)
    return {
        "dipole": DipoleProfile(medium, eta, "exact"),
        "better": BetterDipoleProfile(BetterDipole(medium, eta)),
        "slab": LayeredProfile((Layer(medium, 0.3 * unit, eta),)),
        "layers": LayeredProfile((Layer(medium, 0.3 * unit, eta), Layer(medium, np.inf, 1.3))),
        "burley": BurleyProfile(np.full(3, unit / (a + s)), np.full(3, s / (a + s))),
    }


@pytest.mark.parametrize("name", ["dipole", "better", "slab", "layers", "burley"])
@settings(max_examples=20, deadline=None)
@given(a=coefficients, s=coefficients, eta=indices, unit=scales)
def test_no_unit(name, a, s, eta, unit):
    """Lengths in another unit: the same totals, R(r) as much per new area; to 1e-6, float64 against itself."""
    here, there = models(a, s, eta)[name], models(a, s, eta, unit)[name]
    np.testing.assert_allclose(there.total_reflectance, here.total_reflectance, rtol=1e-6, atol=1e-12)
    radius = np.array([0.1, 1.0, 3.0]) / (a + s)
    near, far = here.reflectance(radius), there.reflectance(radius * unit) * unit**2
    assert np.abs(far - near).max() <= 1e-5 * np.abs(near).max() + 1e-30


@pytest.mark.parametrize("name", ["dipole", "better", "slab", "layers"])
@settings(max_examples=25, deadline=None)
@given(a=coefficients, s=coefficients, eta=indices, more=st.floats(1.01, 100))
def test_more_absorption_is_darker(name, a, s, eta, more):
    """Totals lie in 0 ... 1 and do not rise with sigma_a."""
    light, dark = models(a, s, eta)[name].total_reflectance, models(a * more, s, eta)[name].total_reflectance
    assert (light <= 1 + 1e-12).all()
    assert (dark >= 0).all()
    assert (dark <= light * (1 + 1e-9) + 1e-15).all()


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(a=st.floats(0.001, 1), s=st.floats(0.3, 10), unit=scales)
def test_fits_know_no_unit(a, s, unit):
    """Variances scale with the square of the unit, weights and errors not at all."""
    here = fit_report(models(a, s, 1.3)["dipole"], FitSpec(gaussians=4), "none").gaussians
    there = fit_report(models(a, s, 1.3, unit)["dipole"], FitSpec(gaussians=4), "none").gaussians
    np.testing.assert_allclose(there.relative_error_rgb, here.relative_error_rgb, rtol=0.02)
    np.testing.assert_allclose(there.variance_mm2 / unit**2, here.variance_mm2, rtol=0.05)
    np.testing.assert_allclose(there.weight_rgb.sum(axis=0), here.weight_rgb.sum(axis=0), rtol=1e-9)
