"""Rays are answered as the closed form says, in one thread or many."""

from __future__ import annotations

import numpy as np

from skinbake.irradiance.occluder import Occluder
from tests.shapes import sphere


def rays(count=200_000):
    rng = np.random.default_rng(5)
    origin = rng.normal(size=(count, 3)) * 120
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return origin.astype(np.float32), direction.astype(np.float32)


def test_a_sphere_is_hit_where_the_quadratic_says():
    """Occlusion and first distance of a sphere agree with the closed form but for rays that graze it."""
    occluder = Occluder(sphere(70.0, "cube", 64))
    origin, direction = rays()
    b = np.einsum("ij,ij->i", origin.astype(float), direction)
    discriminant = b**2 - (origin.astype(float) ** 2).sum(1) + 70.0**2
    grazing = np.abs(discriminant) < 20
    near, far = -b - np.sqrt(np.maximum(discriminant, 0)), -b + np.sqrt(np.maximum(discriminant, 0))
    expected = (discriminant > 0) & (far > 0)
    reach = np.full(len(origin), np.inf, np.float32)
    hit = occluder.occluded(origin, direction, reach)
    clear = ~grazing & (np.abs(near) > 0.1) & (np.abs(far) > 0.1)
    np.testing.assert_array_equal(hit[clear], expected[clear])
    triangle, _, _, distance = occluder.first_hit(origin, direction)
    pick = clear & expected
    np.testing.assert_allclose(distance[pick], np.where(near > 0, near, far)[pick], atol=0.3)
    assert (triangle[clear & ~expected] == -1).all()
    # A ray that ends before the surface meets nothing
    short = occluder.occluded(origin, direction, np.maximum(np.where(near > 0, near, far) - 1, 0).astype(np.float32))
    assert not short[pick].any()


def test_threads_do_not_change_an_answer(monkeypatch):
    """One thread and two give the same answers."""
    occluder = Occluder(sphere(70.0, "cube", 32))
    origin, direction = rays()
    reach = np.full(len(origin), np.inf, np.float32)
    found = []
    for threads in (1, 2):
        monkeypatch.setenv("NUMBA_NUM_THREADS", str(threads))
        found.append(occluder.occluded(origin, direction, reach))
    np.testing.assert_array_equal(*found)
