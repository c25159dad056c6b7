"""Maps are read without aliasing at the atlas's texels."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize, sample_map, shrink
from tests.shapes import quad, sphere


def test_a_map_of_the_same_size_comes_back_unchanged():
    """A 29 x 16 map on a full quad of 29 x 16 texels is read exactly."""
    mesh = quad(columns=2)
    (raster,) = rasterize(mesh, (29, 16))
    image = np.random.default_rng(1).random((16, 29, 3)).astype(np.float32)
    np.testing.assert_allclose(sample_map(raster, mesh, {1001: image}, (0, 0, 0)), image, atol=1e-6)


def test_a_larger_map_is_averaged_over_texels():
    """A map three and a half times as large: each texel gets the mean of what it covers, and the total is kept."""
    image = np.random.default_rng(2).random((35, 28)).astype(np.float32)
    mesh = quad()
    (raster,) = rasterize(mesh, (8, 10))
    expected = image.repeat(2, 0).repeat(2, 1).reshape(10, 7, 8, 7).mean(axis=(1, 3))
    np.testing.assert_allclose(sample_map(raster, mesh, {1001: image}, 0.0), expected, atol=1e-6)
    assert shrink(image, (9, 5)).mean() == pytest.approx(image.mean(), rel=1e-5)


def test_a_smaller_map_is_read_bilinearly():
    """A ramp of 7 x 5 texels stays a ramp at 70 x 50, away from the clamped border."""
    mesh = quad()
    (raster,) = rasterize(mesh, (70, 50))
    u, v = np.meshgrid((np.arange(7) + 0.5) / 7, 1 - (np.arange(5) + 0.5) / 5)
    image = (2 * u + 3 * v).astype(np.float32)
    uv = interpolate(raster, mesh.corner_uv)
    inner = (slice(5, -5), slice(5, -5))
    np.testing.assert_allclose(sample_map(raster, mesh, {1001: image}, 0.0)[inner], (uv @ [2, 3])[inner], atol=1e-5)


def test_a_tile_reads_its_own_map():
    """Tile 1002 reads the map of 1002; a tile without a map has the constant, and empty texels are zero."""
    mesh = sphere(30.0, "cube", tiles=2)
    first, second = rasterize(mesh, (32, 32), gutter=0, udim=True)
    images = {1002: np.full((4, 4), 7.0, np.float32)}
    assert (sample_map(second, mesh, images, 2.0)[second.addressed] == 7).all()
    assert (sample_map(first, mesh, images, 2.0)[first.addressed] == 2).all()
    assert (sample_map(first, mesh, images, 2.0)[~first.addressed] == 0).all()
    assert sample_map(first, mesh, {}, (1.0, 2.0, 3.0)).shape == (32, 32, 3)
