"""Pieces of a graph."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinbake.atlas.connected import connected


@pytest.mark.parametrize(("count", "edges"), [(0, 0), (1, 0), (3, 1), (50, 20), (400, 390), (400, 2000)])
def test_pieces_are_scipys(count, edges):
    """The same numbers for any graph, with edges that come twice and that lead to where they began."""
    rng = np.random.default_rng(count + edges)
    for _ in range(20):
        first, other = rng.integers(0, max(count, 1), (2, edges))
        graph = coo_array((np.ones(edges), (first, other)), shape=(count, count))
        expected = connected_components(graph, directed=False)[1] if count else []
        np.testing.assert_array_equal(connected(first, other, count), expected)
