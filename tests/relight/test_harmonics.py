"""Spherical harmonics against closed forms."""

import numpy as np
import pytest

from skinbake.irradiance.environment_map import direction_of
from skinbake.irradiance.sky_directions import all_around
from skinbake.relight.harmonics import harmonics, harmonics_of_sky, turned

QUADRATURE = 2e-3  # of 4096 directions spread evenly, for products of two harmonics of order 4
MIDDLE = 1e-3  # what the middle of a texel of 1.4 degrees is off its mean at order 6


def test_harmonics_are_orthonormal():
    """The mean product of two harmonics over the sphere is 1 / 4 pi for a harmonic with itself, and else 0."""
    y = harmonics(all_around(4096), 4)
    product = 4 * np.pi * (y.T @ y) / len(y)
    np.testing.assert_allclose(product, np.eye(25), atol=QUADRATURE)


def test_first_harmonics_are_the_axes():
    """Order 1 is y up, sin of the azimuth along x, cos along z."""
    towards = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    k = np.sqrt(3 / (4 * np.pi))
    np.testing.assert_allclose(harmonics(towards, 1)[:, 1:], [[k, 0, 0], [0, k, 0], [0, 0, k]], atol=1e-12)


def test_a_sky_of_one_texel_is_a_sun():
    """A sky with one bright texel has the harmonics of the direction that the texel shows."""
    sky = np.zeros((128, 256, 3), np.float32)
    sky[40, 70] = (3, 2, 1)
    solid = 2 * np.pi / 256 * (np.cos(np.pi * 40 / 128) - np.cos(np.pi * 41 / 128))
    towards = direction_of(np.array([70.5 / 256]), np.array([1 - 40.5 / 128]))
    expected = harmonics(towards, 6).T * np.array([3, 2, 1]) * solid
    np.testing.assert_allclose(harmonics_of_sky(sky, 6), expected, atol=MIDDLE * abs(expected).max())


def test_constant_sky_has_order_0_only():
    """A constant sky has its integral in order 0 and nothing above."""
    found = harmonics_of_sky(np.full((16, 32, 3), 2, np.float32), 4)
    np.testing.assert_allclose(found[0], 2 * np.sqrt(4 * np.pi), rtol=1e-6)
    assert abs(found[1:]).max() < 1e-3


@pytest.mark.parametrize("degrees", [37.0, -211.5])
def test_a_turn_is_that_of_the_direction(degrees):
    """Turned coefficients are those of the turned direction."""
    at = direction_of(np.array([0.3]), np.array([0.7]))
    there = direction_of(np.array([0.3]), np.array([0.7]), degrees)
    np.testing.assert_allclose(turned(harmonics(at, 5).T, degrees), harmonics(there, 5).T, atol=1e-12)


def test_whole_turns_change_no_bit():
    """360 degrees, or 720, give the very same numbers."""
    light = harmonics(all_around(7), 3).T
    assert (turned(light, 360) == light).all()
    assert (turned(light, -720) == turned(light, 0)).all()
