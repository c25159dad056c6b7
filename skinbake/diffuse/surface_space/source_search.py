"""Finds sources near a place: boxes of a tree of sources near a box, and sources of a leaf near a box or a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.surface_space.sources import NORMAL
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, bits_below, load, lowest_bit, mul_add

LEAVES, GROUPS = np.int64(0), np.int64(1)  # levels of boxes: what `near_boxes` looks for
STACK = 16 * LANES  # of `near_boxes`: a tree of any size needs half of it, the groups to begin from may take the rest
_TREE_LEVELS = 16  # of boxes, more than there ever are
_ZERO = np.float32(0)


class Search(NamedTuple):
    """Work space of `near_boxes`.

    Attributes
    ----------
    stack : ndarray of shape (STACK,), int64
        Begins with the groups to begin from: `tree_node`s.
    found : ndarray of shape (N,), int64
        The boxes found.
    """

    stack: NDArray[np.int64]
    found: NDArray[np.int64]


@kernel
def near_boxes(low, high, radius2, tree, search, depth, bottom):  # type: ignore[no-untyped-def]
    """Number of a level's boxes within a distance of the box from `low` to `high`; `search.found` lists them.

    Parameters
    ----------
    low, high : ndarray of shape (3,), float32
    radius2 : float32
        Squared distance, mm^2.
    tree : TreeArrays
    search : Search
    depth : int
        Groups to begin from.
    bottom : int
        `LEAVES`, `GROUPS`, ...: the level whose boxes are found. As int64, like `depth`: for a literal number numba
        would compile once more.
    """
    boxes, first_group, stack, found = tree.boxes, tree.first_group, search.stack, search.found
    count = 0
    while depth > 0:
        depth -= 1
        group, level = stack[depth] // _TREE_LEVELS, stack[depth] % _TREE_LEVELS
        base = (first_group[level] + group) * (6 * LANES)
        dx = max(max(load(boxes, base) - high[0], low[0] - load(boxes, base + 3 * LANES)), _ZERO)
        dy = max(max(load(boxes, base + LANES) - high[1], low[1] - load(boxes, base + 4 * LANES)), _ZERO)
        dz = max(max(load(boxes, base + 2 * LANES) - high[2], low[2] - load(boxes, base + 5 * LANES)), _ZERO)
        bits = bits_below(mul_add(dx, dx, mul_add(dy, dy, dz * dz)), radius2)
        while bits != 0:
            child = group * LANES + lowest_bit(bits)
            bits &= bits - 1
            if level == bottom:
                found[count] = child
                count += 1
            else:
                stack[depth] = tree_node(child, level - 1)
                depth += 1
    return count


@kernel(inline=True)
def tree_node(group, level):  # type: ignore[no-untyped-def]
    """A group of sixteen boxes of a level, for the stack of `near_boxes`."""
    return group * _TREE_LEVELS + level


@kernel(inline=True)
def near_sources(leaves, base, low, high, radius2):  # type: ignore[no-untyped-def]
    """Bits of a leaf's sources within a distance of a box.

    Parameters
    ----------
    leaves : ndarray, float32
        `SourceTree.leaf`, flat.
    base : int
        Where the leaf begins in it.
    low, high : ndarrays of shape (3,), float32
        Corners of the box, mm.
    radius2 : float32
        Squared distance, mm^2.
    """
    x, y, z = load(leaves, base), load(leaves, base + LANES), load(leaves, base + 2 * LANES)
    dx = max(max(x - high[0], low[0] - x), _ZERO)
    dy = max(max(y - high[1], low[1] - y), _ZERO)
    dz = max(max(z - high[2], low[2] - z), _ZERO)
    return bits_below(mul_add(dx, dx, mul_add(dy, dy, dz * dz)), radius2)


@kernel(inline=True)
def sources_around(leaves, base, x, y, z, radius2):  # type: ignore[no-untyped-def]
    """Bits of a leaf's sources within a distance of a point.

    Parameters
    ----------
    leaves, base
        As in `near_sources`.
    x, y, z : float32
        The point, mm.
    radius2 : float32
        Squared distance, mm^2.
    """
    dx, dy, dz = load(leaves, base) - x, load(leaves, base + LANES) - y, load(leaves, base + 2 * LANES) - z
    return bits_below(mul_add(dx, dx, mul_add(dy, dy, dz * dz)), radius2)


@kernel(inline=True)
def opposite_sources(leaves, base, ax, ay, az, sine):  # type: ignore[no-untyped-def]
    """Bits of a leaf's sources whose normals lie less than `sine` along an axis.

    Parameters
    ----------
    leaves, base
        As in `near_sources`.
    ax, ay, az : float32
        Unit.
    sine : float32
    """
    base += NORMAL * LANES
    across = mul_add(load(leaves, base + LANES), ay, load(leaves, base + 2 * LANES) * az)
    return bits_below(mul_add(load(leaves, base), ax, across), sine)
