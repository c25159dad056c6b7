"""Small meshes with known answers."""

from __future__ import annotations

import numpy as np

from skinbake.io.mesh import unwrap_mesh
from skinbake.scene.mesh import SkinMesh


def quad(width_mm=100.0, height_mm=100.0, z_mm=0.0, columns=1, rows=1, uv_box=(0.0, 0.0, 1.0, 1.0)) -> SkinMesh:
    """A rectangle in the plane z = z_mm about the z axis, facing +z, u along x, v along y."""
    x, y = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(x, y))
    positions = np.stack([(u - 0.5) * width_mm, (v - 0.5) * height_mm, np.full(u.size, z_mm)], axis=1)
    u0, v0, u1, v1 = uv_box
    uv = np.stack([u0 + (u1 - u0) * u, v0 + (v1 - v0) * v], axis=1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(columns), np.arange(rows)))
    a = j * (columns + 1) + i
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    normal = np.broadcast_to([0.0, 0.0, 1.0], (len(faces), 3, 3)).copy()
    return SkinMesh(positions, faces, uv[faces], normal)


def joined(*meshes: SkinMesh) -> SkinMesh:
    """Several meshes as one."""
    start = np.cumsum([0, *(len(mesh.positions_mm) for mesh in meshes)])
    return SkinMesh(
        np.concatenate([mesh.positions_mm for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(n) for mesh, n in zip(meshes, start, strict=False)]),
        np.concatenate([mesh.corner_uv for mesh in meshes]),
        np.concatenate([mesh.corner_normal for mesh in meshes]),
    )


def sphere(radius_mm=50.0, layout="latlong", segments=48, tiles=1) -> SkinMesh:
    """A sphere with one of three UV layouts: "latlong" (one chart, one seam, stretched), "cube" (six charts), "xatlas".

    `tiles=2` puts the right half of the layout on UDIM tile 1002.
    """
    if layout == "xatlas":
        return unwrap_mesh(sphere(radius_mm, "latlong", segments))
    if layout == "latlong":
        directions, faces, uv = _latlong(segments)
    elif layout == "cube":
        directions, faces, uv = _cube(segments // 4)
    else:
        raise ValueError(f"layout: expected latlong, cube or xatlas, got {layout}")
    corners = directions[faces]
    outside = (
        np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]) > 0
    )
    faces, uv = np.where(outside[:, None], faces, faces[:, ::-1]), np.where(outside[:, None, None], uv, uv[:, ::-1])
    if tiles == 2:
        uv = uv * [2.0, 1.0]
        over = uv[..., 0].mean(axis=1) > 1
        uv[..., 0] = np.where(over[:, None], np.maximum(uv[..., 0], 1.0), np.minimum(uv[..., 0], 1.0))
    welded, index = np.unique(np.round(directions, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces].astype(np.int32)
    return SkinMesh(welded * radius_mm, faces, uv, welded[faces])


def _latlong(n: int):
    columns, rows = 2 * n, n
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
    theta, phi = np.pi * (1 - v), 2 * np.pi * u
    directions = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1).reshape(-1, 3)
    faces = _grid_faces(columns, rows)
    uv = np.stack([u, v], -1).reshape(-1, 2)[faces] * 0.96 + 0.02
    corners = np.round(directions, 9)[faces]
    same = (corners == np.roll(corners, 1, axis=1)).all(axis=2)  # as the corner before
    whole = ~same.any(axis=1)  # the poles' fans have one triangle a column
    return directions, faces[whole], uv[whole]


def _cube(n: int):
    directions, faces, uv, start = [], [], [], 0
    s, t = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n)
    a, b = np.tan((2 * s - 1) * np.pi / 4), np.tan((2 * t - 1) * np.pi / 4)
    one = np.ones_like(a)
    for side, points in enumerate([(one, b, -a), (-one, b, a), (a, one, -b), (a, -one, b), (a, b, one), (-a, b, -one)]):
        point = np.stack(points, -1).reshape(-1, 3)
        directions.append(point / np.linalg.norm(point, axis=1, keepdims=True))
        faces.append(_grid_faces(n, n) + start)
        corner = np.array([side % 3, side // 3]) / [3, 2]
        uv.append((np.stack([s, t], -1).reshape(-1, 2)[_grid_faces(n, n)] * 0.92 + 0.04) / [3, 2] + corner)
        start += len(point)
    return np.concatenate(directions), np.concatenate(faces), np.concatenate(uv)


def _grid_faces(columns: int, rows: int):
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(columns), np.arange(rows)))
    a = j * (columns + 1) + i
    return np.concatenate(
        [np.stack([a, a + 1, a + columns + 2], 1), np.stack([a, a + columns + 2, a + columns + 1], 1)]
    )


def relief(size_mm=60.0, height_mm=18.0, sigma_mm=9.0, segments=48) -> SkinMesh:
    """A bump on a square, like a nose on a cheek: it shadows itself, and its UVs (from above) stretch on the flanks."""
    flat = quad(size_mm, size_mm, columns=segments, rows=segments)
    x, y, _ = flat.positions_mm.T
    z = height_mm * np.exp(-(x**2 + y**2) / (2 * sigma_mm**2))
    slope = -z / sigma_mm**2
    normal = np.stack([-slope * x, -slope * y, np.ones_like(z)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return SkinMesh(np.stack([x, y, z], axis=1), flat.faces, flat.corner_uv, normal[flat.faces])
