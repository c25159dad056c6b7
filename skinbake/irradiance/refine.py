"""Values that are costly to trace: found on a coarse lattice of texels, and on finer ones only where they vary."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
TURN_COSINE = 0.94  # 20 degrees: a crease may lie between lattice points that agree, but its normals give it away


def refine(
    wanted: NDArray[np.bool_],
    normal: Image,
    channels: int,
    trace: Callable[[NDArray[np.int64], int], Image],
    tolerance: float,
    coarsest: int,
    close: int = 0,
    out: Image | None = None,
) -> Image:
    """Trace a lattice of texels, then, level by level, those between that cannot be interpolated from it.

    A texel is interpolated, bilinearly, where its four neighbours on the lattice differ by at most `tolerance` and its
    normal is within 20 degrees of theirs; so its value lies between values which differ by at most `tolerance`. Beside
    the border of a chart, where some of the four are missing, it is traced, unless the lattice is `close`.

    Parameters
    ----------
    wanted : ndarray of shape (H, W)
        Texels that need a value; only they are traced, and only they take part in interpolation.
    channels : int
    trace : callable
        From texels (row * W + col) of a lattice and its stride to values of shape (n, channels).
    normal : ndarray of shape (H, W, 3)
        Unit, smooth.
    tolerance : float
        0: interpolate only between equal values.
    coarsest : int
        Texels between the points of the first lattice, a power of two.
    close : int
        Texels between lattice points up to which those that are there speak for those that are missing.
    out : ndarray of shape (H, W, channels), optional
        Where to write the result.

    Returns
    -------
    ndarray of shape (H, W, channels), float32
        Zero where not wanted.
    """
    height, width = wanted.shape
    values = np.empty((height, width, channels), np.float32) if out is None else out
    values[...] = 0
    stride = coarsest
    rows, cols = np.nonzero(wanted[::stride, ::stride])
    texels = stride * rows * width + stride * cols
    while True:
        values.reshape(-1, channels)[texels] = trace(texels, stride)
        if stride == 1:
            return values
        stride //= 2
        left = np.zeros((height, width), np.bool_)
        lines = -(-height // stride)
        rule = _LatticeRule(stride, float(tolerance), 2 * stride <= close)
        parallel_for(_between, lines, wanted, normal, values, rule, left)
        texels = np.flatnonzero(left)


class _LatticeRule(NamedTuple):
    """What is interpolated from a lattice.

    Attributes
    ----------
    stride : int
        Texels between points of the fine lattice; the wide one has half as many.
    tolerance : float
        Difference of neighbours up to which a value is interpolated.
    some : bool
        Whether fewer than four neighbours suffice.
    """

    stride: int
    tolerance: float
    some: bool


@kernel
def _between(
    first: int,
    stop: int,
    wanted: NDArray[np.bool_],
    normal: Image,
    values: Image,
    rule: _LatticeRule,
    to_trace: NDArray[np.bool_],
) -> None:
    """Mark the texels of the lattice of `stride` to trace; the others are interpolated from the lattice twice as wide.

    Parameters
    ----------
    first, stop : int
        Rows of the fine lattice.
    wanted : ndarray of shape (H, W)
    normal : ndarray of shape (H, W, 3)
        Unit, smooth.
    values : ndarray of shape (H, W, channels)
        Read on the wide lattice, written on the fine one.
    rule : _LatticeRule
    to_trace : ndarray of shape (H, W)
        Written on the fine lattice.
    """
    height, width = wanted.shape
    stride, tolerance, some = rule.stride, rule.tolerance, rule.some
    wide = 2 * stride
    channels = values.shape[2]
    for row_block in range(first, stop):
        row = row_block * stride
        for col in range(0, width, stride):
            if not wanted[row, col] or (row % wide == 0 and col % wide == 0):
                continue
            r0, c0 = row - row % wide, col - col % wide
            r1, c1 = r0 + wide if row % wide else r0, c0 + wide if col % wide else c0
            present, agree = 0, True
            nx, ny, nz = normal[row, col, 0], normal[row, col, 1], normal[row, col, 2]
            for r in (r0, r1):
                for c in (c0, c1):
                    if r < height and c < width and wanted[r, c]:
                        cosine = nx * normal[r, c, 0] + ny * normal[r, c, 1] + nz * normal[r, c, 2]
                        agree = agree and cosine >= TURN_COSINE
                        present += 1
            # Beside a chart's border nothing bounds what lies between
            agree = agree and (present == 4 or (some and present > 0))
            for k in range(channels):
                low, high, total = np.float32(np.inf), np.float32(-np.inf), 0.0
                if agree:
                    for r in (r0, r1):
                        for c in (c0, c1):
                            if r < height and c < width and wanted[r, c]:
                                low, high = min(low, values[r, c, k]), max(high, values[r, c, k])
                                total += values[r, c, k]
                    if high - low > tolerance:
                        agree = False
                    values[row, col, k] = total / present  # traced after all where a later channel disagrees
            to_trace[row, col] = not agree
