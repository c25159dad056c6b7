"""Factors for light that enters at a slant."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import light_texels
from skinbake.irradiance.normal_map import shading_normals
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.slant import Slant, apply_slant, decide_incidence, slant_of, slant_of_sky, slant_rms
from skinbake.profile.incidence import Incidence, reflect_slanted
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, RectangleLight
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad

COSINE = np.linspace(0, 1, 5)
SLANT = Slant(np.stack([1 + COSINE, 2 - COSINE, 0 * COSINE + 3], axis=1), np.array([0.5, 1.5, 2.5]))


def lit(light, slant=None, height=0.0, sky=None):
    """Irradiance of a square at the middle texel, with and without the factors."""
    mesh, maps = quad(20.0, 20.0, height), SkinMaps({}, {}, {}, {})
    (raster,) = atlas = rasterize(mesh, (9, 9), 0)
    rgb = light_texels(atlas, mesh, maps, [light])[0].rgb[0]
    if slant is not None:
        apply_slant(raster, shading_normals(raster, mesh, maps)[1], Occluder(mesh), light, slant, sky, rgb)
    return rgb[4, 4].astype(float)


@pytest.mark.parametrize("mu", [1.0, 0.6, 0.1])
def test_lamps_are_multiplied_by_the_factor_at_their_cosine(mu):
    """A sun, and a point and a rectangle a long way off in its direction: 1 + mu, 2 - mu and 3 times as much."""
    away = np.array([np.sqrt(1 - mu * mu), 0.0, mu])
    sun = DirectionalLight(type="directional", name="s", direction=tuple(-away), irradiance=(1.0, 1.0, 1.0))
    lamp = PointLight(type="point", name="p", position_mm=tuple(1e5 * away), intensity=(1e10, 1e10, 1e10))
    panel = RectangleLight(
        type="rectangle", name="r", position_mm=tuple(1e5 * away), edge_u_mm=(0.0, 50.0, 0.0),
        edge_v_mm=tuple(50 * np.cross(away, [0.0, 1.0, 0.0]) * -1), radiance=(1e7, 1e7, 1e7),
    )  # fmt: skip
    for light in (sun, lamp, panel):
        plain = lit(light)
        assert plain.min() > 0
        np.testing.assert_allclose(lit(light, SLANT) / plain, [1 + mu, 2 - mu, 3], rtol=1e-3)


def test_a_sky_has_the_factor_of_light_from_everywhere():
    """Channel by channel."""
    sky = EnvironmentLight(type="environment", name="k", radiance=(1.0, 1.0, 1.0))
    np.testing.assert_allclose(lit(sky, SLANT) / lit(sky), SLANT.diffuse_rgb, rtol=1e-6)


def test_a_plane_then_reflects_what_transport_says():
    """Profile's total times factor is R(mu), whatever total the profile has."""
    layers = [Layer(Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01])), np.inf, 1.0)]
    incidence = reflect_slanted(layers)
    total = np.array([0.4, 0.2, 0.1])
    slant = slant_of(incidence, total)
    np.testing.assert_allclose(slant.factor_rgb * total, incidence.reflectance_rgb)
    np.testing.assert_allclose(slant.diffuse_rgb * total, incidence.diffuse_rgb)
    dark = slant_of(incidence, np.array([0.4, 0.0, 0.1]))
    assert np.isfinite(dark.factor_rgb).all()


def test_the_deciding_number_is_the_error_on_a_ball():
    """Against a Monte Carlo of normals; a constant factor of 1 is worth nothing."""
    rng = np.random.default_rng(1)
    cosine = rng.uniform(0, 1, 200_000)
    off = np.stack([cosine, 1 - cosine, 0 * cosine + 2], axis=1)  # SLANT's factors less 1
    want = np.sqrt(((off * cosine[:, None]) ** 2).mean(axis=0) / (cosine**2).mean())
    fine = np.linspace(0, 1, 2001)
    slant = Slant(np.stack([1 + fine, 2 - fine, 0 * fine + 3], axis=1), np.ones(3))
    sun = DirectionalLight(type="directional", name="s", direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0))
    assert abs(slant_rms(slant, sun) - np.sqrt((want**2).mean())) < 0.01
    sky = EnvironmentLight(type="environment", name="k", radiance=(1.0, 1.0, 1.0))
    assert slant_rms(slant, sky) == 0
    same = slant_of(Incidence(COSINE, np.full((5, 3), 0.3), np.full(3, 0.3)), np.full(3, 0.3))
    assert max(slant_rms(same, sun), slant_rms(same, sky)) < 1e-12
    plain = decide_incidence(sun, same, None, "auto", 0.01)
    assert (plain.term, plain.enabled) == ("s.incidence", False)
    assert decide_incidence(sun, same, None, "on", 0.01).enabled
    kept = decide_incidence(sun, slant, None, "auto", 0.01)
    assert kept.enabled
    assert f"{slant_rms(slant, sun):.2%}" in kept.why


def test_a_sky_with_a_sun_has_the_factors_of_its_directions():
    """A small bright patch counts as a sun there; the same radiance everywhere as light from everywhere."""
    fine = np.linspace(0, 1, 65)
    slant = slant_of(Incidence(fine, np.stack([1 + fine, 2 - fine, fine**2], axis=1), np.array([5 / 3, 4 / 3, 0.5])),
                     np.ones(3))  # fmt: skip
    light = EnvironmentLight(type="environment", name="k", radiance=(1.0, 1.0, 1.0))
    even = slant_of_sky(slant, np.ones((32, 64, 3), np.float32), 0.0)
    np.testing.assert_allclose(lit(light, slant, sky=even) / lit(light), slant.diffuse_rgb, rtol=0.02)
    np.testing.assert_allclose(slant_rms(slant, light, even), slant_rms(slant, light), rtol=0.05)
    image = np.zeros((64, 128, 3), np.float32)
    image[21:23, 63:65] = 1  # 61.9 degrees from the zenith, towards +z: 28.1 degrees off the square's normal
    mu = np.cos(np.radians(90 - 61.9))
    sun = slant_of_sky(slant, image, 0.0)
    np.testing.assert_allclose(lit(light, slant, sky=sun) / lit(light), [1 + mu, 2 - mu, mu**2], rtol=0.02)
    assert sun.rms == pytest.approx(np.sqrt(np.mean([0.55, 0.09, 0.26])), rel=0.2)


@pytest.mark.parametrize("middle_mm", [(0.0, 0.0, 60.0), (160.0, 0.0, 40.0)])
def test_a_rectangle_has_the_mean_of_its_pieces(middle_mm):
    """Wide and near, above the skin or beside it and half of it below the horizon, by its radiance's own mean."""
    beside = middle_mm[0] > 0
    edges = ((0.0, 0.0, 160.0), (0.0, 200.0, 0.0)) if beside else ((100.0, 0.0, 0.0), (0.0, -100.0, 0.0))
    panel = RectangleLight(
        type="rectangle", name="r", position_mm=middle_mm, edge_u_mm=edges[0], edge_v_mm=edges[1],
        radiance=(1.0, 1.0, 1.0),
    )  # fmt: skip
    place = (np.arange(400) + 0.5) / 400 - 0.5
    u, v = np.meshgrid(place, place)
    to_light = np.asarray(middle_mm) + u[..., None] * edges[0] + v[..., None] * edges[1]
    distance = np.linalg.norm(to_light, axis=-1)
    mu = np.maximum(to_light[..., 2] / distance, 0)
    weight = mu * to_light[..., 0 if beside else 2] / distance**3
    mean = float((mu * weight).sum() / weight.sum())
    np.testing.assert_allclose(lit(panel, SLANT) / lit(panel), [1 + mean, 2 - mean, 3], rtol=0.02)
