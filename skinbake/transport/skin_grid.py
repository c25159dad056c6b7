"""What maps of the skin say of each place inside it, for walks: the value at the nearest skin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

CELLS = 24_000_000  # at most; a float32 for each quantity
SHALLOW_MM = 4.0  # down to where changes are resolved finely
ALIKE = 0.1  # of the range of values


class SkinGrid(NamedTuple):
    """Quantities at the corners of cubes, linear between them.

    Attributes
    ----------
    value : ndarray of shape (X, Y, Z, Q), float32
        Of size 0 where nothing varies.
    low_mm : ndarray of shape (3,)
        Place of the first corner, about the rays' centre.
    cell_mm : float
        Side of the cubes.
    least, most : ndarrays of shape (Q,)
        Of the values.
    """

    value: NDArray[np.float32]
    low_mm: Float
    cell_mm: float
    least: Float
    most: Float


def no_grid() -> SkinGrid:
    """The grid of a skin that is the same everywhere."""
    return SkinGrid(np.zeros((0, 0, 0, 0), np.float32), np.zeros(3), 1.0, np.zeros(0), np.zeros(0))


def skin_grid(place_mm: Float, values: Float, cell_mm: float) -> SkinGrid:
    """The values at the nearest of many places of the skin.

    Parameters
    ----------
    place_mm : ndarray of shape (N, 3)
        About the rays' centre, closer to each other than the cubes are wide.
    values : ndarray of shape (N, Q)
    cell_mm : float
        Side of the cubes that is wanted; larger where there would be more of them than `CELLS`.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter
    from scipy.spatial import cKDTree

    low, high = place_mm.min(axis=0) - 2 * cell_mm, place_mm.max(axis=0) + 2 * cell_mm
    count = values.shape[1]
    cell = max(cell_mm, float(np.prod(high - low) / CELLS) ** (1 / 3))
    half = np.ceil((high - low) / (2 * cell)).astype(int) + 2
    value = np.zeros((*(2 * half - 1), count), np.float32)
    # Every other corner first, by the nearest of these at the skin; what lies between only where they are not alike
    at_skin = np.zeros(half, np.bool_)
    seed, first = np.unique(np.rint((place_mm - low) / (2 * cell)).astype(int), axis=0, return_index=True)
    at_skin[tuple(seed.T)] = True
    held = np.zeros((*half, count), np.float32)
    held[tuple(seed.T)] = values[first]
    away, nearest = distance_transform_edt(~at_skin, 2 * cell, return_indices=True)
    value[::2, ::2, ::2] = held[tuple(nearest)]
    differs = np.zeros(half, np.bool_)
    for quantity in range(count):
        coarse = value[::2, ::2, ::2, quantity]
        differs |= maximum_filter(coarse, 3) - minimum_filter(coarse, 3) > ALIKE * np.ptp(values[:, quantity])
    differs &= away <= SHALLOW_MM
    for axis in range(3):
        between, before, after = ([slice(None)] * 3 for _ in range(3))
        between[axis], before[axis], after[axis] = slice(1, None, 2), slice(0, -1, 2), slice(2, None, 2)
        value[tuple(between)] = (value[tuple(before)] + value[tuple(after)]) / 2
    near = differs.repeat(2, 0).repeat(2, 1).repeat(2, 2)[tuple(slice(0, size) for size in value.shape[:3])]
    near[::2, ::2, ::2] = False
    index = np.argwhere(near)
    value[near] = values[cKDTree(place_mm).query(low + cell * index, workers=-1)[1]]
    return SkinGrid(value, low, float(cell), values.min(axis=0), values.max(axis=0))


@kernel(inner=True)
def value_at(grid, quantity, x, y, z):  # type: ignore[no-untyped-def]
    """A quantity at a place, linear between the corners of the cubes.

    Parameters
    ----------
    grid : SkinGrid
    quantity : int
    x, y, z : float
        mm about the rays' centre.
    """
    value = grid.value
    a = min(max((x - grid.low_mm[0]) / grid.cell_mm, 0.0), value.shape[0] - 1.001)
    b = min(max((y - grid.low_mm[1]) / grid.cell_mm, 0.0), value.shape[1] - 1.001)
    c = min(max((z - grid.low_mm[2]) / grid.cell_mm, 0.0), value.shape[2] - 1.001)
    i, j, k = int(a), int(b), int(c)
    a, b, c = a - i, b - j, c - k
    q = quantity
    first = (1.0 - c) * value[i, j, k, q] + c * value[i, j, k + 1, q]
    second = (1.0 - c) * value[i, j + 1, k, q] + c * value[i, j + 1, k + 1, q]
    third = (1.0 - c) * value[i + 1, j, k, q] + c * value[i + 1, j, k + 1, q]
    fourth = (1.0 - c) * value[i + 1, j + 1, k, q] + c * value[i + 1, j + 1, k + 1, q]
    return (1.0 - a) * ((1.0 - b) * first + b * second) + a * ((1.0 - b) * third + b * fourth)
