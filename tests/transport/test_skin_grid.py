"""Walks where the medium is not as dense everywhere, against what density must not change."""

import math

import numpy as np

from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance, half_space_reflectance
from skinbake.transport.light_leaving import light_leaving, medium_for_walks
from skinbake.transport.medium import TransportMedium
from skinbake.transport.skin_grid import SkinGrid, skin_grid
from skinbake.transport.walk_medium import DENSITY
from tests.transport.solids import box, on_top, rays_of
from tests.transport.test_light_leaving import COSINES, HARD, SKIN, THROUGH, WHOLE, agree, pooled, sky, sun


def by_depth(of):
    """A grid whose density below z = 0 is a function of the depth alone."""
    depth = np.arange(0, 330, 0.25)
    value = np.broadcast_to(of(depth)[::-1].astype(np.float32), (2, 2, len(depth))).copy()[..., None]
    return SkinGrid(value, np.array([0.0, 0.0, -depth[-1]]), 0.25, np.array([value.min()]), np.array([value.max()]))


def half_space(density, lights, points=4, walks=192, seed=5):
    mesh = box([-300, -300, -300], [300, 300, 0])
    face, place = on_top(mesh, np.zeros(points), np.full(points, 20.0))
    rays = rays_of(mesh)
    medium = TransportMedium(*SKIN)
    if density is not None:  # the rays' own origin
        density = density._replace(low_mm=density.low_mm - rays.rays.centre_mm)
        medium = medium_for_walks(rays, medium, density, (DENSITY,))
    return light_leaving(rays, medium, lights, face, place, walks, seed)


def test_the_same_density_everywhere_changes_no_walk():
    """A grid of ones is no grid: the same numbers, to the round-off of lengths."""
    lights = [sun(0.5), sky()]
    with_grid = half_space(by_depth(np.ones_like), lights, 2, 32)
    without = half_space(None, lights, 2, 32)
    np.testing.assert_allclose(with_grid.mean, without.mean, rtol=1e-9)


def test_a_half_space_reflects_the_same_however_dense_it_is_at_which_depth():
    """Only optical depth counts there: a step from 0.5 to 2, 1 mm below, leaves R(mu) what Chandrasekhar says."""
    lights = [*(sun(mu, f"s{i}", 1 / mu) for i, mu in enumerate(COSINES)), sky()]
    found = half_space(by_depth(lambda z: np.where(z < 1, 0.5, 2.0)), lights, walks=480)
    albedo = SKIN[1] / (SKIN[0] + SKIN[1])
    want = np.stack([*(half_space_reflectance(mu, albedo) for mu in COSINES), half_space_diffuse_reflectance(albedo)])
    for estimate in (HARD, THROUGH, WHOLE):
        agree(*pooled(found, estimate), want)


def test_a_grid_holds_the_density_of_the_nearest_skin():
    """Left of a plate 0.5 and right 2, to within a cube of the border near the skin, at any depth elsewhere."""
    x, y = np.meshgrid(np.arange(-10, 10.1, 0.25), np.arange(-5, 5.1, 0.25))
    place = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    place = np.concatenate([place, place - [0, 0, 30]])
    grid = skin_grid(place, np.where(place[:, :1] < 0, 0.5, 2.0), 0.5)
    index = lambda *at: tuple(np.round((np.array(at) - grid.low_mm) / grid.cell_mm).astype(int))  # noqa: E731
    assert grid.value[index(-3, 0, -2)] == 0.5
    assert grid.value[index(3, 0, -2)] == 2.0
    assert grid.value[index(-0.6, 0, -2)] == 0.5
    assert grid.value[index(0.6, 0, -2)] == 2.0
    assert grid.value[index(3, 0, -15)] == 2.0
    assert (grid.least[0], grid.most[0]) == (0.5, 2.0)
    assert grid.cell_mm == 0.5
    assert math.prod(grid.value.shape) < 1e6
