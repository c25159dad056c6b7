"""How dense a medium is from place to place inside the skin, for walks: what a map says of the nearest skin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

CELLS = 24_000_000  # at most; of float32
SHALLOW_MM = 4.0  # down to where changes are resolved finely
ALIKE = 0.1  # of the range of densities


class DensityGrid(NamedTuple):
    """Factor on every coefficient of a medium, at the corners of cubes, linear between them.

    Attributes
    ----------
    value : ndarray of shape (X, Y, Z), float32
    low_mm : ndarray of shape (3,)
        Place of the first corner, about the rays' centre.
    cell_mm : float
        Side of the cubes.
    least, most : float
        Of the values.
    """

    value: NDArray[np.float32]
    low_mm: Float
    cell_mm: float
    least: float
    most: float


def density_grid(place_mm: Float, density: Float, cell_mm: float) -> DensityGrid:
    """The density at the nearest of many places of the skin.

    Parameters
    ----------
    place_mm : ndarray of shape (N, 3)
        About the rays' centre, closer to each other than the cubes are wide.
    density : ndarray of shape (N,)
    cell_mm : float
        Side of the cubes that is wanted; larger where there would be more of them than `CELLS`.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter
    from scipy.spatial import cKDTree

    low, high = place_mm.min(axis=0) - 2 * cell_mm, place_mm.max(axis=0) + 2 * cell_mm
    cell = max(cell_mm, float(np.prod(high - low) / CELLS) ** (1 / 3))
    half = np.ceil((high - low) / (2 * cell)).astype(int) + 2
    value = np.zeros(2 * half - 1, np.float32)
    # Every other corner first, by the nearest of these at the skin; what lies between only where they are not alike
    at_skin = np.zeros(half, np.bool_)
    seed, first = np.unique(np.rint((place_mm - low) / (2 * cell)).astype(int), axis=0, return_index=True)
    at_skin[tuple(seed.T)] = True
    held = np.zeros(half, np.float32)
    held[tuple(seed.T)] = density[first]
    away, nearest = distance_transform_edt(~at_skin, 2 * cell, return_indices=True)
    value[::2, ::2, ::2] = held[tuple(nearest)]
    coarse = value[::2, ::2, ::2]
    differs = maximum_filter(coarse, 3) - minimum_filter(coarse, 3) > ALIKE * np.ptp(density)
    differs &= away <= SHALLOW_MM
    for axis in range(3):
        between, before, after = ([slice(None)] * 3 for _ in range(3))
        between[axis], before[axis], after[axis] = slice(1, None, 2), slice(0, -1, 2), slice(2, None, 2)
        value[tuple(between)] = (value[tuple(before)] + value[tuple(after)]) / 2
    near = differs.repeat(2, 0).repeat(2, 1).repeat(2, 2)[tuple(slice(0, size) for size in value.shape)]
    near[::2, ::2, ::2] = False
    index = np.argwhere(near)
    value[near] = density[cKDTree(place_mm).query(low + cell * index, workers=-1)[1]]
    return DensityGrid(value, low, float(cell), float(density.min()), float(density.max()))


@kernel(inner=True)
def most_dense(grid):  # type: ignore[no-untyped-def]
    """Greatest density; 1 where there is no grid: such branches are decided as a kernel is compiled."""
    if grid is None:
        return 1.0
    return grid.most


@kernel(inner=True)
def least_dense(grid):  # type: ignore[no-untyped-def]
    """Least density; 1 where there is no grid."""
    if grid is None:
        return 1.0
    return grid.least


@kernel(inner=True)
def density_at(grid, x, y, z):  # type: ignore[no-untyped-def]
    """Density at a place, linear between the corners of the cubes; 1 where there is no grid.

    Parameters
    ----------
    grid : DensityGrid or None
    x, y, z : float
        mm about the rays' centre.
    """
    if grid is None:
        return 1.0
    value = grid.value
    a = min(max((x - grid.low_mm[0]) / grid.cell_mm, 0.0), value.shape[0] - 1.001)
    b = min(max((y - grid.low_mm[1]) / grid.cell_mm, 0.0), value.shape[1] - 1.001)
    c = min(max((z - grid.low_mm[2]) / grid.cell_mm, 0.0), value.shape[2] - 1.001)
    i, j, k = int(a), int(b), int(c)
    a, b, c = a - i, b - j, c - k
    first = (1.0 - c) * value[i, j, k] + c * value[i, j, k + 1]
    second = (1.0 - c) * value[i, j + 1, k] + c * value[i, j + 1, k + 1]
    third = (1.0 - c) * value[i + 1, j, k] + c * value[i + 1, j, k + 1]
    fourth = (1.0 - c) * value[i + 1, j + 1, k] + c * value[i + 1, j + 1, k + 1]
    return (1.0 - a) * ((1.0 - b) * first + b * second) + a * ((1.0 - b) * third + b * fourth)


@kernel(inner=True)
def thickness(grid, at, direction, way):  # type: ignore[no-untyped-def]
    """Integral of the density along a line, mm, by middles of steps of half a cube; `way` without a grid.

    Parameters
    ----------
    grid : DensityGrid or None
    at, direction : tuples of three floats
        Its beginning, mm about the rays' centre, and unit direction.
    way : float
        mm.
    """
    if grid is None:
        return way
    steps = 1 + int(2.0 * way / grid.cell_mm)
    step, total = way / steps, 0.0
    for n in range(steps):
        t = (n + 0.5) * step
        total += density_at(grid, at[0] + t * direction[0], at[1] + t * direction[1], at[2] + t * direction[2])
    return total * step
