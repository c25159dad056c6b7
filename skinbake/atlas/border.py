"""Closest chart points of texels whose centre lies on no chart: for thin charts, and for the gutter around charts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.coverage import BAND_ROWS, Bands
from skinbake.atlas.raster import NO_FACE, ShownFaces
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh


def chart_edges(mesh: SkinMesh, uv_area: Float) -> NDArray[np.int64]:
    """Edges on the border of a chart, as 3 * face + k for the edge from corner k to corner k + 1, ascending.

    An edge is interior when exactly two faces share its vertices and its UVs and lie on either side of it in UV space;
    all others can be the closest chart point of a texel outside. Faces of zero UV area have none.

    Parameters
    ----------
    mesh : SkinMesh
    uv_area : ndarray of shape (F,)
        Signed area of each face in UV space.
    """
    a = mesh.faces.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    uv_a, uv_b = mesh.corner_uv, np.roll(mesh.corner_uv, -1, axis=1)
    forward = (a < b).ravel()
    low_uv = np.where(forward[:, None], uv_a.reshape(-1, 2), uv_b.reshape(-1, 2))
    high_uv = np.where(forward[:, None], uv_b.reshape(-1, 2), uv_a.reshape(-1, 2))
    key = (np.minimum(a, b) * len(mesh.positions_mm) + np.maximum(a, b)).ravel()

    drawn = np.repeat(uv_area != 0, 3)
    order = np.argsort(np.where(drawn, key, -1), kind="stable")
    order = order[np.count_nonzero(~drawn) :]
    same = np.append(key[order[1:]] == key[order[:-1]], False)
    # Pairs: two faces on one edge, no third
    starts = same & ~np.roll(same, 1) & ~np.roll(same, -1)
    first, second = order[:-1][starts[:-1]], order[1:][starts[:-1]]
    # Interior if UVs agree and the charts continue across: orientation in UV times direction of travel differ
    side = np.repeat(np.sign(uv_area), 3) * np.where(forward, 1, -1)
    interior = (
        (low_uv[first] == low_uv[second]).all(axis=1)
        & (high_uv[first] == high_uv[second]).all(axis=1)
        & (side[first] != side[second])
    )
    is_border = drawn.copy()
    is_border[first[interior]] = False
    is_border[second[interior]] = False
    return np.flatnonzero(is_border)


def nearest_chart_points(
    corner_xy: Float, edges: NDArray[np.int64], bands: Bands, radius_texels: float, shown: ShownFaces
) -> None:
    """Give each empty texel within `radius_texels` of a chart edge the closest point of it, in place.

    Parameters
    ----------
    corner_xy : ndarray of shape (F, 3, 2)
        Corners in texels, x to the right, y down.
    edges : ndarray of shape (E,)
        Border edges, 3 * face + k (`chart_edges`).
    bands : Bands
        Edges by band of rows.
    radius_texels : float
    shown : ShownFaces
        Written where it was NO_FACE.
    """
    parallel_for(_claim_near_edges, len(bands.start) - 1, corner_xy, edges, bands, radius_texels, shown)


@kernel
def _claim_near_edges(
    first: int,
    stop: int,
    corner_xy: Float,
    edges: NDArray[np.int64],
    bands: Bands,
    radius_texels: float,
    shown: ShownFaces,
) -> None:
    """`nearest_chart_points` of bands `first` to `stop`."""
    start, items, face_index, barycentric = bands.start, bands.items, shown.face_index, shown.barycentric
    height, width = face_index.shape
    for band in range(first, stop):
        first_row, row_end = band * BAND_ROWS, min((band + 1) * BAND_ROWS, height)
        # Distances squared; texels that hold a chart point already are closed
        best = np.empty((row_end - first_row, width), np.float32)
        for row in range(first_row, row_end):
            for col in range(width):
                closed = face_index[row, col] != NO_FACE
                best[row - first_row, col] = -1.0 if closed else radius_texels * radius_texels
        # Each edge claims the texels to which it is nearer than all before it
        for item in range(start[band], start[band + 1]):
            face, k = edges[items[item]] // 3, edges[items[item]] % 3
            ax, ay = corner_xy[face, k, 0], corner_xy[face, k, 1]
            bx, by = corner_xy[face, (k + 1) % 3, 0], corner_xy[face, (k + 1) % 3, 1]
            dx, dy = bx - ax, by - ay
            length2 = dx * dx + dy * dy
            row_low = max(first_row, int(max(min(ay, by) - radius_texels - 0.5, 0.0)))
            row_high = min(row_end, int(max(ay, by) + radius_texels + 1.0))
            for row in range(row_low, row_high):
                cy = row + 0.5
                # Columns near the part of the edge within radius of this row
                t0, t1 = 0.0, 1.0
                if dy != 0.0:
                    u0, u1 = (cy - radius_texels - ay) / dy, (cy + radius_texels - ay) / dy
                    t0, t1 = max(t0, min(u0, u1)), min(t1, max(u0, u1))
                    if t0 > t1:
                        continue
                left = min(ax + t0 * dx, ax + t1 * dx) - radius_texels
                right = max(ax + t0 * dx, ax + t1 * dx) + radius_texels
                if right < 0.0 or left > width:
                    continue
                for col in range(int(max(left - 0.5, 0.0)), min(int(right + 0.5) + 1, width)):
                    if best[row - first_row, col] < 0.0:
                        continue
                    cx = col + 0.5
                    # Closest point of the edge to the texel's centre, and its barycentrics
                    t = ((cx - ax) * dx + (cy - ay) * dy) / length2 if length2 > 0.0 else 0.0
                    t = min(max(t, 0.0), 1.0)
                    ex, ey = ax + t * dx - cx, ay + t * dy - cy
                    distance2 = np.float32(ex * ex + ey * ey)
                    if distance2 < best[row - first_row, col]:
                        best[row - first_row, col] = distance2
                        face_index[row, col] = face
                        barycentric[row, col, 0] = 1.0 - t if k == 1 else (t if k == 0 else 0.0)
                        barycentric[row, col, 1] = t if k == 1 else (1.0 - t if k == 2 else 0.0)
