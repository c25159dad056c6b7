"""Points that see the sky, by which skies are planned."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.irradiance.environment_map import SkySamples
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_points import DIRECTIONS, FEWEST, MOST, TELL, SkyPoints
from tests.shapes import joined, quad, sphere


@pytest.fixture
def under_a_lid():
    """Points of a plate under a lid, and of the lid."""
    mesh = joined(quad(200.0, 200.0, uv_box=(0, 0, 0.9, 1)), quad(90.0, 90.0, z_mm=25.0, uv_box=(0.92, 0, 1, 1)))
    return SkyPoints(mesh, Occluder(mesh), (96, 64), 0.01)


def test_few_points_see_what_rays_see(under_a_lid):
    """Shares by the nearest of 1024 directions are those of rays of their own, but for the edges between these."""
    radiance = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    drawn = SkySamples(radiance).draw(512)
    exact, found = under_a_lid.shares(*drawn)[:: under_a_lid.each], under_a_lid.few_shares(*drawn)
    assert found.shape == (TELL, 4)
    assert exact.min() < 0.3
    assert np.sqrt(((found - exact) ** 2).mean()) < 0.02
    assert abs((found - exact).mean()) < 0.004


def test_a_convex_body_is_open():
    """Of all that shines on it everything arrives, but for what lies just above the horizon."""
    mesh = sphere(60.0, "cube", 24)
    points = SkyPoints(mesh, Occluder(mesh), (96, 64), 0.01)
    found = points.few_shares(*SkySamples(np.ones((8, 16, 3), np.float32)).draw(256))
    assert found.min() > 0.97


def test_rays_are_traced_once(under_a_lid, monkeypatch):
    """However many skies are asked for, and with however many directions."""
    asked, once = [], under_a_lid._occluder.unhindered
    monkeypatch.setattr(under_a_lid._occluder, "unhindered", lambda *rays: asked.append(len(rays[0])) or once(*rays))
    for count in (16, 64, 4096):
        under_a_lid.few_shares(*SkySamples(np.ones((8, 16, 3), np.float32)).draw(count))
    assert len(asked) == 1
    assert asked[0] <= DIRECTIONS * TELL


@pytest.mark.parametrize(("tolerance", "count"), [(0.001, MOST), (0.01, MOST), (0.03, 4096), (0.5, FEWEST)])
def test_a_draft_asks_fewer_points(under_a_lid, tolerance, count):
    """They are as many as its tolerance needs, and see the same skin in shadow."""
    mesh, drawn = under_a_lid._mesh, SkySamples(np.ones((8, 16, 3), np.float32)).draw(64)
    points = SkyPoints(mesh, under_a_lid._occluder, (96, 64), tolerance)
    assert len(points.normal) == count
    assert len(points.few_shares(*drawn)) == TELL
    dark = [(of.shares(*drawn)[:, 3] < 0.5).mean() for of in (points, under_a_lid)]
    assert dark[0] == pytest.approx(dark[1], rel=0.05)
