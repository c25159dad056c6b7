"""A smooth field on the skin, from every second texel to every texel, wherever that is safe.

A lobe a few texels wide need not be summed at each texel: cubic interpolation of every second one is wrong by at most
0.0094 (h / sigma)^4 of a hard edge, h the distance of the texels used. Whether the texels around one really are its
neighbours on the skin is not asked of the UVs: the same interpolation is done with their positions, and must give the
position of the texel itself. Seams, charts' borders, folds of the layout and strong stretch all fail that test; what
fails is summed directly.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

MAX_GAP = 1.1  # of sigma, between the texels interpolated, however loose the tolerance
EDGE_ERROR = 0.0094  # see above
MAX_MISS = 0.06  # of sigma, between the interpolated position and the true one

# Lagrange's cubic at a quarter of the way: the fine texel's centre between the coarse ones
_WEIGHTS = np.array([-7, 105, 35, -5], np.float32) / np.float32(128)


def widest_gap(tolerance: float) -> float:
    """Distance, in sigma, of the texels interpolated that keeps a hard edge within `tolerance` of its height."""
    return min(MAX_GAP, float((tolerance / EDGE_ERROR) ** 0.25))


def interpolate_smooth(
    coarse: NDArray[np.float32],
    coarse_row: NDArray[np.int32],
    coarse_position: NDArray[np.float32],
    row: NDArray[np.int32],
    position: NDArray[np.float32],
    sigma_mm: float,
    out: NDArray[np.float32],
    gap: float = MAX_GAP,
) -> NDArray[np.int32]:
    """Fill what can be interpolated; the rest is returned for direct evaluation.

    Parameters
    ----------
    coarse : ndarray of shape (h * w, C), float32
        The field at half the size.
    coarse_row, row : ndarray of shape (h, w) and (2 h, 2 w), int32
        Rows of the positions, -1 where empty.
    coarse_position, position : ndarray of shape (N, 3), float32
    sigma_mm : float
        Of the lobe: how fast the field may change.
    out : ndarray of shape (4 h w, C), float32
        Written where safe.
    gap : float
        Greatest distance, in sigma, of the texels interpolated.

    Returns
    -------
    ndarray of shape (2 h, 2 w), int32
        `row` where a texel is still to be evaluated, -1 elsewhere.
    """
    if row.shape != (2 * coarse_row.shape[0], 2 * coarse_row.shape[1]):
        raise ValueError(f"expected twice the shape {coarse_row.shape}, got {row.shape}")
    left = row.copy()
    limits = np.float32((gap * sigma_mm) ** 2), np.float32((MAX_MISS * sigma_mm) ** 2)
    _interpolate(coarse, coarse_row, coarse_position, row, position, *limits, _WEIGHTS, out, left)
    return left


@njit(cache=True, parallel=True)
def _interpolate(  # type: ignore[no-untyped-def]
    coarse, coarse_row, coarse_position, row, position, gap2, miss2, weights, out, left
):
    height, width = coarse_row.shape
    for r in prange(row.shape[0]):
        near = np.empty((4, 4), np.int64)
        for c in range(row.shape[1]):
            k = row[r, c]
            if k < 0:
                continue
            # Stencil from the far side of the nearer coarse texel: its order turns with the quarter the centre lies in
            step_y, step_x = (-1 if r % 2 == 0 else 1), (-1 if c % 2 == 0 else 1)
            y0, x0 = r // 2 - step_y, c // 2 - step_x
            safe = True
            for i in range(4):
                y = y0 + i * step_y
                for j in range(4):
                    x = x0 + j * step_x
                    if not (0 <= y < height and 0 <= x < width) or coarse_row[y, x] < 0:
                        safe = False
                        break
                    near[i, j] = y * width + x
                if not safe:
                    break
            if not safe:
                continue
            px, py, pz = np.float32(0), np.float32(0), np.float32(0)
            for i in range(4):
                for j in range(4):
                    w = weights[i] * weights[j]
                    q = coarse_row[near[i, j] // width, near[i, j] % width]
                    px += w * coarse_position[q, 0]
                    py += w * coarse_position[q, 1]
                    pz += w * coarse_position[q, 2]
                    if i > 0:
                        p = coarse_row[near[i - 1, j] // width, near[i - 1, j] % width]
                        safe = safe and _distance2(coarse_position, p, q) <= gap2
                    if j > 0:
                        p = coarse_row[near[i, j - 1] // width, near[i, j - 1] % width]
                        safe = safe and _distance2(coarse_position, p, q) <= gap2
            px -= position[k, 0]
            py -= position[k, 1]
            pz -= position[k, 2]
            if not safe or px * px + py * py + pz * pz > miss2:
                continue
            left[r, c] = -1
            at = r * row.shape[1] + c
            for q in range(out.shape[1]):
                value = np.float32(0)
                for i in range(4):
                    line = np.float32(0)
                    for j in range(4):
                        line += weights[j] * coarse[near[i, j], q]
                    value += weights[i] * line
                out[at, q] = max(value, np.float32(0))


@njit(cache=True, inline="always")
def _distance2(position, p, q):  # type: ignore[no-untyped-def]
    dx = position[p, 0] - position[q, 0]
    dy = position[p, 1] - position[q, 1]
    dz = position[p, 2] - position[q, 2]
    return dx * dx + dy * dy + dz * dz
