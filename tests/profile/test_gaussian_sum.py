"""A sum of Gaussians has the values that are published of it."""

import numpy as np

from skinbake.numerics import gaussian_2d
from skinbake.profile import GaussianSum

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


def test_light_that_is_not_blurred_is_in_no_profile():
    """A Gaussian of variance 0 is light that leaves where it came in."""
    delta = GaussianSum(np.array([0.0, 1.0]), np.full((2, 3), 0.5), np.zeros(3), np.ones(3))
    np.testing.assert_array_equal(delta.evaluate(0.0)[0], 0.5 * gaussian_2d(1.0, 0.0))


def test_vectors(agrees):
    """Published values of section 4."""
    single = GaussianSum(np.array([0.567]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    agrees("gauss", single.evaluate([0, 1])[:, 0])
    agrees("sog_R", SKIN.evaluate(0.5)[0])
