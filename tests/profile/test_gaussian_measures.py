import numpy as np
import pytest
from scipy.integrate import quad

from skinbake.numerics import gaussian_2d
from skinbake.profile import GaussianSum
from skinbake.profile.gaussian_measures import light_within, line_spread, mean_radius_mm, noise_left, rms_radius_mm

SKIN = GaussianSum(
    np.array([0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41]),
    np.array(
        [
            [0.233, 0.455, 0.649],
            [0.100, 0.336, 0.344],
            [0.118, 0.198, 0],
            [0.113, 0.007, 0.007],
            [0.358, 0.004, 0],
            [0.078, 0, 0],
        ]
    ),
    np.zeros(3),
    np.ones(3),
)


def test_measures_are_integrals_of_the_profile():
    """Light inside a radius, mean and mean square radius equal quadrature of R(r)."""
    r = np.geomspace(1e-5, 60, 20000)
    values = SKIN.evaluate(r) * 2 * np.pi * r[:, None] ** 2  # per ln r

    def integral(f):
        return np.trapezoid(values * f[:, None], np.log(r), axis=0)

    np.testing.assert_allclose(mean_radius_mm(SKIN), integral(r), rtol=1e-6)
    np.testing.assert_allclose(rms_radius_mm(SKIN), np.sqrt(integral(r**2)), rtol=1e-6)
    inside = integral(np.where(r <= 1, 1.0, 0.0))
    np.testing.assert_allclose(light_within(SKIN, 1.0)[0], inside, rtol=1e-3)


def test_line_spread_is_the_profile_integrated_along_the_line():
    """The pre-integrated kernel is the integral of R over y."""
    x = 0.8
    direct = quad(lambda y: SKIN.evaluate(np.hypot(x, y))[0, 0], -40, 40, epsabs=1e-12, limit=400)[0]
    assert line_spread(SKIN, x)[0, 0] == pytest.approx(direct, rel=1e-8)


def test_delta_is_all_inside():
    """A Gaussian of variance 0 is light that leaves where it came in: inside any radius, in no R(r)."""
    delta = GaussianSum(np.array([0.0, 1.0]), np.full((2, 3), 0.5), np.zeros(3), np.ones(3))
    assert light_within(delta, 1e-9)[0, 0] == pytest.approx(0.5)
    np.testing.assert_array_equal(delta.evaluate(0.0)[0], 0.5 * gaussian_2d(1.0, 0.0))


def test_vectors(agrees):
    """Published values of sections 4 and 8."""
    single = GaussianSum(np.array([0.567]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    agrees("gauss", single.evaluate([0, 1])[:, 0])
    agrees("sog_R", SKIN.evaluate(0.5)[0])
    agrees("sog_cdf", light_within(SKIN, 1)[0])
    agrees("sog_radii", [mean_radius_mm(SKIN), rms_radius_mm(SKIN)])
    agrees("separable_1d", line_spread(SKIN, 1)[0])


def test_noise_left_is_that_of_blurred_noise():
    """White noise on a lattice of 0.5 mm, blurred by Gaussians of a texel and more: to 2 %; all of it where none is."""
    skin = GaussianSum(np.array([0.5, 4.0]), np.array([[0.8, 0.5, 0.1], [0.2, 0.3, 0.9]]), np.zeros(3), np.ones(3))
    k = np.fft.fftfreq(512, 0.5)
    squared = (2 * np.pi) ** 2 * (k[:, None] ** 2 + k[None, :] ** 2)
    kernel = np.exp(-squared[..., None] * skin.variance_mm2 / 2) @ skin.weight_rgb
    noise = np.fft.fft2(np.random.default_rng(1).normal(size=(512, 512)))
    blurred = np.fft.ifft2(noise[..., None] * kernel, axes=(0, 1)).real
    got = noise_left(skin, [4.0, 0.0])
    # A texel is a square, not a point: that counts as a variance of 1 / (2 pi) of a texel more
    np.testing.assert_allclose(got[0], np.sqrt((blurred**2).mean(axis=(0, 1))), rtol=0.05)
    np.testing.assert_allclose(got[1], skin.weight_rgb.sum(axis=0))
