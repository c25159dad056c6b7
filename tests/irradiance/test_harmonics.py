"""Nine numbers a channel give the irradiance of a smooth sky, and exactly what theory says of any other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.irradiance.environment_map import direction_of
from skinbake.irradiance.harmonics import harmonic_matrix, light_by_harmonics

RNG = np.random.default_rng(0)
NORMAL = RNG.normal(size=(1, 40, 3)).astype(np.float32)
NORMAL /= np.linalg.norm(NORMAL, axis=-1, keepdims=True)


def lit(radiance, rotate_deg=0.0):
    out = np.zeros(NORMAL.shape, np.float32)
    light_by_harmonics(
        0, len(out), harmonic_matrix(radiance, rotate_deg), NORMAL, np.ones(NORMAL.shape[:2], np.bool_), out
    )
    return out[0]


def summed(radiance, kernel, rotate_deg=0.0, fine=100):
    """Sum over a hundred times finer sky, texel by texel, of radiance times `kernel` of the cosine."""
    radiance = np.repeat(np.repeat(radiance, fine, 0), fine, 1).astype(float)
    height, width = radiance.shape[:2]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2 * np.pi / width) * (edges[:-1] - edges[1:])
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    cosine = NORMAL[0].astype(float) @ direction_of(u, v, rotate_deg).reshape(-1, 3).T
    return kernel(cosine) @ (radiance * solid[:, None, None]).reshape(-1, 3)


@settings(max_examples=5, deadline=None)
@given(st.integers(1, 7), st.integers(1, 9), st.floats(-200, 200), st.integers(0, 99))
def test_the_matrix_is_the_integral_of_the_truncated_cosine(height, width, rotate_deg, seed):
    """Any sky, any turn: E(n) is the sum over the sky of 3/32 + c/2 + 15/32 c^2, computed apart, to 1e-4."""
    radiance = np.random.default_rng(seed).random((height, width, 3)).astype(np.float32)
    expected = summed(radiance, lambda c: 3 / 32 + c / 2 + 15 / 32 * c * c, rotate_deg)
    np.testing.assert_allclose(lit(radiance, rotate_deg), np.maximum(expected, 0), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (8, 16)])
def test_a_constant_sky_gives_pi(shape):
    """Radiance 1 from everywhere is E = pi for every normal, to float32."""
    np.testing.assert_allclose(lit(np.ones((*shape, 3), np.float32)), np.pi, rtol=1e-6)


def test_a_sky_that_changes_linearly_is_exact():
    """Radiance 1 + y over a fine sky: E = pi + 2 pi / 3 n_y, the clamped cosine's own answer."""
    y = np.cos(np.pi * (np.arange(400) + 0.5) / 400)
    radiance = np.broadcast_to((1 + y)[:, None, None], (400, 4, 3)).astype(np.float32)
    expected = np.pi + 2 * np.pi / 3 * NORMAL[0, :, 1]
    np.testing.assert_allclose(lit(radiance), np.broadcast_to(expected[:, None], (40, 3)), rtol=1e-5)


def test_a_small_sun_is_known_to_a_tenth():
    """The worst sky for order 2, one small bright texel: never below 0, and off by less than 10 % of its peak."""
    radiance = np.zeros((16, 32, 3), np.float32)
    radiance[4, 9] = 100
    exact, ours = summed(radiance, lambda c: np.maximum(c, 0), fine=30), lit(radiance)
    assert ours.min() >= 0
    peak = 100 * 2 * np.pi / 32 * (np.cos(np.pi * 4 / 16) - np.cos(np.pi * 5 / 16))
    assert 0.02 < np.abs(ours - exact).max() / peak < 0.1
