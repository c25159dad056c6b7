"""The oil layer's albedo is the integral of its BRDF, and its table reads that within the error it states."""

import json
from pathlib import Path

import numpy as np
import pytest

from skinbake.irradiance.oil_albedo import (
    TABLE_ERROR,
    integrate_specular_albedo,
    mean_specular_albedo,
    oil_table,
    specular_albedo,
    specular_albedo_table,
    transmitted_share,
)
from skinbake.irradiance.oil_layer import ENERGY_TRUE_STRENGTH
from skinbake.scene.spec import SecondLobeSpec, SpecularSpec
from tests.oil_brdf import kelemen_brdf

VECTORS = Path(__file__).parents[2].parent / "shared" / "test_vectors.json"


@pytest.mark.parametrize(("c", "m"), [(1.0, 0.3), (0.7, 0.5), (0.31, 0.25), (0.1, 0.6)])
def test_albedo_is_the_hemisphere_integral_of_the_brdf(c, m):
    x, w = np.polynomial.legendre.leggauss(300)  # theory.md 6.4, a route without half vectors
    theta, w = (x[:, None] + 1) * np.pi / 4, w[:, None] * np.pi / 4
    phi = np.arange(256) * 2 * np.pi / 256
    light = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1)
    f = kelemen_brdf([0, 0, 1.0], light, [np.sqrt(1 - c * c), 0, c], m, 1 / 36, 1.0)
    brute = (f * np.cos(theta) * np.sin(theta) * w).sum() * 2 * np.pi / 256
    assert integrate_specular_albedo(c, m) @ [1 / 36, 1] == pytest.approx(brute, rel=1e-6)


@pytest.mark.parametrize("name", ["ks_albedo_1_0.3", "ks_albedo_0.5_0.3", "ks_albedo_0.1_0.3", "ks_albedo_0.3_0.6"])
def test_albedo_equals_the_reference(name):
    if not VECTORS.exists():
        pytest.skip("the project's shared test vectors are not beside this checkout")
    want = next(v for v in json.loads(VECTORS.read_text())["vectors"] if v["id"] == name)
    exact = integrate_specular_albedo(want["inputs"]["cos"], want["inputs"]["m"]) @ [1 / 36, 1]
    assert exact == pytest.approx(want["expected"], rel=want["rtol"])
    assert specular_albedo(want["inputs"]["cos"], want["inputs"]["m"]) == pytest.approx(exact, rel=TABLE_ERROR)


@pytest.mark.parametrize("m", [0.01, 0.1, 0.5, 1.0])
def test_white_albedo_at_normal_incidence_is_the_closed_form(m):
    closed = np.pi * (1 - m**2 * -np.expm1(-1 / m**2))
    assert integrate_specular_albedo(1.0, m).sum() == pytest.approx(closed, rel=1e-10)


@pytest.mark.parametrize(("least_m", "error"), [(0.05, TABLE_ERROR), (0.01, 2e-3), (1e-4, 0.12)])
def test_table_is_within_its_stated_error(least_m, error):
    rng = np.random.default_rng(7)
    c, m = rng.random(3000) ** 2, np.exp(rng.uniform(np.log(least_m), 0, 3000))
    exact = integrate_specular_albedo(c, m) @ [0.04, 1]
    np.testing.assert_allclose(specular_albedo(c, m, 0.04), exact, rtol=error)


def test_two_lobes_have_the_albedo_of_their_sum():
    """Read from one table; its mean too, and what passes."""
    oil = SpecularSpec(roughness=0.4, second=SecondLobeSpec(roughness=0.12, mix=0.3))
    table = oil_table(oil)
    rng = np.random.default_rng(7)
    c, m = rng.random(500) ** 2, rng.uniform(0.1, 1, 500)
    exact = 0.7 * integrate_specular_albedo(c, m) @ [0.04, 1] + 0.3 * integrate_specular_albedo(c, 0.12) @ [0.04, 1]
    np.testing.assert_allclose(specular_albedo(c, m, 0.04, table), exact, rtol=TABLE_ERROR)
    want = 0.7 * mean_specular_albedo(0.4) + 0.3 * mean_specular_albedo(0.12)
    assert mean_specular_albedo(0.4, table=table) == pytest.approx(want, rel=1e-9)
    assert oil_table(SpecularSpec()).tobytes() == specular_albedo_table().tobytes()


def test_energy_true_oil_never_returns_more_than_it_gets():
    c, m = np.meshgrid(np.linspace(0, 1, 201), np.geomspace(0.1, 1, 31))
    for f0 in (0.028, 1.0):
        albedo = specular_albedo(c, m, f0) * ENERGY_TRUE_STRENGTH
        assert albedo.min() > 0
        assert albedo.max() < 1


def test_transmitted_share_is_clamped_where_a_strong_oil_takes_more_than_all():
    assert transmitted_share(0.05, 0.2, 0.028, 1.0) == 0.0  # A = 1.226 there
    assert transmitted_share(1.0, 0.3, 1 / 36, 1.0) == pytest.approx(1 - 0.07942, abs=1e-4)
    assert transmitted_share([[-0.3, 1.7]], 0.3).shape == (1, 2)


def test_mean_albedo_equals_the_published_row():
    np.testing.assert_allclose(
        mean_specular_albedo([0.1, 0.3, 0.6, 1.0]), [0.20463, 0.14789, 0.09998, 0.06682], atol=2e-5
    )
