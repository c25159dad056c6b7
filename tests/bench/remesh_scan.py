"""The head of the Lee Perry-Smith scan as one closed surface for `skinbake truth`: `... remesh_scan SCAN OUT.obj`.

The scan is closed, but its vertex normals lean away from its triangles by 2 degrees (median; 9 for a tenth of it), and
walks meet the triangles. Voxels of 0.7 mm, smoothed, give a surface whose normals are its own; it is cut at the neck.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, label
from skimage.measure import marching_cubes

from skinbake.io.mesh.read_mesh import read_mesh
from skinbake.io.mesh.write_obj import write_obj
from skinbake.scene.mesh import SkinMesh

LOW_MM, HIGH_MM, STEP_MM = np.array([-110.0, -75.0, -130.0]), np.array([110.0, 205.0, 135.0]), 0.7
SMOOTHED, TRIANGLES = 1.2, 120_000  # in voxels; of the result


def voxels(corner_mm):
    """Which voxels lie inside closed triangles (F, 3, 3): crossings along z, counted below each voxel."""
    size = np.ceil((HIGH_MM - LOW_MM) / STEP_MM).astype(int)
    crossing = np.zeros((size[0], size[1], size[2] + 1), np.int16)
    at = (corner_mm - LOW_MM) / STEP_MM - np.array([0.0137, 0.0071, 0.0])  # no column runs along an edge
    first = np.clip(np.ceil(at[..., :2].min(axis=1)).astype(int), 0, size[:2])
    last = np.clip(np.floor(at[..., :2].max(axis=1)).astype(int) + 1, 0, size[:2])
    for (a, b, c), low, high in zip(at, first, last, strict=True):
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]), indexing="ij")
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if not x.size or area == 0:
            continue
        u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
        v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        z = np.clip(np.ceil(a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])), 0, size[2]).astype(int)
        np.add.at(crossing, (x[inside], y[inside], z[inside]), 1)
    filled = (np.cumsum(crossing, axis=2)[..., :-1] % 2).astype(np.float32)
    for axis in range(3):  # closed where the box cuts it
        np.moveaxis(filled, axis, 0)[[0, 1, 2, -3, -2, -1]] = 0
    return filled


def remesh(corner_mm):
    """Vertices in mm and faces of the largest piece, counter-clockwise from outside."""
    import fast_simplification

    field = gaussian_filter(voxels(corner_mm), SMOOTHED)
    pieces, _ = label(field > 0.5)
    field[(pieces != np.bincount(pieces.ravel())[1:].argmax() + 1) & (pieces > 0)] = 0
    vertices, faces, _, _ = marching_cubes(field, 0.5, spacing=(STEP_MM,) * 3, gradient_direction="ascent")
    vertices, faces = fast_simplification.simplify(
        (vertices + LOW_MM).astype(np.float32), faces.astype(np.int32), target_count=TRIANGLES
    )
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return vertices, faces if (np.cross(a, b) * c).sum() > 0 else faces[:, ::-1]


def main() -> None:
    """Read the scan, write the surface as OBJ."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scan", type=Path, help="head.obj of the scan")
    parser.add_argument("out", type=Path)
    chosen = parser.parse_args()
    vertices, faces = remesh(read_mesh(chosen.scan, 50.35).corner_position_mm)
    corner_normal = smooth_normals(vertices.astype(np.float64), faces)
    write_obj(chosen.out, SkinMesh(vertices.astype(np.float64), faces, np.zeros((len(faces), 3, 2)), corner_normal))


def smooth_normals(vertices, faces):
    """Area-weighted unit normals at the corners, (F, 3, 3)."""
    corner = vertices[faces]
    of_face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros_like(vertices)
    np.add.at(total, faces.ravel(), np.repeat(of_face, 3, axis=0))
    return (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30))[faces]


if __name__ == "__main__":
    main()
