"""From the field to a triangle mesh."""

import fast_simplification
import numpy as np
from skimage.measure import marching_cubes

from sample_head.remesh import collapse_short, drop_pillows, flip_edges, spread

LOW, HIGH = np.array([-100.0, -30.0, -106.0]), np.array([100.0, 236.0, 126.0])


def sample_field(field, step_mm):
    """Field on a grid of `step_mm`, evaluated only near the surface; elsewhere the value of the coarse cell.

    Returns the (X, Y, Z) float32 grid and its origin.
    """
    ratio = 8
    coarse_step = ratio * step_mm
    blocks = np.ceil((HIGH - LOW) / coarse_step).astype(int)
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in blocks], indexing="ij"), -1).reshape(-1, 3)
    offset = LOW + (ratio - 1) / 2 * step_mm
    middle = field(offset + corner * coarse_step)
    grid = np.repeat(np.repeat(np.repeat(middle.reshape(blocks), ratio, 0), ratio, 1), ratio, 2).astype(np.float32)
    near = np.flatnonzero(np.abs(middle) < 1.35 * coarse_step * np.sqrt(3) / 2 + 2.5)
    inner = np.stack(np.meshgrid(*[np.arange(ratio)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for part in np.array_split(near, max(1, len(near) // 600)):
        cell = (corner[part, None] * ratio + inner[None]).reshape(-1, 3)
        grid[cell[:, 0], cell[:, 1], cell[:, 2]] = field(LOW + cell * step_mm)
    return grid, LOW


def polygonise(field, step_mm):
    """Dense mesh of the zero surface: vertices (N, 3) mm, faces (M, 3), outward counter-clockwise."""
    grid, origin = sample_field(field, step_mm)
    vertices, faces, _, _ = marching_cubes(grid, 0.0, spacing=(step_mm,) * 3, gradient_direction="descent")
    return largest_piece(vertices.astype(float) + origin, faces.astype(np.int64))


def largest_piece(vertices, faces):
    """Only the biggest connected piece (a carved pocket inside would otherwise stay)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = len(vertices)
    link = coo_matrix(
        (np.ones(2 * len(faces)), (np.r_[faces[:, 0], faces[:, 1]], np.r_[faces[:, 1], faces[:, 2]])), (n, n)
    )
    label = connected_components(link, directed=False)[1]
    keep = label == np.bincount(label).argmax()
    number = np.cumsum(keep) - 1
    return vertices[keep], number[faces[keep[faces[:, 0]]]]


def gradient(field, points, step_mm=0.25):
    """Gradient of the field, shape (N, 3), by central differences."""
    out = np.empty_like(points)
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = step_mm
        out[:, axis] = (field(points + shift) - field(points - shift)) / (2 * step_mm)
    return out


def project(field, points, rounds=2):
    """Points moved onto the zero surface by Newton steps of at most 0.3 mm."""
    for _ in range(rounds):
        g = gradient(field, points)
        step = field(points)[:, None] * g / np.maximum((g * g).sum(1, keepdims=True), 1e-3)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        points = points - step * np.minimum(1.0, 0.3 / np.maximum(size, 1e-9))
    return points


def simplify(vertices, faces, target):
    """Quadric decimation to about `target` triangles."""
    v, f = fast_simplification.simplify(vertices.astype(np.float32), faces.astype(np.int32), target_count=target)
    return v.astype(float), f.astype(np.int64)


def build_mesh(field, step_mm, triangles):
    """Clean, adaptively fine mesh of the field: vertices (N, 3) in mm and faces (M, 3)."""
    vertices, faces = polygonise(field, step_mm)
    vertices, faces = largest_piece(*drop_pillows(*simplify(project(field, vertices, 1), faces, triangles)))
    for _ in range(4):
        vertices = project(field, vertices, 1)
        vertices, faces = collapse_short(vertices, faces, 0.3)
        for _ in range(3):
            faces, _ = flip_edges(vertices, faces)
        vertices = spread(vertices, faces, unit_normals(field, vertices), 0.4)
    vertices = project(field, vertices, 2)
    for _ in range(3):
        faces, _ = flip_edges(vertices, faces)
    return vertices, faces


def unit_normals(field, points):
    """Outward normals of the field's surface, shape (N, 3)."""
    g = gradient(field, points)
    return g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-9)
