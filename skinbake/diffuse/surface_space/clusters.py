"""Area-weighted moments of blocks of texels: which blocks are small and flat enough to be one source of a surface sum.

Texels next to one another in a chart are next to one another on the skin, so a quadtree over the texture is already
a spatial hierarchy; where a block holds two charts, its spread in space says so and the cut goes deeper. The cut
adapts to the local stretch by itself, and costs one pass over the texels.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Zeros

LEVELS = 6  # blocks of up to 64 x 64 texels
MIN_ALIGNMENT = 0.8  # |mean of unit normals| below this: the block bends too much to be one cluster
_MIN_ALIGNMENT2 = MIN_ALIGNMENT**2
_MOMENTS = 8  # area, centroid x y z, spread, normal x y z


class MomentPyramid(NamedTuple):
    """Blocks of 2, 4, ... 64 texels a side of one tile, level after level in raster order; kernels take it as it is.

    Attributes
    ----------
    moments : ndarray of shape (B, 8), float32
        area_mm2, centroid (3), spread_mm2 (trace of the area-weighted covariance / 2: variance along each tangent
        direction), mean normal (3, not unit).
    radiosity : ndarray of shape (B, C), float32
        Area-weighted mean.
    start, width : ndarray of shape (6,), int64
        First block of each level, and how many it has in a row.
    """

    moments: NDArray[np.float32]
    radiosity: NDArray[np.float32]
    start: NDArray[np.int64]
    width: NDArray[np.int64]


def moment_pyramid(
    points: TexelPoints, radiosity: NDArray[np.float32], zeros: Zeros = np.zeros, same: MomentPyramid | None = None
) -> MomentPyramid:
    """Moments of all blocks.

    Parameters
    ----------
    points : TexelPoints
    radiosity : ndarray of shape (L, H * W, 3), float32
        By flat texel; C = 3 L.
    zeros : callable, optional
        Makes its arrays.
    same : MomentPyramid, optional
        Of other light on the same points: its moments are taken.
    """
    channels = 3 * len(radiosity)
    sizes = [tuple(-(-side >> level) for side in points.row.shape) for level in range(1, LEVELS + 1)]
    start = np.cumsum([0, *(h * w for h, w in sizes)])
    moments = zeros((int(start[-1]), _MOMENTS), np.float32) if same is None else same.moments
    means = zeros((int(start[-1]), channels), np.float32)
    views = [
        (moments[a:b].reshape(*size, -1), means[a:b].reshape(*size, -1))
        for a, b, size in zip(start[:-1], start[1:], sizes, strict=True)
    ]
    if same is None:
        parallel_for(_first_moments, sizes[0][0], points, views[0][0])
        for fine, coarse in pairwise(views):
            parallel_for(_next_moments, len(coarse[0]), fine[0], coarse[0])
    parallel_for(_first_means, sizes[0][0], points, radiosity, *views[0])
    for fine, coarse in pairwise(views):
        parallel_for(_next_means, len(coarse[0]), *fine, *coarse)
    return MomentPyramid(moments, means, start[:-1], np.array([w for _, w in sizes]))


@kernel(inline=True)
def is_cluster(moments, max_spread_mm2):  # type: ignore[no-untyped-def]
    """Whether a block's skin is small enough, and flat enough, to be one source."""
    aligned = moments[5] * moments[5] + moments[6] * moments[6] + moments[7] * moments[7] >= _MIN_ALIGNMENT2
    return moments[0] > 0 and moments[4] <= max_spread_mm2 and aligned


def contrast(points: TexelPoints, pyramid: MomentPyramid) -> NDArray[np.float32]:
    """Where errors will be, (T,): change of the light around each point, over 4, 16 and 64 texels, and of texels' size.

    The second part, in units of the light around, finds borders of charts and skin that the UVs squeeze or stretch.
    Found for blocks of 2 x 2 texels, which is as fine as it need be.
    """
    blocks = np.empty(pyramid.start[1], np.float32)
    parallel_for(_contrast, len(blocks), pyramid, blocks)
    changes = np.empty(len(points.flat_index), np.float32)
    parallel_for(_of_texels, len(changes), points.flat_index, points.row.shape[1], blocks, pyramid.width[0], changes)
    return changes


@kernel
def _contrast(first, stop, pyramid, changes):  # type: ignore[no-untyped-def]
    """`contrast` of blocks of 2 x 2 texels.

    Parameters
    ----------
    first, stop : int
        Blocks.
    pyramid : MomentPyramid
    changes : ndarray of shape (blocks,), float32
        Written.
    """
    moments, radiosity, start, width = pyramid.moments, pyramid.radiosity, pyramid.start, pyramid.width
    faint = np.float32(1e-12)
    for k in range(first, stop):
        changes[k] = 0
        if moments[k, 0] <= 0:
            continue
        row, col = k // width[0], k % width[0]
        change, fine = np.float32(0), _sum(radiosity[k])
        for level in (1, 3, 5):
            coarse = _sum(radiosity[start[level] + (row >> level) * width[level] + (col >> level)])
            change += abs(fine - coarse)
            fine = coarse
        block = start[1] + (row >> 1) * width[1] + (col >> 1)
        mean_area = max(moments[block, 0], faint)
        uneven = abs(np.log(max(moments[k, 0], faint) * np.float32(4) / mean_area))
        # A square's spread is a twelfth of its area
        stretched = np.log(max(np.float32(12) * moments[block, 4] / mean_area, np.float32(1)))
        around = np.float32(0.3) * fine
        changes[k] = change + (min(uneven, np.float32(2)) + min(stretched, np.float32(4))) * around


@kernel(inline=True)
def _sum(values):  # type: ignore[no-untyped-def]
    """Sum of a row of float32, in its order."""
    total = np.float32(0)
    for k in range(len(values)):
        total += values[k]
    return total


@kernel
def _of_texels(first, stop, flat_index, columns, blocks, width, changes):  # type: ignore[no-untyped-def]
    """Give texels the values of their blocks of 2 x 2.

    Parameters
    ----------
    first, stop : int
        Points.
    flat_index : ndarray of shape (T,), int32
    columns : int
        Texels in a row.
    blocks : ndarray, float32
    width : int
        Blocks in a row.
    changes : ndarray of shape (T,), float32
        Written.
    """
    for k in range(first, stop):
        row, col = flat_index[k] // columns, flat_index[k] % columns
        changes[k] = blocks[(row >> 1) * width + (col >> 1)]


def bending(pyramid: MomentPyramid, zeros: Zeros = np.zeros) -> NDArray[np.float32]:
    """How far each block's light is from halfway between that of its neighbours, the largest of a light's channels.

    Along rows or columns, whichever is more, where both neighbours are there.

    Parameters
    ----------
    pyramid : MomentPyramid
    zeros : callable, optional
        Makes the array.

    Returns
    -------
    ndarray of shape (B, L), float32
    """
    bend = zeros((len(pyramid.moments), pyramid.radiosity.shape[1] // 3), np.float32)
    stop = np.append(pyramid.start[1:], len(bend))
    for start, end, width in zip(pyramid.start, stop, pyramid.width, strict=True):
        area, light = pyramid.moments[start:end, 0].copy(), pyramid.radiosity[start:end]
        parallel_for(_bending, len(area), area, light, width, bend[start:end])
    return bend


@kernel
def _bending(first, stop, area, light, width, bend):  # type: ignore[no-untyped-def]
    """`bending` of the blocks `first` to `stop` of one level, `width` of them in a row; `bend` is zero before."""
    for k in range(first, stop):
        if area[k] <= 0:
            continue
        for step, at_first, at_last in (
            (1, k % width == 0, k % width == width - 1),
            (width, k < width, k + width >= len(area)),
        ):
            if at_first or at_last or area[k - step] <= 0 or area[k + step] <= 0:
                continue
            for c in range(light.shape[1]):
                middle = np.float32(0.5) * (light[k - step, c] + light[k + step, c])
                bend[k, c // 3] = max(bend[k, c // 3], abs(light[k, c] - middle))


@kernel
def _first_moments(first, stop, points, out):  # type: ignore[no-untyped-def]
    """Moments of blocks of 2 x 2 texels.

    Parameters
    ----------
    first, stop : int
        Rows of blocks.
    points : TexelPoints
    out : ndarray of shape (h, w, 8), float32
        Written where there is skin; zero before.
    """
    row_of, position, normal, area = points.row, points.position, points.normal, points.area_mm2
    height, width = row_of.shape
    for i in range(first, stop):
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
            if total <= 0:
                continue
            _divide(out[i, j], total)
            spread = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    k = row_of[r, c]
                    if k >= 0 and area[k] > 0:
                        for axis in range(3):
                            d = position[k, axis] - out[i, j, 1 + axis]
                            spread += area[k] * d * d
            out[i, j, 4] = spread / total * np.float32(0.5)


@kernel
def _next_moments(first, stop, fine, out):  # type: ignore[no-untyped-def]
    """Moments of blocks, from those of the four blocks that each is made of.

    Parameters
    ----------
    first, stop : int
        Rows of blocks.
    fine : ndarray of shape (2 h, 2 w, 8), float32
        May lack a last row or column.
    out : ndarray of shape (h, w, 8), float32
        Written where there is skin; zero before.
    """
    height, width = fine.shape[:2]
    for i in range(first, stop):
        for j in range(out.shape[1]):
            total = np.float32(0)
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    a = fine[r, c, 0]
                    total += a
                    for axis in range(3):
                        out[i, j, 1 + axis] += a * fine[r, c, 1 + axis]
                        out[i, j, 5 + axis] += a * fine[r, c, 5 + axis]
            if total <= 0:
                continue
            _divide(out[i, j], total)
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


@kernel(inline=True)
def _divide(moments, total):  # type: ignore[no-untyped-def]
    """Divide a block's sums by its area, which becomes the first of its moments."""
    moments[0] = total
    for axis in range(3):
        moments[1 + axis] /= total
        moments[5 + axis] /= total


@kernel
def _first_means(first, stop, points, radiosity, moments, mean):  # type: ignore[no-untyped-def]
    """Mean radiosity of blocks of 2 x 2 texels.

    Parameters
    ----------
    first, stop : int
        Rows of blocks.
    points : TexelPoints
    radiosity : ndarray of shape (L, H * W, 3), float32
    moments : ndarray of shape (h, w, 8), float32
        Of these blocks.
    mean : ndarray of shape (h, w, 3 L), float32
        Written where there is skin; zero before.
    """
    row_of, area = points.row, points.area_mm2
    height, width = row_of.shape
    for i in range(first, stop):
        for j in range(mean.shape[1]):
            total = moments[i, j, 0]
            if total <= 0:
                continue
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    k = row_of[r, c]
                    if k < 0 or area[k] <= 0:
                        continue
                    for light in range(len(radiosity)):
                        for q in range(3):
                            mean[i, j, 3 * light + q] += area[k] * radiosity[light, r * width + c, q]
            for q in range(mean.shape[2]):
                mean[i, j, q] /= total


@kernel
def _next_means(first, stop, fine, fine_mean, moments, mean):  # type: ignore[no-untyped-def]
    """Mean radiosity of blocks, from that of the four blocks that each is made of.

    Parameters
    ----------
    first, stop : int
        Rows of blocks.
    fine, fine_mean : ndarrays of shape (2 h, 2 w, 8), (2 h, 2 w, 3 L), float32
        May lack a last row or column.
    moments, mean : ndarrays of shape (h, w, 8), (h, w, 3 L), float32
        The latter is written where there is skin; zero before.
    """
    height, width = fine.shape[:2]
    for i in range(first, stop):
        for j in range(mean.shape[1]):
            total = moments[i, j, 0]
            if total <= 0:
                continue
            for r in range(2 * i, min(2 * i + 2, height)):
                for c in range(2 * j, min(2 * j + 2, width)):
                    for q in range(mean.shape[2]):
                        mean[i, j, q] += fine[r, c, 0] * fine_mean[r, c, q]
            for q in range(mean.shape[2]):
                mean[i, j, q] /= total
