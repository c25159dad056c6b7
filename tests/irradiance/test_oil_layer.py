"""The oil layer's BRDF is the published one, reciprocal, and finite at every extreme."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.oil_brdf import beckmann, fresnel_dielectric, fresnel_schlick, kelemen_brdf

VECTORS = Path(__file__).parents[2].parent / "shared" / "test_vectors.json"
UP = np.array([0.0, 0.0, 1.0])


def direction(theta_deg, phi_deg=0.0):
    t, p = np.deg2rad(theta_deg), np.deg2rad(phi_deg)
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t) + 0 * p], -1)


def vector(name):
    if not VECTORS.exists():
        pytest.skip("the project's shared test vectors are not beside this checkout")
    return next(v for v in json.loads(VECTORS.read_text())["vectors"] if v["id"] == name)


def test_beckmann_equals_the_reference():
    want = vector("beckmann")
    np.testing.assert_allclose(beckmann(0.95, 0.3), want["expected"], rtol=want["rtol"])


def test_brdf_equals_the_reference():
    want = vector("ks_brdf")
    f = kelemen_brdf(UP, direction(40), direction(60, 120), 0.3, 1 / 36, 1.0)
    np.testing.assert_allclose([f, np.log(f)], want["expected"], rtol=want["rtol"])


def test_fresnel_equals_the_reference():
    want = vector("fresnel_vs_schlick")
    np.testing.assert_allclose(
        [fresnel_dielectric(0.2, 1.4), fresnel_schlick(0.2, 1 / 36)], want["expected"], rtol=want["rtol"]
    )


@pytest.mark.parametrize("m", [0.05, 0.3, 1.0])
def test_beckmann_integrates_to_pi_against_the_cosine(m):
    x, w = np.polynomial.legendre.leggauss(500)
    theta, w = (x + 1) * np.pi / 4, w * np.pi / 4
    integral = (2 * np.pi * w * beckmann(np.cos(theta), m) * np.cos(theta) * np.sin(theta)).sum()
    assert integral == pytest.approx(np.pi, rel=1e-9)


angle = st.floats(0, 90)
turn = st.floats(0, 360)


@given(angle, turn, angle, turn, st.floats(1e-4, 1), st.floats(0, 1))
def test_swapping_light_and_view_changes_nothing_and_the_value_is_finite(t1, p1, t2, p2, m, f0):
    light, view = direction(t1, p1), direction(t2, p2)
    f = kelemen_brdf(UP, light, view, m, f0)
    assert np.isfinite(f)
    assert f >= 0
    assert f == pytest.approx(kelemen_brdf(UP, view, light, m, f0), rel=1e-12)


@pytest.mark.parametrize("m", [1e-4, 3e-3, 0.3, 1.0])
def test_extremes_are_finite_and_not_negative(m):
    ulp_long = UP * (1 + 2.3e-16)  # V.H an ulp above 1
    side = direction(90.0)
    for light, view in [(UP, UP), (ulp_long, ulp_long), (side, -side), (UP, -UP), (side, side), (-UP, -UP)]:
        f = kelemen_brdf(UP, light, view, m)
        assert np.isfinite(f)
        assert f >= 0
    assert kelemen_brdf(UP, -UP, -UP, m) == 0  # N.H = -1
    assert kelemen_brdf(UP, side, -side, m) == 0  # L = -V
    np.testing.assert_allclose(beckmann([0.0, 1.0], m), [0.0, m**-2], rtol=1e-12)
    np.testing.assert_allclose(kelemen_brdf(UP, UP, UP, m, 0.028, 1.0), 0.028 / (4 * m**2), rtol=1e-12)


def test_float32_roughness_far_below_a_degree_keeps_its_digits():
    m, tilt = 1e-4, 1e-4  # radians: 1 - (N.H)^2 would have lost four digits here in float64, all of them in float32
    half = np.array([np.sin(tilt), 0, np.cos(tilt)])
    f = kelemen_brdf(UP, half, half, m, 0.028, 1.0)
    assert f == pytest.approx(0.028 / (4 * m**2) * np.exp(-((np.tan(tilt) / m) ** 2)) / np.cos(tilt) ** 4, rel=1e-12)
