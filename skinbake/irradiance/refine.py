"""Values that are dear to trace, found on a coarse lattice of texels and only where they vary on finer ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Image = NDArray[np.float32]
COARSEST = 4  # texels between the first lattice's points


def refine(
    wanted: NDArray[np.bool_], channels: int, trace: Callable[[NDArray[np.int64]], Image], tolerance: float
) -> Image:
    """Trace every fourth texel, then those between whose neighbours on the lattice differ by more than `tolerance`.

    The rest is interpolated bilinearly, so that it lies between values which differ by at most `tolerance`.

    Parameters
    ----------
    wanted : ndarray of shape (H, W)
        Texels that need a value; only they are traced, and only they take part in interpolation.
    channels : int
    trace : callable
        From texels (row * W + col) to values of shape (n, channels).
    tolerance : float
        0: interpolate only between equal values.

    Returns
    -------
    ndarray of shape (H, W, channels), float32
        Zero where not wanted.
    """
    height, width = wanted.shape
    values = np.zeros((height, width, channels), np.float32)
    known = np.zeros((height, width), np.bool_)
    stride = COARSEST
    rows, cols = np.nonzero(wanted[::stride, ::stride])
    texels = stride * rows * width + stride * cols
    while True:
        values.reshape(-1, channels)[texels] = trace(texels)
        known.reshape(-1)[texels] = True
        if stride == 1:
            return values
        stride //= 2
        texels = np.flatnonzero(_between(wanted, values, known, stride, tolerance))


@njit(cache=True, parallel=True)
def _between(
    wanted: NDArray[np.bool_], values: Image, known: NDArray[np.bool_], stride: int, tolerance: float
) -> NDArray[np.bool_]:
    """Texels of the lattice of `stride` to trace; the others are interpolated from the lattice twice as wide."""
    height, width = wanted.shape
    wide = 2 * stride
    channels = values.shape[2]
    to_trace = np.zeros((height, width), dtype=np.bool_)
    for row_block in prange((height + stride - 1) // stride):
        row = row_block * stride
        for col in range(0, width, stride):
            if not wanted[row, col] or (row % wide == 0 and col % wide == 0):
                continue
            r0, c0 = row - row % wide, col - col % wide
            r1, c1 = r0 + wide if row % wide else r0, c0 + wide if col % wide else c0
            if r1 >= height or c1 >= width:
                to_trace[row, col] = True
                continue
            if not (wanted[r0, c0] and wanted[r0, c1] and wanted[r1, c0] and wanted[r1, c1]):
                to_trace[row, col] = True
                continue
            for k in range(channels):
                a, b, c, d = values[r0, c0, k], values[r0, c1, k], values[r1, c0, k], values[r1, c1, k]
                if max(a, b, c, d) - min(a, b, c, d) > tolerance:
                    to_trace[row, col] = True
            if not to_trace[row, col]:
                for k in range(channels):
                    values[row, col, k] = 0.25 * (
                        values[r0, c0, k] + values[r0, c1, k] + values[r1, c0, k] + values[r1, c1, k]
                    )
    return to_trace
