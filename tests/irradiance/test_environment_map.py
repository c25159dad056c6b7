"""Light of a sky on every normal, exact for suns; directions drawn in proportion to what comes from them."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import light_texels
from skinbake.irradiance.environment_map import SkySamples, cosine_irradiance, direction_of, irradiance_table, look_up
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad

SHAPE = (256, 512)


def texel_vectors(shape, rotate_deg=0.0):
    """Integral of the direction over the solid angle of each texel, by 8 x 8 points, (h, w, 3)."""
    height, width = shape
    at = (np.arange(8) + 0.5) / 8
    v = 1 - (np.arange(height)[:, None] + at).ravel() / height
    u = (np.arange(width)[:, None] + at).ravel() / width
    solid = np.sin(np.pi * (1 - v)) * (np.pi / height / 8) * (2 * np.pi / width / 8)
    vectors = direction_of(*np.meshgrid(u, v), rotate_deg) * solid[:, None, None]
    return vectors.reshape(height, 8, width, 8, 3).sum(axis=(1, 3))


def sun(row, col, shape=SHAPE, sky=0.0):
    """A sky of one radiance with a sun of one texel, irradiance 1 on a plane that faces it."""
    radiance = np.full((*shape, 3), sky, np.float32)
    height, width = shape
    solid = 2 * np.pi / width * (np.cos(np.pi * row / height) - np.cos(np.pi * (row + 1) / height))
    radiance[row, col] += np.float32(1 / solid)
    return radiance


@pytest.mark.parametrize("sky", [0.0, 0.05])
@pytest.mark.parametrize("angle", [0, 30, 60, 75, 80, 85])
def test_a_sun_stays_where_it_is(angle, sky):
    """One texel, on planes that it meets at 0 to 85 degrees: to .1 % of the exact integral, to .4 % from the table."""
    rng = np.random.default_rng(angle)
    for _ in range(2):
        row, col = int(rng.integers(20, SHAPE[0] - 20)), int(rng.integers(SHAPE[1]))
        radiance = sun(row, col, SHAPE, sky)
        towards = direction_of(np.array((col + 0.5) / SHAPE[1]), np.array(1 - (row + 0.5) / SHAPE[0]))
        aside = np.cross(towards, rng.normal(size=3))
        normal = np.cos(np.radians(angle)) * towards + np.sin(np.radians(angle)) * aside / np.linalg.norm(aside)
        exact = np.cos(np.radians(angle)) + np.pi * sky
        found = cosine_irradiance(radiance, 0.0, normal[None])[0]
        np.testing.assert_allclose(found, exact, rtol=1e-3)
        table = irradiance_table(radiance)
        out = np.zeros((1, 1, 3), np.float32)
        look_up(0, 1, table, normal[None, None].astype(np.float32), np.ones((1, 1), bool), out)
        np.testing.assert_allclose(out[0, 0], exact, rtol=4e-3)


@pytest.mark.parametrize("shape", [(5, 9), (64, 128), (70, 141), (200, 400)])
def test_any_sky_against_the_sum_over_its_texels(shape):
    """Noise of any size, turned: within 2 % where blocks straddle the horizon, a constant exactly pi."""
    rng = np.random.default_rng(1)
    radiance = rng.random((*shape, 3), dtype=np.float32)
    normal = rng.normal(size=(20, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    fine = np.repeat(np.repeat(radiance, 8, axis=0), 8, axis=1) if shape[0] < 64 else radiance
    vectors = texel_vectors(fine.shape[:2], 40.0)
    exact = np.einsum("nij,ijc->nc", np.maximum(np.einsum("ni,hwi->nhw", normal, vectors), 0), fine)
    np.testing.assert_allclose(cosine_irradiance(radiance, 40.0, normal), exact, rtol=0.02)
    flat = cosine_irradiance(np.ones((*shape, 3), np.float32), 0.0, normal)
    np.testing.assert_allclose(flat, np.pi, rtol=1e-9)


def test_a_sun_on_a_plane_of_skin():
    """Through the whole stage, with shadows: .1482 at 81.47 degrees, .1936 at 78.84, wherever in the coarse grid."""
    mesh = quad(100, 100)
    atlas = rasterize(mesh, (8, 8))
    light = EnvironmentLight(name="sky", type="environment", path="sun.exr", shadows=True)
    for row, col in ((130, 39), (137, 245), (118, 505)):
        z = direction_of(np.array((col + 0.5) / 512), np.array(1 - (row + 0.5) / 256))[2]
        (found,) = light_texels(atlas, mesh, SkinMaps(), [light], environments={"sky": sun(row, col)})
        np.testing.assert_allclose(found.rgb, max(z, 0), rtol=4e-3, atol=1e-6)


@pytest.mark.parametrize("radiance", [sun(40, 100, (64, 128), 0.2), np.zeros((8, 16, 3), np.float32)])
def test_directions_stand_for_all_of_the_light(radiance):
    """Their flux is the sky's; as many as its share of the light fall on a sun, within its texel."""
    samples = SkySamples(radiance, 30.0)
    directions, weights = samples.draw(4096, 0.3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    solid = np.linalg.norm(texel_vectors(radiance.shape[:2]), axis=-1)
    total = (radiance * solid[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(weights.sum(axis=0), total, rtol=0.02, atol=1e-9)
    if radiance.any():
        towards = direction_of(np.array(100.5 / 128), np.array(1 - 40.5 / 64), 30.0)
        near = directions @ towards > np.cos(np.radians(2.1))
        share = 0.9 / total.mean()
        assert near.mean() == pytest.approx(share, rel=0.1)
