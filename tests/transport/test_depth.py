"""Depths below a surface against the nearest of all its triangles."""

import numpy as np
from numba import njit

from skinbake.transport.depth import depth_at, depth_grid
from tests.shapes import joined, sphere
from tests.transport.solids import box, rays_of


@njit
def _depths(grid, rays, place, out):
    for n in range(len(place)):
        out[n, 0], out[n, 1] = depth_at(grid, rays, place[n, 0], place[n, 1], place[n, 2])


def depths(grid, rays, place):
    out = np.empty((len(place), 2))
    _depths(grid, rays, place, out)
    return out


def test_depths_are_exact_near_the_surface_and_never_too_large():
    """A ball of many triangles: R - r to the height of its facets down to the reach, a lower bound in the middle."""
    rays = rays_of(sphere(10.0, "cube", 24))
    grid = depth_grid(rays, 0.5)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(4000, 3))
    r = rng.uniform(0, 10, 4000)
    place = r[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    depth, clear = depths(grid, rays.rays, place).T
    assert np.array_equal(depth, clear)
    near = 10 - r < grid.reach_mm - 0.05
    assert 0.5 < grid.reach_mm < 3
    assert near.sum() > 300
    np.testing.assert_allclose(depth[near], 10 - r[near], atol=0.03)
    assert np.all(depth[~near] >= grid.reach_mm - 0.1)
    assert np.all(depth <= 10 - r + 1e-6)
    assert depth[r < 1].min() > 3  # and not much too small


def test_edges_and_corners_of_a_box_are_near():
    """A box of twelve triangles, about its corner: the smallest of the distances to its sides."""
    rays = rays_of(box([-3, -4, -5], [3, 4, 5]))
    grid = depth_grid(rays, 1.0)
    place = np.array([3.0, 4.0, 5.0]) - np.random.default_rng(2).uniform(0.01, 1.4, (2000, 3))
    depth = depths(grid, rays.rays, place)[:, 0]
    want = (np.array([3.0, 4.0, 5.0]) - place).min(axis=1)
    np.testing.assert_allclose(depth, np.minimum(want, grid.reach_mm), atol=1e-5)


def test_faces_inside_another_part_are_no_surface():
    """A box in a box: within both, depth counts from the outer faces, and what is near from all."""
    rays = rays_of(joined(box([-5, -5, -5], [5, 5, 5]), box([-1, -1, -1], [1, 1, 1])))
    grid = depth_grid(rays, 4.0)
    ((depth, clear),) = depths(grid, rays.rays, np.array([[0.0, 0.0, 1.5]]))
    assert (round(depth, 4), round(clear, 4)) == (3.5, 0.5)
