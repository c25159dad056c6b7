"""The shape of the profile of light from everywhere, against photons, and what it makes of Gaussians' weights."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.special import j1

from skinbake.profile import GaussianSum, fit_skin
from skinbake.profile.diffuse_shape import LEAST, MOST, diffuse_factors, least_squares_within, shape_ratio
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.transport import trace_layers
from skinbake.scene.skin import DipoleSkin

SKIN1 = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
PHOTONS = 200_000


def layer(eta):
    return Layer(SKIN1, np.inf, eta)


def transform(profile, s):
    """R~ over the total, and its standard error, (M, 3), from light by annulus."""
    edge = profile.edge_mm[:-1]
    a, b, x = edge[:-1], edge[1:], s[:, None]
    mean = 2 * (b * j1(x * b) - a * j1(x * a)) / (x * (b * b - a * a))
    total = profile.total[0]
    return mean @ profile.light[0][:-1] / total, np.sqrt(mean**2 @ profile.light_stderr[0][:-1] ** 2) / total


@pytest.mark.parametrize(("eta", "within", "least"), [(1.0, 0.025, 0.6), (1.4, 0.04, 0.4)])
def test_the_ratio_is_that_of_photons(eta, within, least):
    """Less sharp detail, by 3 to 15 %; without an interface more of red in between, for it goes less far."""
    s = np.array([0.1, 0.3, 0.9, 2.5, 5.0, 10.0])
    (everywhere, e), (normal, n) = (
        transform(trace_layers([layer(eta)], PHOTONS, seed, incidence=incidence), s)
        for seed, incidence in enumerate(("diffuse", "perpendicular"))
    )
    walked = everywhere / normal
    error = walked * np.hypot(e / everywhere, n / normal)
    found = shape_ratio(layer(eta), s)
    assert (np.abs(found - walked) < within + 3 * error).all()
    # Nearer than no change where there is one
    sharp = s >= 2.5
    assert (walked[sharp] < 0.98).all()
    assert (1 - found[sharp] > least * (1 - walked[sharp]) - 3 * error[sharp]).all()
    if eta == 1:
        assert (found[1, 0] > 1.005) & (walked[1, 0] > 1.005)


def test_it_is_one_of_the_total_and_of_light_that_is_bent_to_the_normal():
    """At frequency 0 by definition; in a dense medium all light goes down."""
    np.testing.assert_allclose(shape_ratio(layer(1.4), np.array([0.0, 1e-5])), 1, atol=1e-8)
    few, many = (np.abs(shape_ratio(layer(eta), np.array([2.0])) - 1).max() for eta in (3.0, 1.0))
    assert few < 0.3 * many


def profile(weight, variance=(0.05, 0.5, 4.0)):
    weight = np.asarray(weight, np.float64)
    return GaussianSum(np.array(variance), weight, np.zeros(3), weight.sum(axis=0))


WEIGHT = [[0.0, 0.02, 0.06], [0.2, 0.12, 0.1], [0.3, 0.15, 0.0]]


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_factors_keep_the_total_and_come_near(eta):
    """Of each channel, exactly; bounded, and weights of 0 stay. Six Gaussians take nearly all of the ratio."""
    coefficients = {"sigma_a_per_mm": SKIN1.sigma_a_per_mm, "sigma_sp_per_mm": SKIN1.sigma_sp_per_mm, "eta": eta}
    gaussians = fit_skin(DipoleSkin(model="dipole", normalise="none", **coefficients)).gaussians
    factor = diffuse_factors(gaussians, layer(eta))
    own = gaussians.weight_rgb * factor
    np.testing.assert_allclose(own.sum(axis=0), gaussians.weight_rgb.sum(axis=0), rtol=1e-12)
    assert ((factor > LEAST - 1e-6) & (factor < MOST + 1e-6)).all()
    assert (factor[gaussians.weight_rgb == 0] == 1).all()
    assert (np.abs(factor - 1) > 1e-3).any(axis=0).all()
    s = np.array([0.1, 0.3, 1.0, 3.0])
    blurred = np.exp(-0.5 * s[:, None] ** 2 * gaussians.variance_mm2)
    wanted = (blurred @ gaussians.weight_rgb) * shape_ratio(layer(eta), s)
    assert np.abs(blurred @ own - wanted).max() < 0.15 * np.abs(blurred @ gaussians.weight_rgb - wanted).max()


def test_what_has_no_shape_is_left():
    """One Gaussian, and light that does not scatter."""
    assert (diffuse_factors(profile([[0.4, 0.3, 0.2]], [1.0]), layer(1.4)) == 1).all()
    assert (diffuse_factors(profile([[0.4, 0.3, 0.2]], [0.0]), layer(1.4)) == 1).all()
    part = diffuse_factors(profile([[0.1, 0.1, 0.1], *WEIGHT], [0.0, 0.05, 0.5, 4.0]), layer(1.4))
    assert (part[0] == 1).all()
    np.testing.assert_allclose(part[1:], diffuse_factors(profile(WEIGHT), layer(1.4)))


def test_bounds_are_kept_where_they_are_met():
    """Else it is the plain solution: that of scipy, which loads slowly, either way."""
    rng = np.random.default_rng(2)
    rows, wanted = rng.normal(size=(9, 4)), rng.normal(size=9)
    free = np.linalg.lstsq(rows, wanted)[0]
    for most in (2 * np.abs(free).max(), 0.5 * np.abs(free).max()):
        found = least_squares_within(rows, wanted, -most, most)
        np.testing.assert_allclose(found, lsq_linear(rows, wanted, (-most, most)).x, rtol=1e-12)
        assert np.abs(found).max() <= most
    assert np.abs(found - free).max() > 0.1 * most  # the bounds were met
