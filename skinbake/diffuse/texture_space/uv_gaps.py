"""Skin that is near in space and far off along the texture: the other side of an ear, of a fold, of a seam.

Blocks of 8 x 8 texels stand for the skin. Two of them are foreign to one another where the way between them in the
texture, as long on the skin as the smaller of their texels makes it at least, is more than twice the straight one; on
two tiles they always are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled
from skinbake.diffuse.surface_space.clusters import MomentPyramid
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

LEVEL = 3  # of the pyramid's blocks, 1 being 2 x 2 texels
_REACH = 4.0  # mean block sides: skin further off is not looked for
_WAY = 2.0  # straight distances
_HALF_SIDE = 1.8  # roots of a square's spread, which is a twelfth of its area
_MOST_CELLS = 1 << 20  # along an axis


def distance_to_foreign(pyramids: Tiled[MomentPyramid]) -> Tiled[NDArray[np.float32]]:
    """Least straight distance, in mm, from each block of each tile to skin that is foreign to it.

    Returns
    -------
    Tiled of ndarray of shape (h / 8, w / 8), float32
        Infinite where none is within four blocks.
    """
    parts, shapes = [], []
    for tile, pyramid in pyramids.items():
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
    key = _cells(block[skin, 1:4], reach)
    order = np.argsort(key, kind="stable")
    skin, key = skin[order], key[order]
    cell, first = np.unique(key, return_index=True)
    found = np.full(len(block), np.inf, np.float32)
    first = np.append(first, len(skin))
    # z - 1, z and z + 1 lie behind one another: nine columns of cells
    middle = cell[:, None] + (np.arange(-1, 2)[:, None] * _MOST_CELLS + np.arange(-1, 2)).ravel() * _MOST_CELLS
    begin, end = (first[np.searchsorted(cell, middle + step)] for step in (-1, 2))
    nearest = np.empty(len(skin), np.float32)
    blocks = _Blocks(block[skin, 1:4], _HALF_SIDE * np.sqrt(spread[order]), shorter[order], block[skin, 5:])
    parallel_for(_distances, len(cell), blocks, _Cells(first, begin, end), nearest)
    found[skin] = nearest
    tiles = np.split(found, np.cumsum([len(part) for part in parts])[:-1])
    return {tile: values.reshape(shape) for tile, values, shape in zip(pyramids, tiles, shapes, strict=True)}


def _cells(position: Float, side: float) -> NDArray[np.int64]:
    """Number of the cube that holds each position, (n,): z counts ones, the least of any is 1."""
    from_corner = (position - position.min(axis=0, initial=np.inf)) / max(side, 1e-9)
    x, y, z = np.minimum(from_corner + 1, _MOST_CELLS - 2).astype(np.int64).T
    cells: NDArray[np.int64] = (x * _MOST_CELLS + y) * _MOST_CELLS + z
    return cells


class _Blocks(NamedTuple):
    """Blocks of texels that have skin, in the order of their cells.

    Attributes
    ----------
    centre : ndarray of shape (B, 3)
        mm.
    radius, side : ndarrays of shape (B,)
        Half the side of a square of its spread, and its shorter side, mm.
    place : ndarray of shape (B, 3)
        Tile, row and column.
    """

    centre: Float
    radius: Float
    side: Float
    place: Float


class _Cells(NamedTuple):
    """Which blocks lie in each cell of a grid, and around it.

    Attributes
    ----------
    of_cell : ndarray of shape (cells + 1,), int64
        Blocks of cell c are of_cell[c] ... of_cell[c + 1].
    begin, end : ndarrays of shape (cells, 9), int64
        Those of each column of cells around it.
    """

    of_cell: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]


@kernel
def _distances(first, stop, blocks, cells, nearest):  # type: ignore[no-untyped-def]
    """Least distance of blocks to foreign skin.

    Parameters
    ----------
    first, stop : int
        Cells.
    blocks : _Blocks
    cells : _Cells
    nearest : ndarray of shape (B,), float32
        Written, mm; infinite where none is near.
    """
    centre, radius, side, place = blocks.centre, blocks.radius, blocks.side, blocks.place
    of_cell, begin, end = cells.of_cell, cells.begin, cells.end
    for c in range(first, stop):
        for k in range(of_cell[c], of_cell[c + 1]):
            nearest[k] = np.inf
        for column in range(begin.shape[1]):
            for k in range(of_cell[c], of_cell[c + 1]):
                best = nearest[k]
                for other in range(begin[c, column], end[c, column]):
                    dx, dy = centre[other, 0] - centre[k, 0], centre[other, 1] - centre[k, 1]
                    dz = centre[other, 2] - centre[k, 2]
                    straight2 = dx * dx + dy * dy + dz * dz
                    down, across = place[other, 1] - place[k, 1], place[other, 2] - place[k, 2]
                    shorter = min(side[k], side[other])
                    elsewhere = place[other, 0] != place[k, 0]
                    # Most are neighbours in the texture: the way between their middles tells, without a root
                    if elsewhere or (down * down + across * across) * shorter * shorter > _WAY * _WAY * straight2:
                        straight = np.sqrt(straight2)
                        gap = max(straight - radius[k] - radius[other], 0.0)
                        # Between the blocks' nearest corners
                        way = (np.sqrt(down * down + across * across) - np.sqrt(2.0)) * shorter
                        if gap < best and (elsewhere or way > _WAY * straight):
                            best = gap
                nearest[k] = best
