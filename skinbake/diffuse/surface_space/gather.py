"""The sums of the surface method at every texel of a tile, in batches of sixteen neighbours (`batch_sum`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.lattice import lattice_table, lattice_variance
from skinbake.diffuse.surface_space.batch_sum import BLOCK, SUMS, TINY, Room, Sums, Target, gather_batch, take_near
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.surface_space.source_search import GROUPS, STACK, Search, near_boxes, tree_node
from skinbake.diffuse.surface_space.sources import SourceTree
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import even_stride

CUT_ERROR = 0.1  # measured: normalised sums cut at k sigma are wrong by this exp(-k^2 / 2), rms of hard-lit skin
_CUT_SHARE = 0.1  # of the tolerance
_SQUARE = 8  # x 8 texels share batches, where few are
_ACROSS = _SQUARE // BLOCK  # blocks along a square
_TILE = 16  # x 16 texels begin their searches at the same groups
_ONE = np.int64(1)


class SumRule(NamedTuple):
    """What all surface sums of a bake have in common.

    Attributes
    ----------
    cut : float
        A target looks at least this many sigma far.
    separate : bool
        p_ts is the share that `pair_weight` lets pass, else 1.
    normalise : bool
        False: a sum is not divided by that of the weights, but by a plane's, 2 pi v / gain_t.
    """

    cut: float
    separate: bool
    normalise: bool


def cut_sigma(tolerance: float, normalise: bool = True) -> float:
    """How far, in sigma, sums must look for what lies beyond to take its small share of a tolerance.

    Not normalised, all of the light beyond is missing: exp(-k^2 / 2).
    """
    beyond = _CUT_SHARE * max(tolerance, 1e-9) / (CUT_ERROR if normalise else 1.0)
    return float(np.sqrt(2 * np.log(1 / min(beyond, np.exp(-2)))))


def gather(
    points: TexelPoints,
    tree: SourceTree,
    variance_mm2: float,
    rule: SumRule,
    out: NDArray[np.float32],
    first_light: int = 0,
    share: NDArray[np.uint8] | None = None,
    read: float = 0.0,
) -> None:
    """out[t] = sum_s w_ts radiosity_s / sum_s w_ts, w_ts = amplitude_s exp(-d_ts^2 narrowing_s / 2 v_t) p_ts.

    Parameters
    ----------
    points : TexelPoints
        Targets. Where their texels are coarser than the lobe, v_t is widened so that their lattice still spreads light
        by `variance_mm2` (`lattice_variance`).
    tree : SourceTree
        Sources.
    variance_mm2 : float
        Of the lobe.
    rule : SumRule
    out : ndarray of shape (L, H * W, 3), float32
        Left as it was where there is no target, or nothing near one.
    first_light : int
        Of the tree's lights, L of which are summed.
    share : ndarray of shape (H, W), uint8, optional
        How much the sum counts against what `out` held, in steps of 1 / 255; at 0 there is none.
    read : float, optional
        Texels by which reading `out` spreads light (`LobeResources.read_texels2`): v_t is less by that.
    """
    strips = -(-points.row.shape[0] // _TILE)
    density = 0.0 if rule.normalise else 1 / (2 * np.pi * variance_mm2)
    faint = np.float32(TINY * (tree.largest or 1.0))
    sums = Sums(
        variance_mm2, lattice_table(), np.float32(rule.cut), rule.separate, faint, np.float32(density), first_light,
        np.float32(read),
    )  # fmt: skip
    target = Target(np.empty((0, 0), np.uint8) if share is None else share, out)
    parallel_for(_gather, strips, _Strips(strips, even_stride(strips)), points, tree.arrays, sums, target)


class _Strips(NamedTuple):
    """Strips of `_TILE` rows: k `stride` mod `total` is the k-th one."""

    total: int
    stride: int


@kernel
def _gather(first, stop, strips, points, tree, sums, target):  # type: ignore[no-untyped-def]
    """`gather` of some strips.

    Parameters
    ----------
    first, stop : int
        Strips.
    strips : _Strips
    points : TexelPoints
    tree : TreeArrays
    sums : Sums
    target : Target
        Written.
    """
    height, width = points.row.shape
    for strip in range(first, stop):
        lanes = np.empty((SUMS + 1 + 3 * len(target.out)) * LANES, np.float32)
        low, high = np.empty(3, np.float32), np.empty(3, np.float32)
        search = Search(np.empty(STACK, np.int64), np.empty(len(tree.leaf), np.int64))
        members, batch = np.empty(_SQUARE * _SQUARE, np.int64), np.empty(LANES, np.int64)
        room = Room(lanes, low, high, search, np.empty(STACK // 2, np.int64), members, batch)
        top = (strip * strips.stride) % strips.total * _TILE
        for left in range(0, width, _TILE):
            begins = _begin_near_tile(points, target.share, (top, left), tree, sums, room)
            if begins == 0:
                continue
            for row in range(top, min(top + _TILE, height), _SQUARE):
                for col in range(left, min(left + _TILE, width), _SQUARE):
                    taken, count = 0, _members_of(points.row, target.share, row, col, members)
                    while taken < count:
                        taken = take_near(room, taken, count, points, sums)
                        for i in range(begins):
                            search.stack[i] = room.begin[i]
                        gather_batch(points, tree, sums, room, begins, target)


@kernel(inline=True)
def _members_of(row_of, share, top, left, members):  # type: ignore[no-untyped-def]
    """List the targets of a square, block after block; how many there are."""
    height, width = row_of.shape
    count = 0
    for block in range(_ACROSS * _ACROSS):
        row, col = top + block // _ACROSS * BLOCK, left + block % _ACROSS * BLOCK
        for r in range(row, min(row + BLOCK, height)):
            for c in range(col, min(col + BLOCK, width)):
                if row_of[r, c] >= 0 and (len(share) == 0 or share[r, c] > 0):
                    members[count] = row_of[r, c]
                    count += 1
    return count


@kernel(inner=True)
def _begin_near_tile(points, share, corner, tree, sums, room):  # type: ignore[no-untyped-def]
    """Where the search of all of a tile's batches begins: groups near the tile, the root if these are too many.

    Parameters
    ----------
    points : TexelPoints
    share : ndarray of shape (H, W) or (0, 0), uint8
    corner : tuple of two ints
        First row and column of the tile.
    tree : TreeArrays
    sums : Sums
    room : Room
        Its `begin` is written.

    Returns
    -------
    int
        How many groups; 0 where the tile has no target.
    """
    top, left = corner
    row_of, position, texel_mm2, low, high, begin = (
        points.row,
        points.position,
        points.texel_mm2,
        room.low,
        room.high,
        room.begin,
    )
    for axis in range(3):
        low[axis], high[axis] = np.inf, -np.inf
    widest = np.float32(-1)
    for r in range(top, min(top + _TILE, row_of.shape[0])):
        for c in range(left, min(left + _TILE, row_of.shape[1])):
            k = row_of[r, c]
            if k >= 0 and (len(share) == 0 or share[r, c] > 0):
                widest = max(widest, texel_mm2[k])
                for axis in range(3):
                    low[axis], high[axis] = min(low[axis], position[k, axis]), max(high[axis], position[k, axis])
    if low[0] > high[0]:
        return 0
    root = tree_node(0, len(tree.first_group) - 1)
    if len(tree.first_group) > 1:
        reach = sums.cut * np.sqrt(np.float32(lattice_variance(sums.variance_mm2, widest, sums.table)))
        room.search.stack[0] = root
        count = near_boxes(low, high, reach * reach, tree, room.search, _ONE, GROUPS)
        if count <= len(begin):
            for i in range(count):
                begin[i] = tree_node(room.search.found[i], 0)
            return count
    begin[0] = root
    return 1
