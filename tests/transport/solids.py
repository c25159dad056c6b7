"""Closed meshes with known answers."""

from __future__ import annotations

import numpy as np

from skinbake.irradiance.smooth_surface import smooth_surface
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.surface_rays import SurfaceRays


def box(low_mm, high_mm) -> SkinMesh:
    """A box of twelve triangles with flat normals; faces 10 and 11 are the top (+z)."""
    corner = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    positions = np.asarray(low_mm, float) + corner * (np.asarray(high_mm, float) - np.asarray(low_mm, float))
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32)
    mesh = SkinMesh(positions, faces, np.zeros((12, 3, 2)), np.zeros((12, 3, 3)))
    return SkinMesh(positions, faces, np.zeros((12, 3, 2)), np.repeat(mesh.face_normal[:, None], 3, axis=1))


def on_top(mesh: SkinMesh, x, y):
    """Faces and barycentrics of points (x, y) on the top of a box."""
    corners = mesh.corner_position_mm
    faces, places = [], []
    for at in zip(np.atleast_1d(x), np.atleast_1d(y), strict=True):
        for face in (10, 11):
            a, b, c = corners[face, :, :2]
            b1, b2 = np.linalg.solve(np.stack([b - a, c - a], axis=1), np.array(at) - a)
            if min(b1, b2, 1 - b1 - b2) >= 0:
                faces.append(face)
                places.append((b1, b2))
                break
    return np.array(faces, np.int32), np.array(places)


def rays_of(mesh: SkinMesh) -> SurfaceRays:
    """What walks meet."""
    return SurfaceRays(smooth_surface(mesh))
