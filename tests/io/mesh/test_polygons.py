"""Polygons become triangles that cover what they cover, once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.io.mesh.polygons import triangulate

U_SHAPE = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]


def bent(flat):
    """Points of a plane laid on a parabola in a tilted frame."""
    x, y = np.asarray(flat, dtype=float).T
    tilted, _ = np.linalg.qr(np.array([[1.0, 2, 3], [2, -1, 1], [1, 1, -4]]))
    return np.stack([x, y, 0.02 * x * x], axis=1) @ tilted.T + [5, -3, 2]


def areas(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


@pytest.mark.parametrize("turn", range(8))
def test_a_u_shape_keeps_its_notch(turn):
    """Whichever corner comes first: six triangles, all facing one way, that add up to the polygon's area."""
    flat = np.roll(U_SHAPE, turn, axis=0)
    points = np.concatenate([flat, np.zeros((8, 1))], axis=1).astype(float)
    triangles = triangulate(points, np.array([8]))
    assert triangles.shape == (6, 3)
    np.testing.assert_allclose(areas(points, triangles)[:, 2].sum(), 7.0)
    assert (areas(points, triangles)[:, 2] >= 0).all()
    curved = bent(flat)
    assert np.linalg.norm(areas(curved, triangulate(curved, np.array([8]))), axis=1).sum() == pytest.approx(7, rel=0.01)


def test_corners_on_a_straight_edge_stay():
    """Neighbours use them: every corner of a U of five quads is a corner of a triangle."""
    flat = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3), (0, 1)]
    points = np.concatenate([flat, np.zeros((12, 1))], axis=1).astype(float)
    triangles = triangulate(points, np.array([12]))
    assert triangles.shape == (10, 3)
    assert set(triangles.ravel()) == set(range(12))
    assert (areas(points, triangles)[:, 2] > 0).all()
    assert areas(points, triangles)[:, 2].sum() == pytest.approx(7)


def test_an_arrow_is_cut_along_its_shaft():
    """A concave quad, by either corner first."""
    points = np.array([[0, 0, 0], [4, -3, 0], [1, 0, 0], [4, 3, 0]], float)
    for turn in range(4):
        rows = np.roll(points, turn, axis=0)
        assert (areas(rows, triangulate(rows, np.array([4])))[:, 2] > 0).all()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(1, 9), min_size=1, max_size=12), st.integers(0, 2**32 - 1))
def test_stars_of_any_size(sizes, seed):
    """Star-shaped polygons, one after the other: sizes - 2 triangles each, only of its own corners, area kept."""
    rng = np.random.default_rng(seed)
    rows = []
    for size in sizes:
        angle = (np.arange(size) + rng.uniform(0, 0.5, size)) / size * 2 * np.pi
        rows.append(rng.uniform(0.3, 1, size)[:, None] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))
    points, counts = np.concatenate(rows), np.array(sizes)
    triangles = triangulate(points, counts)
    polygon = np.repeat(np.arange(len(sizes)), counts)[triangles]
    assert (polygon == polygon[:, :1]).all()
    np.testing.assert_array_equal(np.bincount(polygon[:, 0], minlength=len(sizes)), np.maximum(counts - 2, 0))
    for k, row in enumerate(rows):
        wanted = 0.5 * np.cross(row, np.roll(row, -1, axis=0))[:, 2].sum() if len(row) > 2 else 0
        assert areas(points, triangles[polygon[:, 0] == k])[:, 2].sum() == pytest.approx(wanted)


def test_a_polygon_without_any_area_is_a_fan():
    """What cannot be cut is not left out."""
    points = np.zeros((5, 3))
    assert triangulate(points, np.array([5])).shape == (3, 3)
    crossed = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0], [1, 3, 0]], float)
    assert triangulate(crossed, np.array([5])).shape == (3, 3)
