"""Area-weighted clusters of texels: a moment pyramid over the texture, cut where the skin in a block is small enough.

Texels next to one another in a chart are next to one another on the skin, so a quadtree over the texture is already
a spatial hierarchy; where a block holds two charts, its spread in space says so and the cut goes deeper. The cut
adapts to the local stretch by itself, and costs one pass over the texels.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.diffuse.points import TexelPoints

MIN_ALIGNMENT = 0.8  # |mean of unit normals| below this: the block bends too much to be one cluster
_MOMENTS = 8  # area, centroid x y z, spread, normal x y z


@dataclass(frozen=True)
class MomentPyramid:
    """Levels 1, 2, ... of one tile; level k blocks are 2^k texels wide.

    Attributes
    ----------
    moments : tuple of ndarray of shape (h, w, 8), float32
        area_mm2, centroid (3), spread_mm2 (trace of the area-weighted covariance / 2: variance along each tangent
        direction), mean normal (3, not unit).
    radiosity : tuple of ndarray of shape (h, w, C), float32
        Area-weighted mean.
    """

    moments: tuple[NDArray[np.float32], ...]
    radiosity: tuple[NDArray[np.float32], ...]


def moment_pyramid(points: TexelPoints, radiosity: NDArray[np.float32], levels: int) -> MomentPyramid:
    """Moments of blocks of 2, 4, ... 2^levels texels.

    Parameters
    ----------
    radiosity : ndarray of shape (L, H * W, 3), float32
        By flat texel; C = 3 L.
    """
    channels = 3 * len(radiosity)
    moments: list[NDArray[np.float32]] = []
    means: list[NDArray[np.float32]] = []
    fine_moments = np.empty((0, 0, _MOMENTS), np.float32)
    fine_mean = np.empty((0, 0, channels), np.float32)
    height, width = points.row.shape
    for _ in range(levels):
        height, width = (height + 1) // 2, (width + 1) // 2
        coarse = np.zeros((height, width, _MOMENTS), np.float32)
        mean = np.zeros((height, width, channels), np.float32)
        if not moments:
            _first_level(points.row, points.position, points.normal, points.area_mm2, radiosity, coarse, mean)
        else:
            _next_level(fine_moments, fine_mean, coarse, mean)
        moments.append(coarse)
        means.append(mean)
        fine_moments, fine_mean = coarse, mean
    return MomentPyramid(tuple(moments), tuple(means))


def cut_clusters(
    tiles: tuple[tuple[TexelPoints, NDArray[np.float32], MomentPyramid], ...], max_spread_mm2: float, levels: int
) -> NDArray[np.float32]:
    """The widest blocks whose spread is at most `max_spread_mm2` and whose normals agree; single texels elsewhere.

    Parameters
    ----------
    levels : int
        Blocks are at most 2^levels texels wide; 0: every texel alone.

    Returns
    -------
    ndarray of shape (S, 8 + C), float32
        Position (3), unit normal (3), spread_mm2 (0 for a single texel), area_mm2, radiosity (C); in raster order of
        each level, widest level first.
    """
    # Where to cut first, then how many there are, then all of them into arrays of the right length
    channels = 3 * len(tiles[0][1])
    cuts, count = [], 0
    for points, _, pyramid in tiles:
        taken: NDArray[np.uint8] = np.zeros((1, 1), np.uint8)
        levels = min(levels, len(pyramid.moments))
        for level in reversed(range(levels)):
            moments = pyramid.moments[level]
            now, per_row = np.zeros(moments.shape[:2], np.uint8), np.zeros(len(moments), np.int64)
            _mark(moments, taken, max_spread_mm2, MIN_ALIGNMENT, now, per_row)
            start = count + np.cumsum(per_row) - per_row
            cuts.append((level, now, start))
            count += int(per_row.sum())
            taken = now
        per_row = np.zeros(len(points.row), np.int64)
        _count_single(points.row, points.area_mm2, taken, per_row)
        cuts.append((-1, taken, count + np.cumsum(per_row) - per_row))
        count += int(per_row.sum())
    out = np.empty((count, 8 + channels), np.float32)
    cut = iter(cuts)
    for points, light, pyramid in tiles:
        for level, now, start in islice(cut, levels + 1):
            if level >= 0:
                _emit(pyramid.moments[level], pyramid.radiosity[level], now, start, out)
            else:
                _emit_single(points.row, points.position, points.normal, points.area_mm2, light, now, start, out)
    return out


def contrast(points: TexelPoints, radiosity: NDArray[np.float32], pyramid: MomentPyramid) -> NDArray[np.float32]:
    """Where errors will be: change of the light around each point, over 4, 16 and 64 texels, and of the texels' size.

    The second part, in units of the light around, finds borders of charts and skin that the UVs squeeze or stretch.
    """
    row, col = np.divmod(points.flat_index, points.row.shape[1])
    changes = np.zeros(len(row), np.float32)
    fine, fine_index = _channel_sum(radiosity), points.flat_index
    for level in (2, 4, 6):
        if level <= len(pyramid.radiosity):
            block = pyramid.radiosity[level - 1].sum(axis=2)
            coarse_index = (row >> level) * block.shape[1] + (col >> level)
            _add_changes(fine, fine_index, block.reshape(-1), coarse_index, changes)
            fine, fine_index = block.reshape(-1), coarse_index
    if len(pyramid.moments) >= 2:
        moments = pyramid.moments[1]
        index = (row >> 2) * moments.shape[1] + (col >> 2)
        _add_uneven(points.area_mm2, moments.reshape(-1, _MOMENTS), index, fine, fine_index, changes)
    return changes


@njit(cache=True, parallel=True)
def _channel_sum(radiosity):  # type: ignore[no-untyped-def]
    out = np.zeros(radiosity.shape[1], np.float32)
    for texel in prange(len(out)):
        for light in range(len(radiosity)):
            for c in range(3):
                out[texel] += radiosity[light, texel, c]
    return out


@njit(cache=True, parallel=True)
def _add_changes(fine, fine_index, coarse, coarse_index, changes):  # type: ignore[no-untyped-def]
    for k in prange(len(changes)):
        changes[k] += abs(fine[fine_index[k]] - coarse[coarse_index[k]])


@njit(cache=True, parallel=True)
def _add_uneven(area, moments, index, light, light_index, changes):  # type: ignore[no-untyped-def]
    faint = np.float32(1e-12)
    for k in prange(len(changes)):
        mean_area = max(moments[index[k], 0], faint)
        uneven = abs(np.log(max(area[k], faint) / (mean_area / np.float32(16))))
        # A square's spread is a twelfth of its area
        stretched = np.log(max(np.float32(12) * moments[index[k], 4] / mean_area, np.float32(1)))
        around = np.float32(0.3) * light[light_index[k]]
        changes[k] += (min(uneven, np.float32(2)) + min(stretched, np.float32(4))) * around


@njit(cache=True, parallel=True)
def _first_level(row_of, position, normal, area, radiosity, out, mean):  # type: ignore[no-untyped-def]
    height, width = row_of.shape
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    k = row_of[r, c]
                    if k < 0 or area[k] <= 0:
                        continue
                    total += area[k]
                    for axis in range(3):
                        out[i, j, 1 + axis] += area[k] * position[k, axis]
                        out[i, j, 5 + axis] += area[k] * normal[k, axis]
                    for light in range(len(radiosity)):
                        for q in range(3):
                            mean[i, j, 3 * light + q] += area[k] * radiosity[light, r * width + c, q]
            if total <= 0:
                continue
            _divide(out[i, j], mean[i, j], total)
            spread = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    k = row_of[r, c]
                    if k >= 0 and area[k] > 0:
                        for axis in range(3):
                            d = position[k, axis] - out[i, j, 1 + axis]
                            spread += area[k] * d * d
            out[i, j, 4] = spread / total * np.float32(0.5)


@njit(cache=True, parallel=True)
def _next_level(fine, fine_mean, out, mean):  # type: ignore[no-untyped-def]
    height, width = fine.shape[:2]
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    a = fine[r, c, 0]
                    total += a
                    for axis in range(3):
                        out[i, j, 1 + axis] += a * fine[r, c, 1 + axis]
                        out[i, j, 5 + axis] += a * fine[r, c, 5 + axis]
                    for q in range(mean.shape[2]):
                        mean[i, j, q] += a * fine_mean[r, c, q]
            if total <= 0:
                continue
            _divide(out[i, j], mean[i, j], total)
            # Parallel axes: spread about the common centroid, without the cancellation of raw second moments
            spread = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    a = fine[r, c, 0]
                    away = np.float32(0)
                    for axis in range(3):
                        d = fine[r, c, 1 + axis] - out[i, j, 1 + axis]
                        away += d * d
                    spread += a * (fine[r, c, 4] + away * np.float32(0.5))
            out[i, j, 4] = spread / total


@njit(cache=True, inline="always")
def _divide(moments, mean, total):  # type: ignore[no-untyped-def]
    moments[0] = total
    for axis in range(3):
        moments[1 + axis] /= total
        moments[5 + axis] /= total
    for q in range(mean.shape[0]):
        mean[q] /= total


@njit(cache=True, parallel=True)
def _mark(moments, parent, max_spread, min_alignment, now, per_row):  # type: ignore[no-untyped-def]
    """now: 0 open, 1 a cluster, 2 inside a wider one."""
    for i in prange(moments.shape[0]):
        for j in range(moments.shape[1]):
            m = moments[i, j]
            if parent[min(i // 2, parent.shape[0] - 1), min(j // 2, parent.shape[1] - 1)] > 0:
                now[i, j] = 2
            elif m[0] > 0 and m[4] <= max_spread and m[5] ** 2 + m[6] ** 2 + m[7] ** 2 >= min_alignment**2:
                now[i, j] = 1
                per_row[i] += 1


@njit(cache=True, parallel=True)
def _emit(moments, mean, now, start, out):  # type: ignore[no-untyped-def]
    for i in prange(moments.shape[0]):
        k = start[i]
        for j in range(moments.shape[1]):
            if now[i, j] == 1:
                m = moments[i, j]
                length = max(np.sqrt(m[5] * m[5] + m[6] * m[6] + m[7] * m[7]), np.float32(1e-12))
                for axis in range(3):
                    out[k, axis], out[k, 3 + axis] = m[1 + axis], m[5 + axis] / length
                out[k, 6], out[k, 7] = m[4], m[0]
                for q in range(mean.shape[2]):
                    out[k, 8 + q] = mean[i, j, q]
                k += 1


@njit(cache=True, inline="always")
def _is_single(row_of, area, taken, r, c):  # type: ignore[no-untyped-def]
    k = row_of[r, c]
    return k >= 0 and area[k] > 0 and taken[min(r // 2, taken.shape[0] - 1), min(c // 2, taken.shape[1] - 1)] == 0


@njit(cache=True, parallel=True)
def _count_single(row_of, area, taken, per_row):  # type: ignore[no-untyped-def]
    for r in prange(row_of.shape[0]):
        for c in range(row_of.shape[1]):
            if _is_single(row_of, area, taken, r, c):
                per_row[r] += 1


@njit(cache=True, parallel=True)
def _emit_single(row_of, position, normal, area, light, taken, start, out):  # type: ignore[no-untyped-def]
    width = row_of.shape[1]
    for r in prange(row_of.shape[0]):
        n = start[r]
        for c in range(width):
            if _is_single(row_of, area, taken, r, c):
                k = row_of[r, c]
                for axis in range(3):
                    out[n, axis], out[n, 3 + axis] = position[k, axis], normal[k, axis]
                out[n, 6], out[n, 7] = 0.0, area[k]
                for one in range(len(light)):
                    for q in range(3):
                        out[n, 8 + 3 * one + q] = light[one, r * width + c, q]
                n += 1
