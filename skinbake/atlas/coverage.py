"""Exact area coverage of texels by triangles, and the triangle that holds each texel's centre."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

FULL = 1e-6  # round-off below which a texel counts as wholly covered
BAND_ROWS = 32  # rows that one task owns: no two tasks write the same texel, whatever the number of threads


class Bands(NamedTuple):
    """Items by band of `BAND_ROWS` rows: compressed lists, band by band and in ascending order.

    Attributes
    ----------
    start : ndarray of shape (bands + 1,), int64
    items : ndarray, int64
        Those of band b are items[start[b]:start[b + 1]].
    """

    start: NDArray[np.int64]
    items: NDArray[np.int64]


class RasterArrays(NamedTuple):
    """What is written of one tile; as in AtlasRaster."""

    face_index: NDArray[np.int32]
    barycentric: NDArray[np.float32]
    coverage: NDArray[np.float32]
    area_mm2: NDArray[np.float32]


def bin_by_band(low_y: Float, high_y: Float, height: int) -> Bands:
    """Items by the bands of rows that they touch.

    Parameters
    ----------
    low_y, high_y : ndarray of shape (n,)
        Rows between which an item lies; NaN leaves it out.
    height : int
        Rows of the texture.
    """
    return Bands(*_bin_by_band(low_y, high_y, height))


@kernel
def _bin_by_band(low_y: Float, high_y: Float, height: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """`bin_by_band` as a plain tuple.

    Parameters
    ----------
    low_y, high_y : ndarray of shape (n,)
    height : int
    """
    bands = (height + BAND_ROWS - 1) // BAND_ROWS
    start = np.zeros(bands + 1, dtype=np.int64)
    first = np.empty(len(low_y), dtype=np.int64)
    last = np.empty(len(low_y), dtype=np.int64)
    for i in range(len(low_y)):
        if not (high_y[i] >= 0.0 and low_y[i] <= height):  # also true of NaN, which marks an item to skip
            first[i], last[i] = 0, -1
            continue
        first[i] = int(max(low_y[i], 0.0)) // BAND_ROWS
        last[i] = int(min(high_y[i], height - 1.0)) // BAND_ROWS
        for b in range(first[i], last[i] + 1):
            start[b + 1] += 1
    for b in range(bands):
        start[b + 1] += start[b]
    fill = np.empty(bands, dtype=np.int64)
    for b in range(bands):
        fill[b] = start[b]
    items = np.empty(start[bands], dtype=np.int64)
    for i in range(len(low_y)):
        for b in range(first[i], last[i] + 1):
            items[fill[b]] = i
            fill[b] += 1
    return start, items


@kernel(inner=True)
def _edge(ax: float, ay: float, bx: float, by: float, px: float, py: float) -> float:
    """Twice the signed area of (a, b, p), texels^2, evaluated in one vertex order.

    Both users of an edge so get the same number, and a centre on it belongs to exactly one of them.

    Parameters
    ----------
    ax, ay, bx, by : float
        Ends of the edge.
    px, py : float
        Point.
    """
    if (ax, ay) <= (bx, by):
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return -((ax - bx) * (py - by) - (ay - by) * (px - bx))


@kernel(inner=True)
def _clip(poly: Float, n: int, axis: int, side: float, bound: float, out: Float) -> int:
    """Clip a polygon against one axis-aligned line (Sutherland-Hodgman); the number of corners left.

    Parameters
    ----------
    poly : ndarray of shape (at least n, 2)
    n : int
        Corners of the polygon.
    axis : int
        0 for the line x = bound, 1 for y = bound.
    side : float
        1 keeps what lies above the bound, -1 what lies below.
    bound : float
    out : ndarray of shape (at least n + 1, 2)
        The clipped polygon is written here.
    """
    m = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        di = side * (poly[i, axis] - bound)
        dj = side * (poly[j, axis] - bound)
        if di >= 0.0:
            out[m, 0], out[m, 1] = poly[i, 0], poly[i, 1]
            m += 1
        if (di > 0.0 and dj < 0.0) or (di < 0.0 and dj > 0.0):
            t = di / (di - dj)
            out[m, 0] = poly[i, 0] + t * (poly[j, 0] - poly[i, 0])
            out[m, 1] = poly[i, 1] + t * (poly[j, 1] - poly[i, 1])
            out[m, axis] = bound
            m += 1
    return m


@kernel(inner=True)
def _twice_area(poly: Float, n: int) -> float:
    """Twice the signed area of a polygon's first n corners."""
    total = 0.0
    for i in range(1, n - 1):
        total += (poly[i, 0] - poly[0, 0]) * (poly[i + 1, 1] - poly[0, 1])
        total -= (poly[i, 1] - poly[0, 1]) * (poly[i + 1, 0] - poly[0, 0])
    return total


def rasterize_coverage(corner_xy: Float, mm2_per_texel: Float, bands: Bands, out: RasterArrays) -> None:
    """Fill the arrays of one tile from its triangles, exactly: each triangle is clipped to each texel's square.

    Parameters
    ----------
    corner_xy : ndarray of shape (F, 3, 2)
        Corners in texels, x to the right, y down.
    mm2_per_texel : ndarray of shape (F,)
        Skin area of one square texel of that face.
    bands : Bands
        Faces by band of rows.
    out : RasterArrays
        Written; `face_index` is NO_FACE everywhere before.
    """
    parallel_for(_rasterize_bands, len(bands.start) - 1, corner_xy, mm2_per_texel, bands, out)


@kernel
def _rasterize_bands(
    first: int, stop: int, corner_xy: Float, mm2_per_texel: Float, bands: Bands, out: RasterArrays
) -> None:
    """`rasterize_coverage` of bands `first` to `stop`."""
    start, items, face_index, barycentric = bands.start, bands.items, out.face_index, out.barycentric
    height, width = face_index.shape
    x, y = np.int64(0), np.int64(1)  # not literals: numba would compile `_clip` for each
    for band in range(first, stop):
        row_end = min((band + 1) * BAND_ROWS, height)
        strip = np.empty((9, 2))
        poly = np.empty((9, 2))
        other = np.empty((9, 2))
        first_row = band * BAND_ROWS
        shares = np.zeros((row_end - first_row, width))  # float64: one texel may hold thousands of faces
        areas = np.zeros((row_end - first_row, width))
        for k in range(start[band], start[band + 1]):
            f = items[k]
            x0, y0 = corner_xy[f, 0, 0], corner_xy[f, 0, 1]
            x1, y1 = corner_xy[f, 1, 0], corner_xy[f, 1, 1]
            x2, y2 = corner_xy[f, 2, 0], corner_xy[f, 2, 1]
            total = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
            side = 1.0 if total > 0.0 else -1.0
            low, high = min(y0, y1, y2), max(y0, y1, y2)
            for row in range(max(first_row, int(np.floor(max(low, 0.0)))), min(row_end, int(min(high, 1e9)) + 1)):
                # The part of the triangle in this row of texels gives the columns it can touch
                for i in range(3):
                    strip[i, 0], strip[i, 1] = corner_xy[f, i, 0], corner_xy[f, i, 1]
                n = _clip(strip, np.int64(3), y, 1.0, float(row), other)
                n = _clip(other, n, y, -1.0, row + 1.0, strip)
                if n < 3:
                    continue
                left, right = strip[0, 0], strip[0, 0]
                for i in range(1, n):
                    left, right = min(left, strip[i, 0]), max(right, strip[i, 0])
                if right < 0.0 or left >= width:
                    continue
                for col in range(int(max(left, 0.0)), min(int(right) + 1, width)):
                    # Edge functions at the centre; half the change across the square decides in, out or clip
                    cx, cy = col + 0.5, row + 0.5
                    e0 = side * _edge(x1, y1, x2, y2, cx, cy)
                    e1 = side * _edge(x2, y2, x0, y0, cx, cy)
                    e2 = side * _edge(x0, y0, x1, y1, cx, cy)
                    r0 = 0.5 * (abs(x2 - x1) + abs(y2 - y1))
                    r1 = 0.5 * (abs(x0 - x2) + abs(y0 - y2))
                    r2 = 0.5 * (abs(x1 - x0) + abs(y1 - y0))
                    if e0 >= r0 and e1 >= r1 and e2 >= r2:
                        share = 1.0
                    else:
                        m = _clip(strip, n, x, 1.0, float(col), poly)
                        m = _clip(poly, m, x, -1.0, col + 1.0, other)
                        share = 0.5 * abs(_twice_area(other, m)) if m >= 3 else 0.0
                    shares[row - first_row, col] += share
                    areas[row - first_row, col] += share * mm2_per_texel[f]
                    if e0 >= 0.0 and e1 >= 0.0 and e2 >= 0.0 and face_index[row, col] == NO_FACE:
                        # Faces come in ascending order, so where charts overlap the lowest face wins
                        face_index[row, col] = f
                        barycentric[row, col, 0] = min(e1 / abs(total), 1.0)
                        barycentric[row, col, 1] = min(e2 / abs(total), 1.0)
        for row in range(first_row, row_end):
            for col in range(width):
                share = shares[row - first_row, col]
                out.coverage[row, col] = 1.0 if share > 1.0 - FULL else share
                out.area_mm2[row, col] = areas[row - first_row, col]
