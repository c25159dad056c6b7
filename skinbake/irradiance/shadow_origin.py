"""Where a shadow ray starts: on the smooth surface that the vertex normals imply, not on the flat triangle.

However fine, a facet lit at a grazing angle is shadowed by its neighbours. Each corner's tangent plane says how far the
smooth surface bulges above a point of the facet; their blend is where the ray can start [Hanika2021].
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE
from skinbake.irradiance.smooth_surface import descend
from skinbake.numerics import Float

Image = NDArray[np.float32]


@njit(cache=True, inline="always")
def facet_point(corners: Float, f: int, b1: float, b2: float) -> tuple[float, float, float]:
    """Point of the flat triangle."""
    b0 = 1.0 - b1 - b2
    return (
        b0 * corners[f, 0, 0] + b1 * corners[f, 1, 0] + b2 * corners[f, 2, 0],
        b0 * corners[f, 0, 1] + b1 * corners[f, 1, 1] + b2 * corners[f, 2, 1],
        b0 * corners[f, 0, 2] + b1 * corners[f, 1, 2] + b2 * corners[f, 2, 2],
    )


@njit(cache=True, inline="always")
def bulge(
    corners: Float, normals: Float, relief: float, f: int, b1: float, b2: float, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Offset from the facet's point to the smooth surface; only outwards, so creases are left alone.

    And by `relief` along the normal, or the kinks between patches would fray the shadow that grazing light meets first.
    """
    dx, dy, dz = 0.0, 0.0, 0.0
    for k in range(3):
        b = 1.0 - b1 - b2 if k == 0 else (b1 if k == 1 else b2)
        nx, ny, nz = normals[f, k, 0], normals[f, k, 1], normals[f, k, 2]
        height = (px - corners[f, k, 0]) * nx + (py - corners[f, k, 1]) * ny + (pz - corners[f, k, 2]) * nz
        rise = b * (relief - min(height, 0.0))
        dx += rise * nx
        dy += rise * ny
        dz += rise * nz
    return dx, dy, dz


@njit(cache=True, parallel=True)
def place(
    face_index: NDArray[np.int32],
    barycentric: Image,
    levels: int,
    corners: Float,
    normals: Float,
    lift: Float,
    relief: Float,
    point: Image,
    start: Image,
    offset: Image,
) -> None:
    """Facet points and offsets to the smooth surface of every addressed texel.

    Parameters
    ----------
    levels, corners, normals : int and ndarrays of shape (F 4^levels, 3, 3)
        Of the smooth surface: positions about the occluder's centre, and unit normals.
    lift : ndarray of shape (F 4^levels, 3)
        Step off the facet that round-off asks for.
    relief : ndarray of shape (F, 3)
    point, start, offset : ndarrays of shape (H, W, 3), written
        On the facet, a hair above it, and from there to the smooth surface.
    """
    height, width = face_index.shape
    for row in prange(height):
        for col in range(width):
            face = face_index[row, col]
            if face == NO_FACE:
                continue
            b1, b2 = float(barycentric[row, col, 0]), float(barycentric[row, col, 1])
            rise = (1.0 - b1 - b2) * relief[face, 0] + b1 * relief[face, 1] + b2 * relief[face, 2]
            f, b1, b2 = descend(face, b1, b2, levels)
            px, py, pz = facet_point(corners, f, b1, b2)
            dx, dy, dz = bulge(corners, normals, rise, f, b1, b2, px, py, pz)
            point[row, col, 0], point[row, col, 1], point[row, col, 2] = px, py, pz
            start[row, col, 0] = px + lift[f, 0]
            start[row, col, 1] = py + lift[f, 1]
            start[row, col, 2] = pz + lift[f, 2]
            offset[row, col, 0], offset[row, col, 1], offset[row, col, 2] = dx, dy, dz


@njit(cache=True, parallel=True)
def place_inside_texels(
    texels: NDArray[np.int64],
    grid: int,
    face_index: NDArray[np.int32],
    barycentric: Image,
    per_texel: Float,
    levels: int,
    corners: Float,
    normals: Float,
    lift: Float,
    relief: Float,
    on_facet: NDArray[np.bool_],
) -> Image:
    """Ray origins of grid x grid points inside each listed texel, shape (len(texels), grid * grid, 3).

    Parameters
    ----------
    texels : ndarray of shape (n,)
        row * W + col.
    per_texel : ndarray of shape (F, 2, 2)
        Change of the barycentrics 1 and 2 with a step of one column and one row down.
    on_facet : ndarray of shape (H, W)
        Where the way to the smooth surface is barred.
    """
    width = face_index.shape[1]
    out = np.empty((len(texels), grid * grid, 3), dtype=np.float32)
    for i in prange(len(texels)):
        row, col = texels[i] // width, texels[i] % width
        face = face_index[row, col]
        for s in range(grid * grid):
            step_x, step_y = (s % grid + 0.5) / grid - 0.5, (s // grid + 0.5) / grid - 0.5
            b1 = barycentric[row, col, 0] + step_x * per_texel[face, 0, 0] + step_y * per_texel[face, 1, 0]
            b2 = barycentric[row, col, 1] + step_x * per_texel[face, 0, 1] + step_y * per_texel[face, 1, 1]
            # Beyond the triangle's edge: its closest corner mix, at most a texel away
            b1, b2 = min(max(b1, 0.0), 1.0), min(max(b2, 0.0), 1.0)
            if b1 + b2 > 1.0:
                b1, b2 = b1 / (b1 + b2), b2 / (b1 + b2)
            rise = (1.0 - b1 - b2) * relief[face, 0] + b1 * relief[face, 1] + b2 * relief[face, 2]
            f, b1, b2 = descend(face, b1, b2, levels)
            px, py, pz = facet_point(corners, f, b1, b2)
            dx, dy, dz = 0.0, 0.0, 0.0
            if not on_facet[row, col]:
                dx, dy, dz = bulge(corners, normals, rise, f, b1, b2, px, py, pz)
            out[i, s, 0] = px + dx + lift[f, 0]
            out[i, s, 1] = py + dy + lift[f, 1]
            out[i, s, 2] = pz + dz + lift[f, 2]
    return out
