"""Means with neighbours: noise falls, folds and other skin stay apart."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.terms.neighbours import mean_about, neighbour_weights, numbers, rays_shared
from skinbake.diffuse.terms.skin_hits import skin_points
from skinbake.irradiance.occluder import Occluder
from tests.shapes import joined, quad, sphere

SIZE = (60, 52)


def texels(mesh):
    raster = rasterize(mesh, SIZE, 0)[0]
    rows, cols = np.nonzero(raster.addressed)
    return raster, skin_points(raster, mesh, Occluder(mesh), rows, cols), rows * raster.shape[1] + cols


@pytest.mark.parametrize(("across", "kept"), [(3, 0.140625), (5, 0.0747681)])
def test_a_plane_gets_the_binomial_mean(across, kept):
    """Inside a plane white noise keeps sum w^2 of its square, a ramp stays, and a constant at edges."""
    raster, (point, normal), flat = texels(quad(30, 26))
    weight = neighbour_weights(across, raster, point, normal, flat)
    number = numbers(raster.shape, flat)
    inside = (weight > 0).all(axis=1)
    assert inside.sum() > 0.5 * len(flat)
    total = weight.sum(axis=1, dtype=float)
    np.testing.assert_allclose((weight.astype(float) ** 2).sum(axis=1)[inside] / total[inside] ** 2, kept, rtol=0.01)
    ramp = np.stack([point[:, 0], np.ones(len(flat), np.float32)], axis=1).astype(np.float32)
    got = mean_about(ramp, weight, number, flat)
    np.testing.assert_allclose(got[inside, 0], ramp[inside, 0], atol=1e-4)
    np.testing.assert_allclose(got[:, 1], 1, rtol=1e-6)
    assert rays_shared(weight)[inside].min() > 3


def test_other_skin_does_not_count():
    """A plane beside one in the texture that lies elsewhere, or is turned, gets nothing of it; round skin something."""
    left = quad(30, 30, uv_box=(0.0, 0.0, 0.5, 1.0))
    mesh = joined(left, quad(30, 30, 500.0, uv_box=(0.5, 0.0, 1.0, 1.0)))
    raster, (point, normal), flat = texels(mesh)
    high = (point[:, 2] > point[:, 2].mean()).astype(np.float32)[:, None]
    got = mean_about(high, neighbour_weights(3, raster, point, normal, flat), numbers(raster.shape, flat), flat)
    np.testing.assert_array_equal(got, high)
    raster, (point, normal), flat = texels(sphere(4.0, "cube", 24))
    weight = neighbour_weights(3, raster, point, normal, flat)
    coarse = rays_shared(weight).mean()
    raster, (point, normal), flat = texels(quad(30, 26))
    assert 1 <= coarse < rays_shared(neighbour_weights(3, raster, point, normal, flat)).mean()
