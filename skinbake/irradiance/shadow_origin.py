"""Origins of shadow rays: on the smooth surface that the vertex normals imply, not on the flat triangle.

However fine, a facet lit at a grazing angle is shadowed by its neighbours. Each corner's tangent plane says how far
the smooth surface stands above a point of the facet; their blend is where the ray can start, theory.md 10.5
[Hanika2021].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE, ShownFaces
from skinbake.irradiance.smooth_surface import SmoothSurface, descend
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

Image = NDArray[np.float32]
Index = NDArray[np.int64]


class SubdividedMesh(NamedTuple):
    """Triangles of the smooth surface as the kernels take them, 4^levels to each of the F faces of the mesh.

    Attributes
    ----------
    levels : int
    corner_mm : ndarray of shape (F 4^levels, 3, 3), float32
        Positions about the occluder's centre, as rays meet them.
    corner_normal : ndarray of shape (F 4^levels, 3, 3), float32
        Unit.
    facing : ndarray of shape (F 4^levels, 3), float32
        Unit normal of the flat triangle, on the side of its corners' normals.
    relief_mm : ndarray of shape (F, 3)
        Height of the mesh's own bulges about each corner, as in SmoothSurface.
    bulge_mm : ndarray of shape (F,)
        No point of a face is further from the smooth surface.
    """

    levels: int
    corner_mm: Image
    corner_normal: Image
    facing: Image
    relief_mm: Float
    bulge_mm: Float


class SurfaceTexels(NamedTuple):
    """Which skin each texel of a tile shows, and its normals, as the kernels take it.

    Attributes
    ----------
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
        As in `ShownFaces`.
    normal, smooth : ndarrays of shape (H, W, 3), float32
        Unit normals with and without the normal map.
    """

    face_index: NDArray[np.int32]
    barycentric: Image
    normal: Image
    smooth: Image


class InsideTexels(NamedTuple):
    """Places inside texels from which rays start.

    Attributes
    ----------
    texels : ndarray of shape (n,), int64
        row * W + col.
    grid : int
        Places along each side of a texel.
    per_texel : ndarray of shape (F, 2, 2)
        Change of the barycentrics 1 and 2 with a step of one column and one row down.
    on_facet : ndarray of shape (H, W), bool
        Texels whose way to the smooth surface is barred: their rays start on the facet.
    """

    texels: Index
    grid: int
    per_texel: Float
    on_facet: NDArray[np.bool_]


def facets_of(surface: SmoothSurface, centre_mm: Float) -> SubdividedMesh:
    """Triangles of a smooth surface for the kernels, with positions about `centre_mm`."""
    corner = (surface.positions_mm - centre_mm)[surface.faces]
    facing, depth_mm = np.empty((len(corner), 3), np.float32), np.empty(len(corner))
    _measure(corner, surface.corner_normal, facing, depth_mm)
    bulge_mm = surface.relief_mm.max(axis=1) + depth_mm.reshape(len(surface.relief_mm), -1).max(axis=1, initial=0)
    corner_mm, corner_normal = corner.astype(np.float32), surface.corner_normal.astype(np.float32)
    return SubdividedMesh(surface.levels, corner_mm, corner_normal, facing, surface.relief_mm, bulge_mm)


@kernel
def _measure(corner: Float, normal: Float, facing: Image, depth: Float) -> None:
    """Normals of triangles, and how deep each lies below the tangent planes at its corners.

    Parameters
    ----------
    corner, normal : ndarrays of shape (n, 3, 3)
        Positions in mm, and unit normals.
    facing : ndarray of shape (n, 3)
        Written: unit normals on the side of the corners' normals.
    depth : ndarray of shape (n,)
        Written, mm.
    """
    for f in range(len(corner)):
        ax, ay, az = corner[f, 0, 0], corner[f, 0, 1], corner[f, 0, 2]
        bx, by, bz = corner[f, 1, 0] - ax, corner[f, 1, 1] - ay, corner[f, 1, 2] - az
        cx, cy, cz = corner[f, 2, 0] - ax, corner[f, 2, 1] - ay, corner[f, 2, 2] - az
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        along, deepest = 0.0, 0.0
        for k in range(3):
            nx, ny, nz = normal[f, k, 0], normal[f, k, 1], normal[f, k, 2]
            along += nx * x + ny * y + nz * z
            # Heights of the corners above this one's plane
            of_b, of_c = nx * bx + ny * by + nz * bz, nx * cx + ny * cy + nz * cz
            own = 0.0 if k == 0 else (of_b if k == 1 else of_c)
            deepest = max(deepest, own, own - of_b, own - of_c)
        depth[f] = deepest
        length = np.sqrt(x * x + y * y + z * z)
        scale = 0.0 if length == 0.0 else (-1.0 / length if along < 0.0 else 1.0 / length)
        facing[f, 0], facing[f, 1], facing[f, 2] = scale * x, scale * y, scale * z


@kernel(inline=True)
def facet_point(corners: Float | Image, f: int, b1: float, b2: float) -> tuple[float, float, float]:
    """Corner values of face f blended by barycentrics: a point of the flat triangle.

    Parameters
    ----------
    corners : ndarray of shape (F, 3, 3)
    f : int
    b1, b2 : float
        Weights of corners 1 and 2.
    """
    b0 = 1.0 - b1 - b2
    return (
        b0 * corners[f, 0, 0] + b1 * corners[f, 1, 0] + b2 * corners[f, 2, 0],
        b0 * corners[f, 0, 1] + b1 * corners[f, 1, 1] + b2 * corners[f, 2, 1],
        b0 * corners[f, 0, 2] + b1 * corners[f, 1, 2] + b2 * corners[f, 2, 2],
    )


@kernel(inline=True)
def subdivision_offset(
    corners: Image, normals: Image, relief: float, f: int, b1: float, b2: float, at: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Offset from a point of the facet to the smooth surface, mm; theory.md 10.5. Only outwards: creases are left
    alone.

    Raised further by `relief` along the normal, or the kinks between patches would fray the shadow that grazing light
    meets first.

    Parameters
    ----------
    corners, normals : ndarrays of shape (F, 3, 3)
    relief : float
        Mm.
    f : int
        Face.
    b1, b2 : float
        Barycentric weights of its corners 1 and 2.
    at : tuple of three floats
        The point, mm.
    """
    px, py, pz = at
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


@kernel(inline=True)
def point_of(subdivided: SubdividedMesh, face: int, b1: float, b2: float) -> tuple[float, float, float]:
    """Point of the skin, mm about the occluder's centre, at a place in a face of the mesh.

    Parameters
    ----------
    subdivided : SubdividedMesh
    face : int
    b1, b2 : float
        Barycentric weights of its corners 1 and 2.
    """
    f, b1, b2 = descend(face, b1, b2, subdivided.levels)
    return facet_point(subdivided.corner_mm, f, b1, b2)


@kernel(inner=True)
def offset_to_smooth_surface(
    subdivided: SubdividedMesh, step_mm: Float, face: int, b1: float, b2: float
) -> tuple[float, float, float, float, float, float]:
    """Start a hair above the facet, at a place in a face of the mesh, and offset from there to the smooth surface, mm.

    Parameters
    ----------
    subdivided : SubdividedMesh
    step_mm : ndarray of shape (F,)
        Step off the facet that round-off asks for.
    face : int
    b1, b2 : float
        Barycentric weights of its corners 1 and 2.

    Returns
    -------
    px, py, pz, dx, dy, dz : float
    """
    rise = (
        (1.0 - b1 - b2) * subdivided.relief_mm[face, 0]
        + b1 * subdivided.relief_mm[face, 1]
        + b2 * subdivided.relief_mm[face, 2]
    )
    f, b1, b2 = descend(face, b1, b2, subdivided.levels)
    px, py, pz = facet_point(subdivided.corner_mm, f, b1, b2)
    dx, dy, dz = subdivision_offset(subdivided.corner_mm, subdivided.corner_normal, rise, f, b1, b2, (px, py, pz))
    step = step_mm[face]
    px, py, pz = (
        px + step * subdivided.facing[f, 0],
        py + step * subdivided.facing[f, 1],
        pz + step * subdivided.facing[f, 2],
    )
    return px, py, pz, dx, dy, dz


@kernel
def long_ways(
    first: int,
    stop: int,
    shown: ShownFaces,
    subdivided: SubdividedMesh,
    step_mm: Float,
    threshold_mm: Float,
    out: NDArray[np.bool_],
) -> None:
    """Texels whose offset to the smooth surface is longer than a threshold of their face.

    Parameters
    ----------
    first, stop : int
        Rows.
    shown : ShownFaces
    subdivided : SubdividedMesh
    step_mm, threshold_mm : ndarrays of shape (F,)
        Step off the facet that round-off asks for, and the length.
    out : ndarray of shape (H, W)
        Written.
    """
    face_index, barycentric = shown.face_index, shown.barycentric
    for row in range(first, stop):
        for col in range(face_index.shape[1]):
            face = face_index[row, col]
            out[row, col] = False
            if face != NO_FACE and subdivided.bulge_mm[face] > threshold_mm[face]:
                b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
                _, _, _, dx, dy, dz = offset_to_smooth_surface(subdivided, step_mm, face, b1, b2)
                out[row, col] = dx * dx + dy * dy + dz * dz > threshold_mm[face] * threshold_mm[face]


@kernel
def place(
    first: int,
    stop: int,
    places: ShownFaces,
    subdivided: SubdividedMesh,
    step_mm: Float,
    start: Image,
    way: Image,
) -> None:
    """Starts and offsets of `offset_to_smooth_surface` at n places in faces.

    Parameters
    ----------
    first, stop : int
        Places.
    places : ShownFaces
    subdivided : SubdividedMesh
    step_mm : ndarray of shape (F,)
        Step off the facet that round-off asks for.
    start, way : ndarrays of shape (n, 3), float32
        Written, mm.
    """
    for i in range(first, stop):
        face, b1, b2 = places.face_index[i], places.barycentric[i, 0], places.barycentric[i, 1]
        px, py, pz, dx, dy, dz = offset_to_smooth_surface(subdivided, step_mm, face, np.float64(b1), np.float64(b2))
        start[i, 0], start[i, 1], start[i, 2] = px, py, pz
        way[i, 0], way[i, 1], way[i, 2] = dx, dy, dz


@kernel
def place_inside_texels(
    first: int,
    stop: int,
    inside: InsideTexels,
    shown: ShownFaces,
    subdivided: SubdividedMesh,
    step_mm: Float,
    out: Image,
) -> None:
    """Ray origins of grid x grid points inside each listed texel, mm.

    Parameters
    ----------
    first, stop : int
        Of the texels.
    inside : InsideTexels
    shown : ShownFaces
    subdivided : SubdividedMesh
    step_mm : ndarray of shape (F,)
        Step off the facet that round-off asks for.
    out : ndarray of shape (n, grid * grid, 3)
        Written.
    """
    texels, grid, per_texel = inside.texels, inside.grid, inside.per_texel
    face_index, barycentric = shown.face_index, shown.barycentric
    width = face_index.shape[1]
    for i in range(first, stop):
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
            px, py, pz, dx, dy, dz = offset_to_smooth_surface(subdivided, step_mm, face, b1, b2)
            if inside.on_facet[row, col]:
                dx, dy, dz = 0.0, 0.0, 0.0
            out[i, s, 0], out[i, s, 1], out[i, s, 2] = px + dx, py + dy, pz + dz
