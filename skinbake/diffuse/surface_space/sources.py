"""Sources of a surface sum in the order of the texture's quadtree, sixteen to a leaf, the leaves under a tree of boxes.

Texels next to one another in a chart are next to one another on the skin: a walk along the quadtree (Morton order) lays
what is near in space near in memory, without a sort. A leaf ends after sixteen sources, and where the next one is far
off: two charts never share a leaf. What the texture keeps apart, the boxes in space bring together again.

A source is a texel, or a block of texels whose skin is small and flat enough (`clusters.is_cluster`); the walk goes as
deep as it must.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled
from skinbake.diffuse.surface_space.clusters import LEVELS, is_cluster
from skinbake.diffuse.surface_space.surface_light import LitTile
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, lowest_bit
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Zeros

NORMAL, NARROWING, AMPLITUDE, LIGHT = 3, 6, 7, 8  # rows of a leaf; x y z come first
_FAR2 = np.float32(64)  # squared distance to the next source, in areas of the larger: beyond a leaf's own skin
_NOWHERE = np.float32(1e18)
_ROOTS_AT_ONCE = 1024  # 2048 x 2048 texels
_ZERO = np.float32(0)


@dataclass(frozen=True)
class SourceTree:
    """Sources, their leaves, and boxes of leaves, of sixteen leaves, of 256, ...

    Attributes
    ----------
    leaf : ndarray of shape (N, 8 + C, 16), float32
        Sixteen sources side by side: x y z (mm), unit normal, `NARROWING`, `AMPLITUDE`, radiosity from `LIGHT` on. A
        place without a source is far away, and all else 0.
    count : int
        How many sources there are.
    largest : float
        The largest amplitude.
    box : ndarray of shape (G, 6, 16), float32
        Least x y z and greatest x y z of sixteen boxes; those of the leaves first, then of the groups themselves.
    first_group : ndarray of shape (levels,), int64
        Number of each level's first group, leaves first; the last level is one group.
    walked : tuple of (Walked, ndarray of shape (roots,))
        Which texels and blocks they are, a tile each, and the first leaf of each root block: where other light goes.
    """

    leaf: NDArray[np.float32]
    count: int
    largest: float
    box: NDArray[np.float32]
    first_group: NDArray[np.int64]
    walked: tuple[tuple[Walked, NDArray[np.int64]], ...] = ()

    @property
    def arrays(self) -> TreeArrays:
        """The tree for kernels."""
        return TreeArrays(self.leaf, self.leaf.reshape(-1), self.box.reshape(-1), self.first_group)


class TreeArrays(NamedTuple):
    """A `SourceTree` as kernels take it.

    Attributes
    ----------
    leaf : ndarray of shape (N, 8 + C, 16), float32
    leaves, boxes : ndarrays, float32
        All of `leaf` and of `box`, flat.
    first_group : ndarray of shape (levels,), int64
    """

    leaf: NDArray[np.float32]
    leaves: NDArray[np.float32]
    boxes: NDArray[np.float32]
    first_group: NDArray[np.int64]


def source_tree(
    lit: Tiled[LitTile],
    max_spread_mm2: float = -1.0,
    variance_mm2: float = 1.0,
    zeros: Zeros = np.zeros,
    rest: Callable[[], None] = lambda: None,
) -> SourceTree:
    """The widest blocks whose spread is at most `max_spread_mm2`, and single texels elsewhere.

    Parameters
    ----------
    lit : Tiled of LitTile
        Skin and light.
    max_spread_mm2 : float
        Below 0 every texel stays by itself.
    variance_mm2 : float
        v of the lobe: a cluster spreads by its own spread s^2 less. `NARROWING` is v / (v - s^2), `AMPLITUDE` the area
        times that.
    zeros : callable, optional
        Makes the arrays of leaves and of the walk.
    rest : callable, optional
        Called now and then: frees the memory of what was read.
    """
    walks = []
    for points, light, pyramid in lit.values():
        rows, cols = _roots(points.row.shape)
        order = zeros((len(rows), 4**LEVELS), np.int32)
        count = np.empty((len(rows), 2), np.int64)
        roots, found = _Roots(rows, cols), Walked(order, count)
        parallel_for(_walk, len(rows), roots, points, pyramid, np.float32(max_spread_mm2), found)
        walks.append((points, light, pyramid, order, count))
    total = np.cumsum(np.concatenate([count for *_, count in walks]), axis=0)
    sources, leaves = (int(n) for n in total[-1])
    leaf, box = zeros((leaves, LIGHT + 3 * len(walks[0][1]), LANES), np.float32), _no_boxes(leaves)
    done, walked = 0, []
    for points, light, pyramid, order, count in walks:
        begin = (total[done : done + len(count)] - count)[:, 1]
        for root in range(0, len(order), _ROOTS_AT_ONCE):
            part = slice(root, root + _ROOTS_AT_ONCE)
            mine, into = Walked(order[part], count[part]), _Leaves(begin[part], leaf, box)
            parallel_for(_write, len(mine.order), mine, points, light, (pyramid, np.float32(variance_mm2)), into)
            rest()
        done += len(count)
        walked.append((Walked(order, count), begin))
    levels = [box]
    while len(levels[-1]) > 1:
        levels.append(_no_boxes(len(levels[-1])))
        parallel_for(_enclose, len(levels[-2]), levels[-2], levels[-1])
    first = np.cumsum([0, *(len(level) for level in levels[:-1])])
    largest = float(leaf[:, AMPLITUDE].max(initial=0))
    return SourceTree(leaf, sources, largest, np.concatenate(levels), first, tuple(walked))


def _roots(shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First row and column of each root block, in Morton order."""
    side = 1 << LEVELS
    down, across = -(-shape[0] // side), -(-shape[1] // side)
    order = np.arange(4 ** int(np.ceil(np.log2(max(down, across)))))
    row, col = np.zeros_like(order), np.zeros_like(order)
    for bit in range(16):
        row |= (order >> (2 * bit + 1) & 1) << bit
        col |= (order >> (2 * bit) & 1) << bit
    there = (row < down) & (col < across)
    return row[there] * side, col[there] * side


def _no_boxes(count: int) -> NDArray[np.float32]:
    """Groups for `count` boxes, each empty until it is filled."""
    box = np.empty((max(1, -(-count // LANES)), 6, LANES), np.float32)
    box[:, :3], box[:, 3:] = _NOWHERE, -_NOWHERE
    return box


@kernel
def _enclose(first, stop, child, parent):  # type: ignore[no-untyped-def]
    """Boxes around groups of sixteen boxes.

    Parameters
    ----------
    first, stop : int
        Groups.
    child, parent : ndarrays of shape (groups, 6, 16), float32
        A box of `parent`, written, encloses the sixteen of a group of `child`.
    """
    for k in range(first, stop):
        for axis in range(3):
            low, high = _NOWHERE, -_NOWHERE
            for lane in range(LANES):
                low, high = min(low, child[k, axis, lane]), max(high, child[k, 3 + axis, lane])
            parent[k // LANES, axis, k % LANES], parent[k // LANES, 3 + axis, k % LANES] = low, high


class _Roots(NamedTuple):
    """First row and column of each root block, in Morton order."""

    rows: NDArray[np.int64]
    cols: NDArray[np.int64]


class Walked(NamedTuple):
    """What `_walk` finds of each root block.

    Attributes
    ----------
    order : ndarray of shape (roots, 64 * 64), int32
        Sources in Morton order: 2 k for texel k, 2 b + 1 for block b, as ~ where a leaf begins.
    counts : ndarray of shape (roots, 2), int64
        Sources, and leaves.
    """

    order: NDArray[np.int32]
    counts: NDArray[np.int64]


class _Leaves(NamedTuple):
    """What `_write` fills.

    Attributes
    ----------
    begin : ndarray of shape (roots,), int64
        First leaf of each root block; read.
    leaf, box : ndarrays, float32
        As in `SourceTree`, of the leaves alone.
    """

    begin: NDArray[np.int64]
    leaf: NDArray[np.float32]
    box: NDArray[np.float32]


@kernel
def _walk(first, stop, roots, points, pyramid, max_spread, out):  # type: ignore[no-untyped-def]
    """List each root block's sources, the widest blocks that may be one.

    Parameters
    ----------
    first, stop : int
        Root blocks.
    roots : _Roots
    points : TexelPoints
    pyramid : MomentPyramid
    max_spread : float32
        Largest spread of a block that is one source, mm^2.
    out : Walked
        Written.
    """
    rows, cols, order, count = roots.rows, roots.cols, out.order, out.counts
    row_of, position, area = points.row, points.position, points.area_mm2
    moments, start, width = pyramid.moments, pyramid.start, pyramid.width
    height, columns = row_of.shape
    for root in range(first, stop):
        sources, leaves, lane = 0, 0, 0
        x, y, z, before = _ZERO, _ZERO, _ZERO, _ZERO  # of the source before, and its area
        here = 0
        while here < 1 << (2 * LEVELS):
            row, col = rows[root] + _every_other_bit(here >> 1), cols[root] + _every_other_bit(here)
            # The widest block that begins here, then the blocks in its first corner
            level = LEVELS if here == 0 else lowest_bit(here) // 2
            what = -1
            inside = row < height and col < columns
            while level > 0 and inside:
                block = start[level - 1] + (row >> level) * width[level - 1] + (col >> level)
                if moments[block, 0] <= 0:
                    inside = False
                elif is_cluster(moments[block], max_spread):
                    what = 2 * block + 1
                    px, py, pz, mine = moments[block, 1], moments[block, 2], moments[block, 3], moments[block, 0]
                    break
                else:
                    level -= 1
            here += 1 << (2 * level)
            if level == 0 and inside:
                k = row_of[row, col]
                if k >= 0 and area[k] > 0:
                    what = 2 * k
                    px, py, pz, mine = position[k, 0], position[k, 1], position[k, 2], area[k]
            if what < 0:
                continue
            dx, dy, dz = px - x, py - y, pz - z
            far2 = dx * dx + dy * dy + dz * dz
            if lane == 0 or lane == LANES or far2 > _FAR2 * max(mine, before):
                leaves += 1
                lane = 0
                what = ~what
            order[root, sources] = what
            sources += 1
            lane += 1
            x, y, z, before = px, py, pz, mine
        count[root, 0], count[root, 1] = sources, leaves


@kernel
def _write(first, stop, walked, points, light, lobe, out):  # type: ignore[no-untyped-def]
    """Fill the leaves of root blocks with their sources.

    Parameters
    ----------
    first, stop : int
        Root blocks.
    walked : Walked
    points : TexelPoints
    light : ndarray of shape (L, H * W, 3), float32
    lobe : (MomentPyramid, float32)
        Blocks, and the lobe's variance, mm^2.
    out : _Leaves
        Written.
    """
    order, begin, count, leaf, box = walked.order, out.begin, walked.counts, out.leaf, out.box
    flat_index, position, normal, area = points.flat_index, points.position, points.normal, points.area_mm2
    pyramid, variance = lobe
    moments, mean = pyramid.moments, pyramid.radiosity
    leaves, size = leaf.reshape(-1), leaf.shape[1] * LANES
    for root in range(first, stop):
        k, lane = begin[root] - 1, np.int64(LANES)
        for i in range(count[root, 0]):
            what = order[root, i]
            if what < 0:
                what = ~what
                if i > 0:
                    _close(leaf, k, lane, box)
                k, lane = k + 1, 0
            at, to = what >> 1, k * size + lane
            if what & 1:
                m = moments[at]
                length = max(np.sqrt(m[5] * m[5] + m[6] * m[6] + m[7] * m[7]), np.float32(1e-12))
                for axis in range(3):
                    leaves[to + axis * LANES], leaves[to + (NORMAL + axis) * LANES] = m[1 + axis], m[5 + axis] / length
                narrowing = variance / (variance - m[4])
                leaves[to + NARROWING * LANES], leaves[to + AMPLITUDE * LANES] = narrowing, m[0] * narrowing
            else:
                for axis in range(3):
                    leaves[to + axis * LANES] = position[at, axis]
                    leaves[to + (NORMAL + axis) * LANES] = normal[at, axis]
                leaves[to + NARROWING * LANES], leaves[to + AMPLITUDE * LANES] = 1, area[at]
            put_source(what, flat_index, light, mean, leaves, to + LIGHT * LANES)
            lane += 1
        if count[root, 0] > 0:
            _close(leaf, k, lane, box)


@kernel(inline=True)
def put_source(what, flat_index, light, mean, leaves, to):  # type: ignore[no-untyped-def]
    """Write the light of one source.

    Parameters
    ----------
    what : int
        Its number in `Walked.order`, without the mark of a leaf.
    flat_index : ndarray of shape (T,), int32
        As of `TexelPoints`.
    light : ndarray of shape (L, H * W, 3), float32
    mean : ndarray of shape (B, 3 L), float32
        Of blocks.
    leaves : ndarray, float32
        `SourceTree.leaf`, flat; written.
    to : int
        Where its first channel stands.
    """
    if what & 1:
        for c in range(mean.shape[1]):
            leaves[to + c * LANES] = mean[what >> 1, c]
    else:
        texel = flat_index[what >> 1]
        for each in range(len(light)):
            for c in range(3):
                leaves[to + (3 * each + c) * LANES] = light[each, texel, c]


@kernel(inner=True)
def _close(leaf, k, sources, box):  # type: ignore[no-untyped-def]
    """Fill the places of a leaf beyond its sources, and its box.

    Parameters
    ----------
    leaf, box : ndarrays, float32
        As in `_Leaves`; written.
    k : int
        The leaf.
    sources : int
        How many it has.
    """
    for axis in range(3):
        low, high = _NOWHERE, -_NOWHERE
        for lane in range(sources):
            low, high = min(low, leaf[k, axis, lane]), max(high, leaf[k, axis, lane])
        box[k // LANES, axis, k % LANES], box[k // LANES, 3 + axis, k % LANES] = low, high
    for lane in range(sources, LANES):
        for row in range(leaf.shape[1]):
            leaf[k, row, lane] = _NOWHERE if row < 3 else _ZERO


@kernel(inline=True)
def _every_other_bit(n):  # type: ignore[no-untyped-def]
    """Bits 0, 2, 4, ... 10 of n, side by side."""
    n &= 0x555
    n = (n | n >> 1) & 0x333
    n = (n | n >> 2) & 0x30F
    return (n | n >> 4) & 0x3F
