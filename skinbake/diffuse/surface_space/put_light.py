"""Other light on the sources of a tree: where they are, and the boxes about them, no light changes."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import Tiled
from skinbake.diffuse.surface_space.sources import LIGHT, SourceTree, put_source
from skinbake.diffuse.surface_space.surface_light import LitTile
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES
from skinbake.kernels.threads import parallel_for


def put_light(tree: SourceTree, lit: Tiled[LitTile]) -> None:
    """Give the sources of a tree other light, in place.

    Parameters
    ----------
    tree : SourceTree
    lit : Tiled of LitTile
        On the same points, of as many lights.
    """
    for (walked, begin), tile in zip(tree.walked, lit.values(), strict=True):
        parallel_for(_put_light, len(begin), walked, tile, begin, tree.leaf)


@kernel
def _put_light(first, stop, walked, lit, begin, leaf):  # type: ignore[no-untyped-def]
    """`put_light` of root blocks.

    Parameters
    ----------
    first, stop : int
        Root blocks.
    walked : Walked
    lit : LitTile
        Read.
    begin : ndarray of shape (roots,), int64
        First leaf of each root block.
    leaf : ndarray, float32
        As in `SourceTree`; its light is written.
    """
    order, count = walked.order, walked.counts
    flat_index, light, mean = lit.points.flat_index, lit.radiosity, lit.pyramid.radiosity
    leaves, size = leaf.reshape(-1), leaf.shape[1] * LANES
    for root in range(first, stop):
        k, lane = begin[root] - 1, np.int64(LANES)
        for i in range(count[root, 0]):
            what = order[root, i]
            if what < 0:
                what = ~what
                k, lane = k + 1, 0
            put_source(what, flat_index, light, mean, leaves, k * size + lane + LIGHT * LANES)
            lane += 1
