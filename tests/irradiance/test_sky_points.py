"""Points that see the sky, by which skies are planned."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.irradiance.environment_map import SkySamples
from skinbake.irradiance.environment_share import open_shares
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_directions import DIRECTIONS
from skinbake.irradiance.sky_points import FEWEST, MOST, SkyPoints
from skinbake.irradiance.sky_texels import TELL, sky_texels
from skinbake.irradiance.surface import places_of_texels
from tests.shapes import joined, quad, sphere


def points_of(mesh, tolerance=0.01):
    return SkyPoints(sky_texels(mesh, Occluder(mesh), (96, 64), 2, False), (96, 64), tolerance)


@pytest.fixture
def under_a_lid():
    """Points of a plate under a lid, and of the lid."""
    mesh = joined(quad(200.0, 200.0, uv_box=(0, 0, 0.9, 1)), quad(90.0, 90.0, z_mm=25.0, uv_box=(0.92, 0, 1, 1)))
    return points_of(mesh)


def test_few_texels_see_what_rays_see(under_a_lid):
    """Shares by the nearest of 1024 directions are those of rays of their own, but for the edges between these."""
    radiance = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    drawn, texels = SkySamples(radiance).draw(512), under_a_lid._texels
    (raster,), (numbers,) = texels.atlas, texels.numbers.values()
    origin, normal = places_of_texels(raster, numbers, texels.mesh, texels.occluder)
    exact, found = open_shares(origin, normal, *drawn, texels.occluder), under_a_lid.few_shares(*drawn)
    np.testing.assert_array_equal(normal, under_a_lid.few_normal)
    assert found.shape == (TELL, 4)
    assert exact.min() < 0.3
    assert np.sqrt(((found - exact) ** 2).mean()) < 0.02
    assert abs((found - exact).mean()) < 0.004


def test_a_convex_body_is_open():
    """Of all that shines on it everything arrives."""
    mesh = sphere(60.0, "cube", 24)
    points = points_of(mesh)
    found = points.few_shares(*SkySamples(np.ones((8, 16, 3), np.float32)).draw(256))
    assert found.min() > 0.999


def test_rays_are_traced_once(under_a_lid, monkeypatch):
    """However many skies are asked for, with however many directions, to whatever tolerance."""
    asked, once = [], Occluder.unhindered
    monkeypatch.setattr(Occluder, "unhindered", lambda self, *rays: asked.append(len(rays[0])) or once(self, *rays))
    texels = under_a_lid._texels
    for points in (under_a_lid, SkyPoints(texels, (96, 64), 0.5)):
        for count in (16, 64, 4096):
            points.few_shares(*SkySamples(np.ones((8, 16, 3), np.float32)).draw(count))
    (seen,) = texels.seen.values()
    facing = np.einsum("ni,di->nd", seen.normal, texels.towards) > 0
    assert sum(asked) == np.count_nonzero(facing) <= DIRECTIONS * TELL / 1.9


@pytest.mark.parametrize(("tolerance", "count"), [(0.001, MOST), (0.01, MOST), (0.03, 4444), (0.5, FEWEST)])
def test_a_draft_asks_fewer_points(under_a_lid, tolerance, count):
    """They are as many as its tolerance needs, and see the same skin in shadow."""
    drawn = SkySamples(np.ones((8, 16, 3), np.float32)).draw(64)
    points = SkyPoints(under_a_lid._texels, (96, 64), tolerance)
    assert len(points.normal) == count
    assert len(points.few_shares(*drawn)) == TELL
    dark = [(of.shares(*drawn)[:, 3] < 0.5).mean() for of in (points, under_a_lid)]
    assert dark[0] == pytest.approx(dark[1], rel=0.05)
