"""Skin that is near in space and far off along the texture: the other side of an ear, of a fold, of a seam.

Blocks of 8 x 8 texels stand for the skin. Two of them are foreign to one another where the way between them in the
texture, as long on the skin as the smaller of their texels makes it at least, is more than twice the straight one; on
two tiles they always are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.diffuse.clusters import MomentPyramid

LEVEL = 3  # of the pyramid's blocks, 1 being 2 x 2 texels
_REACH = 4.0  # mean block sides: skin further off is not looked for
_WAY = 2.0  # straight distances
_HALF_SIDE = 1.8  # roots of a square's spread, which is a twelfth of its area
_PRIMES = (73856093, 19349663, 83492791)  # of the hash of a cell


def distance_to_foreign(pyramids: Sequence[MomentPyramid]) -> list[NDArray[np.float32]]:
    """Least straight distance, in mm, from each block of each tile to skin that is foreign to it.

    Returns
    -------
    list of ndarray of shape (h / 8, w / 8), float32
        Infinite where none is within four blocks.
    """
    parts, shapes = [], []
    for tile, pyramid in enumerate(pyramids):
        start, stop, width = pyramid.start[LEVEL - 1], pyramid.start[LEVEL], pyramid.width[LEVEL - 1]
        moments = pyramid.moments[start:stop].astype(np.float64)
        row, col = np.divmod(np.arange(stop - start), width)
        parts.append(np.column_stack([moments[:, :5], np.full(len(row), tile), row, col]))
        shapes.append((-1, int(width)))
    block = np.concatenate(parts)
    skin = np.flatnonzero(block[:, 0] > 0)
    area, spread = block[skin, 0], block[skin, 4]
    # Sides of the rectangle that has this area and spread (a^2 + b^2) / 24; the shorter one
    both = 24 * spread
    shorter = np.sqrt(np.maximum(both - np.sqrt(np.maximum(both**2 - 4 * area**2, 0)), 0) / 2)
    reach = _REACH * float(np.sqrt(area.mean())) if len(skin) else 1.0
    cell = np.floor(block[skin, 1:4] / max(reach, 1e-9)).astype(np.int64)
    found = np.full(len(block), np.inf, np.float32)
    found[skin] = _distances(
        np.ascontiguousarray(block[skin, 1:4]), _HALF_SIDE * np.sqrt(spread), shorter, block[skin, 5:], cell,
        1 << max(int(np.ceil(np.log2(max(len(skin), 1)))), 1),
    )  # fmt: skip
    tiles = np.split(found, np.cumsum([len(part) for part in parts])[:-1])
    return [values.reshape(shape) for values, shape in zip(tiles, shapes, strict=True)]


@njit(cache=True, inline="always")
def _bucket(x, y, z, buckets):  # type: ignore[no-untyped-def]
    return (x * _PRIMES[0] ^ y * _PRIMES[1] ^ z * _PRIMES[2]) & (buckets - 1)


@njit(cache=True, parallel=True)
def _distances(centre, radius, side, place, cell, buckets):  # type: ignore[no-untyped-def]
    first, following = np.full(buckets, -1), np.empty(len(centre), np.int64)
    for k in range(len(centre)):
        bucket = _bucket(cell[k, 0], cell[k, 1], cell[k, 2], buckets)
        following[k], first[bucket] = first[bucket], k
    nearest = np.empty(len(centre), np.float32)
    for k in prange(len(centre)):
        best = np.inf
        for neighbour in range(27):
            x, y = cell[k, 0] + neighbour // 9 - 1, cell[k, 1] + neighbour // 3 % 3 - 1
            z = cell[k, 2] + neighbour % 3 - 1
            other = first[_bucket(x, y, z, buckets)]
            while other >= 0:
                if cell[other, 0] == x and cell[other, 1] == y and cell[other, 2] == z:
                    dx, dy = centre[other, 0] - centre[k, 0], centre[other, 1] - centre[k, 1]
                    dz = centre[other, 2] - centre[k, 2]
                    straight = np.sqrt(dx * dx + dy * dy + dz * dz)
                    gap = max(straight - radius[k] - radius[other], 0.0)
                    if gap < best:
                        down, across = place[other, 1] - place[k, 1], place[other, 2] - place[k, 2]
                        # Between the blocks' nearest corners, not their middles
                        way = (np.sqrt(down * down + across * across) - np.sqrt(2.0)) * min(side[k], side[other])
                        if way > _WAY * straight or place[other, 0] != place[k, 0]:
                            best = gap
                other = following[other]
        nearest[k] = best
    return nearest
