"""Normal maps for pictures whose pixels are wider than its texels: mean normals, and how much they vary about them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

LEVELS = 6  # the last texel stands for 32 x 32: beyond that, most are mixed with those of other charts
_BAND = 64  # rows; even


def normal_levels(normal: NDArray[np.floating], strength: float, space: str) -> list[NDArray[np.floating]]:
    """The map, and means over 2, 4, ... texels a side, each of shape (h, w, 4), in the map's type.

    The first three channels are normals, not unit, without the strength; the last is the sum of both slopes' variances
    that the texel stands for, of normals bent by the strength: 0 in the map itself. An odd row or column is dropped, as
    OpenGL's levels have it.

    Parameters
    ----------
    normal : ndarray of shape (h, w, 3)
    strength : float
        Factor on x and y, in tangent space.
    space : "tangent" or "object"

    References
    ----------
    [Toksvig2005]
    """
    height, width = normal.shape[:2]
    levels = [np.zeros((height, width, 4), normal.dtype)]
    levels[0][..., :3] = normal
    bend = np.array([strength, strength, 1.0] if space == "tangent" else [1.0, 1.0, 1.0], np.float32)
    if LEVELS == 1 or max(height, width) == 1:
        return levels
    sums = np.empty((max(height // 2, 1), max(width // 2, 1), 4), np.float32)
    for row in range(0, len(sums), _BAND):  # as floats the map would be many times as large
        band = np.ascontiguousarray(normal[2 * row : 2 * (row + _BAND)], np.float32)
        into = sums[row : row + _BAND]
        parallel_for(_sum_units, len(into), band, bend, space == "tangent", into)
    while True:
        levels.append(np.empty(sums.shape, normal.dtype))
        for row in range(0, len(sums), _BAND):
            some = sums[row : row + _BAND]
            level = np.empty(some.shape)
            parallel_for(_means, len(some), some, bend, level)
            levels[-1][row : row + _BAND] = level
        if len(levels) == LEVELS or max(sums.shape[:2]) == 1:
            return levels
        fine, sums = sums, np.empty((max(len(sums) // 2, 1), max(sums.shape[1] // 2, 1), 4), np.float32)
        parallel_for(_halve, len(sums), fine, sums)


@kernel
def _sum_units(first, stop, normal, bend, tangent, out):  # type: ignore[no-untyped-def]
    """Means over 2 x 2 texels of a map's unit normals and, last, of whether there is one.

    Parameters
    ----------
    first, stop : int
        Rows of `out`.
    normal : ndarray of shape (h, w, 3), float32
    bend : ndarray of shape (3,), float32
        Factor on its components.
    tangent : bool
        Whether a normal that points into the skin leaves it smooth.
    out : ndarray of shape (h // 2, w // 2, 4), or 1 for 0, float32
        Written.
    """
    units = np.empty((2, normal.shape[1], 4), np.float32)
    for i in range(first, stop):
        rows = min(2, len(normal))
        for r in range(rows):
            for j in range(normal.shape[1]):
                x, y, z = normal[2 * i + r, j, 0] * bend[0], normal[2 * i + r, j, 1] * bend[1], normal[2 * i + r, j, 2]
                z *= bend[2]
                if tangent and not z > 0:
                    x, y, z = np.float32(0), np.float32(0), np.float32(1)
                dx, dy, dz = np.float64(x), np.float64(y), np.float64(z)
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                there = length > 0
                inverse = 1 / length if there else 0.0
                units[r, j, 0], units[r, j, 1], units[r, j, 2] = dx * inverse, dy * inverse, dz * inverse
                units[r, j, 3] = np.float32(1) if there else np.float32(0)
        _halve_row(units[:rows], out[i])


@kernel(inner=True)
def _halve_row(rows, out):  # type: ignore[no-untyped-def]
    """Means of 2 x 2 texels, or of two where there is one row or one column.

    Parameters
    ----------
    rows : ndarray of shape (1 or 2, w, 4), float32
    out : ndarray of shape (w // 2, or 1, 4), float32
        Written.
    """
    half = np.float32(0.5)
    below = len(rows) - 1
    for j in range(len(out)):
        left = 2 * j
        right = min(left + 1, rows.shape[1] - 1)
        for c in range(4):
            a, b = half * (rows[0, left, c] + rows[below, left, c]), half * (rows[0, right, c] + rows[below, right, c])
            out[j, c] = half * (a + b)


@kernel
def _halve(first, stop, fine, out):  # type: ignore[no-untyped-def]
    """`_halve_row` of an image (h, w, 4), rows `first` to `stop` of `out`."""
    for i in range(first, stop):
        _halve_row(fine[2 * i : min(2 * i + 2, len(fine))], out[i])


@kernel
def _means(first, stop, sums, bend, out):  # type: ignore[no-untyped-def]
    """Mean normals without the strength, and the sum of both slopes' variances.

    Parameters
    ----------
    first, stop : int
        Rows.
    sums : ndarray of shape (h, w, 4), float32
        As `_sum_units` begins them.
    bend : ndarray of shape (3,), float32
    out : ndarray of shape (h, w, 4)
        Written.
    """
    mean = np.zeros(3)
    for i in range(first, stop):
        for j in range(sums.shape[1]):
            share = np.float64(sums[i, j, 3])
            for c in range(3):
                mean[c] = np.float64(sums[i, j, c]) / share if share != 0 else 0.0
                out[i, j, c] = mean[c] / np.float64(bend[c]) if bend[c] != 0 else 0.0
            kept = np.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2])
            varied = 2 * ((1 - kept) / kept) if kept != 0 else 0.0
            out[i, j, 3] = min(max(varied, 0.0), 1.0)
