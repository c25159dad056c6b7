"""Models at the ends of their range: finite, energy inside [0, 1], R + T <= 1, = 1 where nothing absorbs."""

import itertools
import warnings

import numpy as np
import pytest

from skinbake.profile import fit_report
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import BurleyProfile, DipoleProfile, LayeredProfile
from skinbake.profile.transport import trace_layers
from skinbake.scene.skin import FitSpec

RADII = [0.0, 1e-6, 0.1, 1.0, 1e4]
ETAS = [1.0, 1.0001, 1.4, 2.0]
THICKNESSES = [0.0, 1e-4, 0.2, 1e4, np.inf]
# sigma_a, sigma_sp per mm; named by what is extreme
MEDIA = {
    "no absorption": (0.0, 1.0),
    "hardly scatters": (0.1, 1e-6),
    "nothing but faint scattering": (0.0, 1e-6),
    "scatters strongly": (0.1, 1e4),
    "strong and lossless": (0.0, 1e4),
    "albedo 1e-6": (1.0, 1e-6),
    "albedo 1 - 1e-12": (1e-12, 1.0),
    "hardly anything": (1e-8, 1e-8),
    "black": (1e3, 1e-3),
}


def medium(name):
    a, s = MEDIA[name]
    return Medium(np.full(3, a), np.full(3, s))


def sane(profile, lossless):
    """The invariants, with every warning an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for values in (profile.reflectance(RADII), profile.transmittance(RADII)):
            assert np.isfinite(values).all()
            assert (values >= 0).all()
        r, t = profile.total_reflectance, profile.total_transmittance
        assert ((r >= 0) & (t >= 0) & (r + t <= 1 + 1e-12)).all()
        if lossless:
            np.testing.assert_allclose(r + t, 1, rtol=1e-9)


@pytest.mark.parametrize(("name", "eta"), list(itertools.product(MEDIA, ETAS)))
def test_dipole(name, eta):
    """Semi-infinite media of every extreme, by both boundary factors."""
    for boundary in ("polynomial", "exact"):
        sane(DipoleProfile(medium(name), eta, boundary), MEDIA[name][0] == 0)


@pytest.mark.parametrize(("name", "thickness"), list(itertools.product(MEDIA, THICKNESSES[1:])))
@pytest.mark.parametrize("eta", [1.0, 1.0001, 2.0])
def test_one_layer(name, thickness, eta):
    """A layer of every extreme, from 1e-4 mm to semi-infinite."""
    sane(LayeredProfile((Layer(medium(name), thickness, eta),)), MEDIA[name][0] == 0)


@pytest.mark.parametrize(("upper", "lower"), list(itertools.product(MEDIA, MEDIA)))
def test_two_layers(upper, lower):
    """Every extreme above every other, the upper one of every thickness, the indices unequal."""
    lossless = MEDIA[upper][0] == MEDIA[lower][0] == 0
    for thickness in THICKNESSES[:-1]:
        stack = Layer(medium(upper), thickness, 1.4), Layer(medium(lower), np.inf, 1.0001)
        sane(LayeredProfile(stack), lossless or (thickness == 0 and MEDIA[lower][0] == 0))


@pytest.mark.parametrize("name", MEDIA)
@pytest.mark.parametrize("thickness", [1e-4, 1.0, np.inf])
def test_fit(name, thickness):
    """A fit of every extreme is finite, non-negative, and keeps the energy."""
    profile = LayeredProfile((Layer(medium(name), thickness, 1.4),))
    found = fit_report(profile, FitSpec(gaussians=4), "none").gaussians
    assert (found.weight_rgb >= 0).all()
    np.testing.assert_allclose(found.weight_rgb.sum(axis=0), profile.total_reflectance, rtol=1e-9)
    assert (found.relative_error_rgb < 0.2).all()


@pytest.mark.parametrize("d", [1e-6, 1e6])
def test_burley(d):
    """Shape lengths of a nanometre and a kilometre."""
    profile = BurleyProfile(np.full(3, d), np.array([0.0, 1e-6, 1.0]))
    values = profile.reflectance([0.0, d, 1e4])
    assert np.isfinite(values).all()
    assert fit_report(profile, FitSpec(gaussians=3), "none").relative_error_rgb.max() < 0.2


@pytest.mark.parametrize("name", ["hardly scatters", "scatters strongly", "albedo 1e-6", "black"])
def test_transport(name):
    """Monte Carlo of the extremes ends, and gives no light away."""
    for thickness, eta in ((1e-4, 2.0), (1.0, 1.0), (np.inf, 1.0001)):
        sane(trace_layers((Layer(medium(name), thickness, eta),), 300), lossless=False)
