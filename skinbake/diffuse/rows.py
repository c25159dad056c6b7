"""Sources of a surface sum, sorted into rows along x so that a ball around a target is a few contiguous runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_MAX_ROWS = 1 << 22


@dataclass(frozen=True)
class SourceRows:
    """Sorted sources and where each row starts.

    Attributes
    ----------
    order : ndarray of shape (S,), int64
        Where each sorted source stood before.
    position : ndarray of shape (S, 3), float32
    normal : ndarray of shape (S, 3), float32
    radiosity : ndarray of shape (S, C), float32
    row_start : ndarray of shape (rows_y * rows_z + 1,), int64
    origin : ndarray of shape (3,), float32
    cell : float
        Height and depth of a row, mm.
    rows_y, rows_z : int
    """

    order: NDArray[np.int64]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    radiosity: NDArray[np.float32]
    row_start: NDArray[np.int64]
    origin: NDArray[np.float32]
    cell: np.float32
    rows_y: int
    rows_z: int


def sort_into_rows(
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    radiosity: NDArray[np.float32],
    cell_mm: float,
) -> SourceRows:
    """Order by row (y, z) and inside a row by x; equal keys keep the order they came in."""
    origin = position.min(axis=0)
    extent = np.maximum(position.max(axis=0) - origin, 1e-6).astype(np.float64)
    cell = max(cell_mm, float(np.sqrt(extent[1] * extent[2] / _MAX_ROWS)), float(extent.max()) / (1 << 20))
    rows_y, rows_z = int(extent[1] / cell) + 1, int(extent[2] / cell) + 1
    index_bits = max(1, int(len(position) - 1).bit_length())
    x_bits = 63 - index_bits - int(rows_y * rows_z).bit_length()
    key = np.empty(len(position), dtype=np.uint64)
    x_scale = ((1 << min(x_bits, 24)) - 1) / extent[0]
    cell32 = np.float32(cell)
    _keys(position, origin, cell32, rows_y, rows_z, x_scale, min(x_bits, 24), index_bits, key)
    key.sort()
    order = (key & np.uint64((1 << index_bits) - 1)).astype(np.int64)
    key >>= np.uint64(index_bits + min(x_bits, 24))
    row_start = np.empty(rows_y * rows_z + 1, dtype=np.int64)
    _starts(key, row_start)
    sorted_position = np.empty((len(order), 3), dtype=np.float32)
    sorted_normal = np.empty((len(order), 3), dtype=np.float32)
    sorted_radiosity = np.empty((len(order), radiosity.shape[1]), dtype=np.float32)
    _take(order, position, normal, radiosity, sorted_position, sorted_normal, sorted_radiosity)
    return SourceRows(
        order, sorted_position, sorted_normal, sorted_radiosity, row_start, origin, cell32, rows_y, rows_z
    )


@njit(cache=True, parallel=True)
def _keys(position, origin, cell, rows_y, rows_z, x_scale, x_bits, index_bits, key):  # type: ignore[no-untyped-def]
    for i in prange(len(position)):
        y = min(int(np.floor((position[i, 1] - origin[1]) / cell)), rows_y - 1)
        z = min(int(np.floor((position[i, 2] - origin[2]) / cell)), rows_z - 1)
        x = int((position[i, 0] - origin[0]) * x_scale)
        row = np.uint64(z * rows_y + y)
        key[i] = (((row << np.uint64(x_bits)) | np.uint64(x)) << np.uint64(index_bits)) | np.uint64(i)


@njit(cache=True)
def _starts(row_of, row_start):  # type: ignore[no-untyped-def]
    at = 0
    for row in range(len(row_start)):
        while at < len(row_of) and row_of[at] < np.uint64(row):
            at += 1
        row_start[row] = at


@njit(cache=True, parallel=True)
def _take(order, position, normal, radiosity, to_position, to_normal, to_radiosity):  # type: ignore[no-untyped-def]
    for k in prange(len(order)):
        i = order[k]
        for axis in range(3):
            to_position[k, axis] = position[i, axis]
            to_normal[k, axis] = normal[i, axis]
        for c in range(radiosity.shape[1]):
            to_radiosity[k, c] = radiosity[i, c]
