"""Points for the comparison, and the groups they belong to."""

import numpy as np
import pytest

from skinbake.scene.lights import DirectionalLight, EnvironmentLight
from skinbake.transport.points import CREASE, draw_points
from tests.shapes import joined, sphere
from tests.transport.solids import box, rays_of

SUN = DirectionalLight(type="directional", name="sun", direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0))


def position(mesh, points):
    b = np.concatenate([1 - points.barycentric.sum(axis=1, keepdims=True), points.barycentric], axis=1)
    return np.einsum("pk,pki->pi", b, mesh.corner_position_mm[points.face])


def test_edges_are_where_the_sun_sets():
    """On a ball the terminator is its equator: within 3 mm of it, and there alone."""
    mesh = sphere(40.0, "cube", 96)
    points = draw_points(mesh, rays_of(mesh), [SUN], 400, 1)
    height = position(mesh, points)[:, 2]
    assert points.groups["edges"][np.abs(height) < 2.2].all()
    assert not points.groups["edges"][np.abs(height) > 3.5].any()
    assert not points.groups["cast edges"][np.abs(height) > 1].any()
    assert points.groups["lit"][height > 3.5].all()
    assert not points.groups["lit"][height < 3.5].any() or height[points.groups["lit"]].min() > 1


def test_weighted_means_are_means_over_the_skin():
    """Many points lie at edges, and each of these counts for less: the mean height of a ball stays 0."""
    mesh = sphere(40.0, "cube", 96)
    points = draw_points(mesh, rays_of(mesh), [SUN], 2000, 1)
    height = position(mesh, points)[:, 2]
    assert abs((points.weight * height).mean()) < 3.5 * 40 / np.sqrt(3 * 2000)
    assert points.groups["edges"].mean() > 2.5 * (points.weight * points.groups["edges"]).mean()
    assert abs((points.weight * (np.abs(height) < 3)).mean() - 3 / 40) < 0.02


def test_thin_parts_creases_and_cast_shadows_are_found():
    """A plate of 5 mm, 4 mm above a block: the plate is thin, both are creases there, and its shadow has an edge."""
    mesh = joined(box([-40, -40, -30], [40, 40, 0]), box([-40, -40, 4], [0, 40, 9]))
    points = draw_points(mesh, rays_of(mesh), [SUN], 600, 2)
    x, y, z = position(mesh, points).T
    inner = np.abs(y) < 35
    thin = points.groups["thin"]
    assert thin[inner & (z > 3.9) & (np.abs(x + 20) < 19)].all()
    assert not thin[(z < 0.1) & (z > -20) & (x > -38) & (x < 31)].any()
    assert points.groups["creases"][inner & (np.abs(z) < 1e-3) & (x < -5) & (x > -35)].all()
    assert not points.groups["creases"][z < -8].any()
    on_block = inner & (np.abs(z) < 1e-3)
    assert points.groups["cast edges"][on_block & (np.abs(x) < 2)].all()
    assert not points.groups["cast edges"][on_block & (np.abs(x) > 4) & (np.abs(x) < 36)].any()
    assert 0 < CREASE < 1


def test_a_point_inside_other_skin_is_never_drawn():
    """Two balls that overlap: what the other one holds is no skin."""
    one = sphere(30.0, "cube", 48)
    two = type(one)(one.positions_mm + np.array([25.0, 0, 0]), one.faces, one.corner_uv, one.corner_normal)
    mesh = joined(one, two)
    points = draw_points(mesh, rays_of(mesh), [SUN], 300, 3)
    at = position(mesh, points)
    assert np.linalg.norm(at, axis=1).min() > 29.5
    assert np.linalg.norm(at - [25.0, 0, 0], axis=1).min() > 29.5


def test_the_seed_decides_and_a_sky_has_no_edges():
    """The same points for the same seed; without lamps no group but those of the form."""
    mesh = sphere(40.0, "cube", 48)
    sky = EnvironmentLight(type="environment", name="sky", radiance=(1.0, 1.0, 1.0))
    first, again, other = (draw_points(mesh, rays_of(mesh), [sky], 50, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.barycentric, again.barycentric)
    assert not np.array_equal(first.barycentric, other.barycentric)
    assert not any(mine.any() for mine in first.groups.values())
    with pytest.raises(ValueError, match="count"):
        draw_points(mesh, rays_of(mesh), [sky], 0)
