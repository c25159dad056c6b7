"""A smooth field on the skin, from every second texel to every texel, wherever that is safe.

A lobe a few texels wide need not be summed at each texel: cubic interpolation of every second one is wrong by at most
0.0094 (h / sigma)^4 of a hard edge, h the distance of the texels used; by half of that, rms, along the edge. Whether
the texels around one really are its neighbours on the skin is not asked of the UVs: the same interpolation is done with
their positions, and must give the position of the texel itself. Seams, charts' borders, folds of the layout and strong
stretch all fail that test; what fails is summed directly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

MAX_GAP = 1.1  # of sigma, between the texels interpolated, however loose the tolerance
EDGE_ERROR = 0.0047  # see above
MAX_MISS = 0.06  # of sigma, between the interpolated position and the true one

# Lagrange's cubic at a quarter of the way: the fine texel's centre between the coarse ones
_WEIGHTS = np.array([-7, 105, 35, -5], np.float32) / np.float32(128)
_INFINITE = np.float32(np.inf)


def widest_gap(tolerance: float) -> float:
    """Distance, in sigma, of the texels interpolated that keeps a hard edge within `tolerance` of its height, rms."""
    return min(MAX_GAP, float((tolerance / EDGE_ERROR) ** 0.25))


def least_sigma(coarse: TexelPoints, fine: TexelPoints, gap: float = MAX_GAP) -> NDArray[np.float32]:
    """Narrowest lobe, in mm, whose field can be interpolated at each texel; infinite where none can.

    Parameters
    ----------
    coarse, fine : TexelPoints
        Those of a size (h, w) and of its double.
    gap : float
        Greatest distance, in sigma, of the texels interpolated.

    Returns
    -------
    ndarray of shape (2 h, 2 w), float32

    Raises
    ------
    ValueError
        The sizes are not one and its double.
    """
    height, width = coarse.row.shape
    if fine.row.shape != (2 * height, 2 * width):
        raise ValueError(f"expected twice the shape {coarse.row.shape}, got {fine.row.shape}")
    position = np.zeros((height * width, 3), np.float32)
    position[coarse.flat_index] = coarse.position
    widest = np.empty((height, width), np.float32)
    parallel_for(_widest_step, height, coarse.row, position, widest)
    sigma = np.empty(fine.row.shape, np.float32)
    lattice = _Coarse(position.reshape(-1), widest)
    parallel_for(_least_sigma, 2 * height, lattice, fine, (np.float32(gap), np.float32(MAX_MISS)), sigma)
    return sigma


def interpolate_smooth(
    coarse: NDArray[np.float32],
    row: NDArray[np.int32],
    least_sigma_mm: NDArray[np.float32],
    sigma_mm: float,
    out: NDArray[np.float32],
) -> NDArray[np.int32]:
    """Fill what can be interpolated; the rest is returned for direct evaluation.

    Parameters
    ----------
    coarse : ndarray of shape (L, h, w, 3), float32
        The field at half the size.
    row : ndarray of shape (2 h, 2 w), int32
        Rows of the positions, -1 where empty.
    least_sigma_mm : ndarray of shape (2 h, 2 w), float32
        See `least_sigma`.
    sigma_mm : float
        Standard deviation of the lobe, which tells how fast the field may change.
    out : ndarray of shape (L, 2 h, 2 w, 3), float32
        Written where safe.

    Returns
    -------
    ndarray of shape (2 h, 2 w), int32
        `row` where a texel is still to be evaluated, -1 elsewhere.
    """
    left = row.copy()
    parallel_for(_interpolate, len(left), coarse, least_sigma_mm, np.float32(sigma_mm), out, left)
    return left


class _Coarse(NamedTuple):
    """The texels that are interpolated.

    Attributes
    ----------
    position : ndarray of shape (h w 3,), float32
        By texel, mm.
    widest : ndarray of shape (h, w), float32
        As `_widest_step` gives it.
    """

    position: NDArray[np.float32]
    widest: NDArray[np.float32]


@kernel
def _widest_step(first, stop, row_of, position, widest):  # type: ignore[no-untyped-def]
    """Longest step between neighbours of the 4 x 4 texels from (y, x) on, squared; infinite where one is empty."""
    height, width = widest.shape
    for y in range(first, stop):
        for x in range(width):
            most = np.float32(0)
            if y + 3 >= height or x + 3 >= width:
                most = _INFINITE
            else:
                for i in range(4):
                    for j in range(4):
                        at = (y + i) * width + x + j
                        if row_of[y + i, x + j] < 0:
                            most = _INFINITE
                        if i < 3:
                            most = max(most, _distance2(position, at, at + width))
                        if j < 3:
                            most = max(most, _distance2(position, at, at + 1))
            widest[y, x] = most


@kernel
def _least_sigma(first, stop, coarse, fine, limits, sigma):  # type: ignore[no-untyped-def]
    """`least_sigma` of rows of the fine size.

    Parameters
    ----------
    first, stop : int
        Rows.
    coarse : _Coarse
    fine : TexelPoints
    limits : tuple of two float32
        Greatest distance of texels interpolated, and of the interpolated position from the true one, in sigma.
    sigma : ndarray of shape (2 h, 2 w), float32
        Written.
    """
    widest, row_of, position = coarse.widest, fine.row, fine.position
    gap, miss = limits
    height, width = widest.shape
    for r in range(first, stop):
        line = np.empty(width * 3, np.float32)
        y0 = _first_of(r)
        inside = y0 >= 0 and y0 + 3 < height
        if inside:
            _blend_rows(coarse.position, r, line)
        for c in range(sigma.shape[1]):
            x0 = _first_of(c)
            k = row_of[r, c]
            sigma[r, c] = _INFINITE
            if k < 0 or not inside or x0 < 0 or x0 + 3 >= width:
                continue
            miss2 = np.float32(0)
            for axis in range(3):
                d = _blend(line, c, axis) - position[k, axis]
                miss2 += d * d
            sigma[r, c] = max(np.sqrt(widest[y0, x0]) / gap, np.sqrt(miss2) / miss)


@kernel
def _interpolate(first, stop, coarse, least_sigma_mm, sigma_mm, out, left):  # type: ignore[no-untyped-def]
    """`interpolate_smooth` of rows of the fine size.

    Parameters
    ----------
    first, stop : int
        Rows.
    coarse : ndarray of shape (L, h, w, 3), float32
    least_sigma_mm : ndarray of shape (2 h, 2 w), float32
    sigma_mm : float32
    out : ndarray of shape (L, 2 h, 2 w, 3), float32
        Written where safe.
    left : ndarray of shape (2 h, 2 w), int32
        Set to -1 where safe.
    """
    lights, _, width, _ = coarse.shape
    for r in range(first, stop):
        some = False
        for c in range(left.shape[1]):
            some |= least_sigma_mm[r, c] <= sigma_mm
        if not some:
            continue
        line = np.empty(width * 3, np.float32)
        for light in range(lights):
            _blend_rows(coarse[light].reshape(-1), r, line)
            for c in range(left.shape[1]):
                if least_sigma_mm[r, c] <= sigma_mm:
                    left[r, c] = -1
                    for q in range(3):
                        out[light, r, c, q] = max(_blend(line, c, q), np.float32(0))


@kernel(inline=True)
def _first_of(fine):  # type: ignore[no-untyped-def]
    """First of the four coarse texels around a fine one: its centre lies a quarter to one side of the middle two."""
    return (fine - 1) // 2 - 1


@kernel(inner=True)
def _blend_rows(coarse, r, line):  # type: ignore[no-untyped-def]
    """line = the four rows around fine row r, weighted; flat over (width, C)."""
    size = len(line)
    y0 = _first_of(r)
    w0, w1, w2, w3 = _weights(r)
    a, b = coarse[y0 * size : (y0 + 1) * size], coarse[(y0 + 1) * size : (y0 + 2) * size]
    c, d = coarse[(y0 + 2) * size : (y0 + 3) * size], coarse[(y0 + 3) * size : (y0 + 4) * size]
    for k in range(size):
        line[k] = w0 * a[k] + w1 * b[k] + w2 * c[k] + w3 * d[k]


@kernel(inline=True)
def _blend(line, c, q):  # type: ignore[no-untyped-def]
    """Channel q of a blended row at fine column c."""
    at = 3 * _first_of(c) + q
    w0, w1, w2, w3 = _weights(c)
    return w0 * line[at] + w1 * line[at + 3] + w2 * line[at + 6] + w3 * line[at + 9]


@kernel(inline=True)
def _weights(fine):  # type: ignore[no-untyped-def]
    """Weights of the four coarse texels around a fine one, in their order."""
    if fine % 2 == 0:  # the third of the four is the nearest
        return _WEIGHTS[3], _WEIGHTS[2], _WEIGHTS[1], _WEIGHTS[0]
    return _WEIGHTS[0], _WEIGHTS[1], _WEIGHTS[2], _WEIGHTS[3]


@kernel(inline=True)
def _distance2(position, p, q):  # type: ignore[no-untyped-def]
    """Squared distance of two rows of positions."""
    dx = position[p, 0] - position[q, 0]
    dy = position[p, 1] - position[q, 1]
    dz = position[p, 2] - position[q, 2]
    return dx * dx + dy * dy + dz * dz
