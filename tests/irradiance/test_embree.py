"""Triangles in Embree, asked for many rays at once."""

import numpy as np
import pytest

from skinbake.irradiance.embree import FAR, Triangles

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
FACE = np.array([[0, 1, 2]])
ORIGIN = np.array([[0.25, 0.5, 3], [0.25, 0.5, 0.5], [0.9, 0.9, 3], [0.25, 0.5, 3]], np.float32)
DOWN = np.array([[0, 0, -0.5]], np.float32)


@pytest.fixture(scope="module")
def two():
    """One triangle, and another one a mm above it."""
    return Triangles((CORNERS, FACE), (CORNERS + np.float32([0, 0, 1]), FACE))


def test_first_hits_tell_part_place_and_lengths(two):
    """From above, from between, and past both; on arrays of any layout."""
    for origin in (ORIGIN, np.asfortranarray(ORIGIN), ORIGIN.astype(float)):
        hit = two.first_hits(origin, np.repeat(DOWN, 4, 0))
        assert hit.geometry.tolist() == [1, 0, -1, 1]
        assert hit.triangle.tolist() == [0, 0, -1, 0]
        np.testing.assert_allclose(hit.distance, [4, 1, FAR, 4], rtol=1e-6)
        np.testing.assert_allclose(np.stack([hit.b1, hit.b2])[:, hit.triangle >= 0], [[0.25] * 3, [0.5] * 3], rtol=1e-6)


def test_any_hit_counts_within_reach(two):
    """In lengths of the direction, which may be one for all rays; a reach may have no end."""
    reach = np.array([3.9, 1.1, np.inf, np.inf], np.float32)
    for direction in (DOWN, np.repeat(DOWN, 4, 0)):
        assert two.occluded(ORIGIN, direction, reach).tolist() == [False, True, False, True]
