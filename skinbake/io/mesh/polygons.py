"""Polygons of any number of corners as triangles, concave ones without triangles across their notches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float, normalized

Index = NDArray[np.int64]
# Sine of the angle by which a corner must turn the wrong way. Bent quads often seem to, a little, and either diagonal
# serves them; of larger polygons a fan would lay triangles over one another
CONCAVE, CONCAVE_QUAD = 1e-6, 0.1


def triangulate(corner_positions: Float, sizes: Index) -> Index:
    """Cut polygons into triangles.

    Parameters
    ----------
    corner_positions : ndarray of shape (C, 3)
        Positions of all polygons' corners, one polygon after the other.
    sizes : ndarray of shape (P,)
        Number of corners of each polygon; those with fewer than three give no triangle.

    Returns
    -------
    ndarray of shape (T, 3)
        Indices into the corners, T = sum(sizes - 2). First the first triangle of every polygon, then every second...
    """
    triangles = np.maximum(sizes - 2, 0)
    if (sizes == 3).all():
        return np.arange(len(corner_positions), dtype=np.int64).reshape(-1, 3)
    start = np.cumsum(sizes) - sizes
    before = np.cumsum(triangles) - triangles
    polygon = np.repeat(np.arange(len(sizes)), triangles)
    number = np.arange(len(polygon)) - before[polygon]
    first = start[polygon]
    fan = np.stack([first, first + number + 1, first + number + 2], axis=1)
    later = number > 0
    fan[later] = np.roll(fan[later], -1, axis=1)
    with np.errstate(all="ignore"):  # what overflows is refused by whoever reads the file
        for index in np.flatnonzero(_concave(corner_positions, sizes, start)):
            cut = _ears(corner_positions[start[index] : start[index] + sizes[index]])
            if cut is not None:
                fan[before[index] : before[index] + triangles[index]] = start[index] + cut
    return fan[np.argsort(number, kind="stable")]


def _concave(corner_positions: Float, sizes: Index, start: Index) -> NDArray[np.bool_]:
    """Polygons with a corner that turns against the polygon's own normal."""
    found = np.zeros(len(sizes), dtype=np.bool_)
    for size in np.unique(sizes[sizes > 3]):
        of_size = np.flatnonzero(sizes == size)
        points = corner_positions[start[of_size][:, None] + np.arange(size)]
        edges = normalized(np.roll(points, -1, axis=1) - points)
        turn = np.cross(np.roll(edges, 1, axis=1), edges)
        normal = normalized(_newell(points))
        limit = CONCAVE_QUAD if size == 4 else CONCAVE
        found[of_size] = (np.einsum("pki,pi->pk", turn, normal) < -limit).any(axis=1)
    return found


def _newell(points: Float) -> Float:
    """Twice the area vectors of polygons of shape (P, K, 3)."""
    centred = points - points[:, :1]
    return np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)


def _ears(points: Float) -> Index | None:
    """Triangles (K - 2, 3) of one polygon, or None where it is too crossed over itself to be cut."""
    import mapbox_earcut

    normal = normalized(_newell(points[None])[0])
    if not np.isfinite(points).all() or not normal.any():
        return None
    # Seen along its normal
    across = normalized(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]))
    flat = (points - points[0]) @ np.stack([across, np.cross(normal, across)], axis=1)
    scale = np.abs(flat).max()
    if not 0 < scale < np.inf:
        return None
    flat /= scale
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(points)], np.uint32)).reshape(-1, 3).astype(np.int64)
    a, b, c = (flat[found[:, k]] for k in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    found[twice < 0] = found[twice < 0][:, ::-1]
    triangles = _with_straight_corners([tuple(row) for row in found.tolist()], len(points))
    return np.array(triangles, dtype=np.int64) if len(triangles) == len(points) - 2 else None


def _with_straight_corners(triangles: list[tuple[int, ...]], size: int) -> list[tuple[int, ...]]:
    """Earcut leaves out corners on a straight edge; neighbours use them, so each is put back on its edge."""
    used = {corner for triangle in triangles for corner in triangle}
    for corner in range(size):
        if corner in used or not used:
            continue
        last = next(k % size for k in range(corner - 1, corner - size, -1) if k % size in used)
        following = next(k % size for k in range(corner + 1, corner + size) if k % size in used)
        for place, (a, b, c) in enumerate(triangles):
            turned = next((t for t in ((a, b, c), (b, c, a), (c, a, b)) if t[:2] == (last, following)), None)
            if turned:
                triangles[place : place + 1] = [(last, corner, turned[2]), (corner, following, turned[2])]
                used.add(corner)
                break
    return triangles
