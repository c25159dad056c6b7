"""Sources of a surface sum, sorted into rows along x so that a ball around a target is a few contiguous runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_MAX_ROWS = 1 << 22
NORMAL, NARROWING, AMPLITUDE, LIGHT = 3, 6, 7, 8  # columns of a source


@dataclass(frozen=True)
class SourceRows:
    """Sorted sources and where each row starts.

    Attributes
    ----------
    source : ndarray of shape (S, 8 + C), float32
        A line of memory each: position (mm), normal, `NARROWING`, `AMPLITUDE`, and the radiosity from `LIGHT` on.
    row_start : ndarray of shape (rows_y * rows_z + 1,), int64
    origin : ndarray of shape (3,), float32
    cell : float
        Height and depth of a row, mm.
    rows_y, rows_z : int
    """

    source: NDArray[np.float32]
    row_start: NDArray[np.int64]
    origin: NDArray[np.float32]
    cell: np.float32
    rows_y: int
    rows_z: int


def sort_into_rows(source: NDArray[np.float32], cell_mm: float) -> SourceRows:
    """Order by row (y, z) and inside a row by x; equal keys keep the order they came in."""
    # Column by column: NumPy's reduction over the long axis of a narrow array is ten times slower
    origin = np.array([source[:, axis].min() for axis in range(3)])
    top = np.array([source[:, axis].max() for axis in range(3)])
    extent = np.maximum(top - origin, 1e-6).astype(np.float64)
    cell = max(cell_mm, float(np.sqrt(extent[1] * extent[2] / _MAX_ROWS)), float(extent.max()) / (1 << 20))
    rows_y, rows_z = int(extent[1] / cell) + 1, int(extent[2] / cell) + 1
    index_bits = max(1, int(len(source) - 1).bit_length())
    x_bits = min(63 - index_bits - int(rows_y * rows_z).bit_length(), 24)
    key = np.empty(len(source), dtype=np.uint64)
    cell32 = np.float32(cell)
    _keys(source, origin, cell32, rows_y, rows_z, ((1 << x_bits) - 1) / extent[0], x_bits, index_bits, key)
    key.sort()
    row_start = np.empty(rows_y * rows_z + 1, dtype=np.int64)
    _starts(key, np.uint64(index_bits + x_bits), row_start)
    key &= np.uint64((1 << index_bits) - 1)
    return SourceRows(_taken(source, key), row_start, origin, cell32, rows_y, rows_z)


@njit(cache=True, parallel=True)
def _keys(source, origin, cell, rows_y, rows_z, x_scale, x_bits, index_bits, key):  # type: ignore[no-untyped-def]
    for i in prange(len(source)):
        y = min(int(np.floor((source[i, 1] - origin[1]) / cell)), rows_y - 1)
        z = min(int(np.floor((source[i, 2] - origin[2]) / cell)), rows_z - 1)
        x = int((source[i, 0] - origin[0]) * x_scale)
        row = np.uint64(z * rows_y + y)
        key[i] = (((row << np.uint64(x_bits)) | np.uint64(x)) << np.uint64(index_bits)) | np.uint64(i)


@njit(cache=True)
def _starts(key, shift, row_start):  # type: ignore[no-untyped-def]
    at = 0
    for row in range(len(row_start)):
        while at < len(key) and (key[at] >> shift) < np.uint64(row):
            at += 1
        row_start[row] = at


@njit(cache=True, parallel=True)
def _taken(source, order):  # type: ignore[no-untyped-def]
    out = np.empty_like(source)
    for k in prange(len(order)):
        for c in range(source.shape[1]):
            out[k, c] = source[order[k], c]
    return out
