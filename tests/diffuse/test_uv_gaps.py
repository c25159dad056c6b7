"""What is near in space and far in the texture is found, what is near in both is not."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.surface_space.points import texel_points
from skinbake.diffuse.surface_space.surface_light import surface_light
from skinbake.diffuse.texture_space.uv_gaps import distance_to_foreign
from tests.shapes import joined, quad, relief, sphere


def distances(mesh, size, udim=False):
    """By tile, with the area of each block."""
    atlas = rasterize(mesh, size, udim=udim)
    points = {raster.tile: texel_points(raster, mesh, np.zeros(3)) for raster in atlas}
    dark = {raster.tile: np.zeros((1, *raster.shape, 3), np.float32) for raster in atlas}
    pyramids = {tile: lit.pyramid for tile, lit in surface_light(dark, points).items()}
    areas = [p.moments[p.start[2] : p.start[3], 0].reshape(-1, p.width[2]) for p in pyramids.values()]
    return list(distance_to_foreign(pyramids).values()), areas


@pytest.mark.parametrize("mesh", [quad(100, 80), quad(100, 300), relief()])
def test_one_chart_that_does_not_fold_knows_all_its_skin(mesh):
    """Flat, of oblong texels, or a hill of three times its footprint's slope."""
    (found,), (area,) = distances(mesh, (200, 160))
    assert np.isinf(found[area > 0]).all()


@pytest.mark.parametrize("apart_mm", [5.0, 12.0])
def test_two_sheets_see_one_another(apart_mm):
    """As far as they are apart, less half a block of each."""
    sheets = joined(quad(80, 80, uv_box=(0, 0, 0.4, 1)), quad(80, 80, z_mm=apart_mm, uv_box=(0.6, 0, 1, 1)))
    (found,), (area,) = distances(sheets, (400, 160))
    block = 8 * np.sqrt(80 * 80 / (160 * 160))
    full = area > 0.99 * area.max()
    assert (found[full] <= apart_mm).all()
    assert (found[full] >= apart_mm - 1.2 * block).all()


def test_sheets_that_are_far_apart_do_not():
    """Nothing is looked for beyond four blocks."""
    sheets = joined(quad(80, 80, uv_box=(0, 0, 0.4, 1)), quad(80, 80, z_mm=60, uv_box=(0.6, 0, 1, 1)))
    (found,), _ = distances(sheets, (400, 160))
    assert np.isinf(found).all()


def test_tiles_are_foreign_along_their_common_seam_only():
    """A sphere over two tiles: zero at the seams, infinite between them."""
    found, areas = distances(sphere(50, "latlong", 96, tiles=2), (256, 256), udim=True)
    assert len(found) == 2
    for near, area in zip(found, areas, strict=True):
        for row in range(10, 22):
            skin = np.flatnonzero(area[row] > 0.5 * area.max())
            assert near[row, skin[[0, -1]]].max() < 3
            assert np.isinf(near[row, skin[10:-10]]).all()
        assert np.isinf(near[area <= 0]).all()
