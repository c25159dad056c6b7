"""Connected pieces of a graph: charts of a mesh, loops of its rims.

By a kernel: scipy's needs `scipy.sparse`, .1 s of every start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel


def connected(first: NDArray[np.integer], other: NDArray[np.integer], count: int) -> NDArray[np.int32]:
    """Number of the piece that each node belongs to, shape (count,): pieces in the order of their lowest nodes.

    Parameters
    ----------
    first, other : ndarrays of shape (E,)
        Nodes at both ends of each edge, 0 ... count.
    count : int
    """
    piece = np.empty(count, np.int32)
    _number_pieces(np.ascontiguousarray(first, np.int64), np.ascontiguousarray(other, np.int64), piece)
    return piece


@kernel(inline=True)
def _root(parent, node):  # type: ignore[no-untyped-def]
    """The lowest node known of the piece that a node belongs to; ways to it are halved.

    Parameters
    ----------
    parent : ndarray
    node : int
    """
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


@kernel
def _number_pieces(first: NDArray[np.int64], other: NDArray[np.int64], piece: NDArray[np.int32]) -> None:
    """Join the ends of all edges, and number what is joined.

    Parameters
    ----------
    first, other : ndarrays of shape (E,)
    piece : ndarray of shape (count,)
        Written.
    """
    for node in range(len(piece)):
        piece[node] = node
    for edge in range(len(first)):
        a, b = _root(piece, first[edge]), _root(piece, other[edge])
        if a < b:
            piece[b] = a
        else:
            piece[a] = b
    found = 0
    for node in range(len(piece)):  # whatever leads to a lower node, which has its number
        if piece[node] == node:
            piece[node] = found
            found += 1
        else:
            piece[node] = piece[piece[node]]
