"""Which place on the head each texel shows."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

RING = 3  # texels past a chart's border that are still painted, on the border triangle's plane
DILATE = 16  # texels past that which repeat their nearest painted texel


@dataclass(frozen=True)
class Texels:
    """The painted texels of a size x size texture (row 0 is v = 1), T of them."""

    size: int
    row: np.ndarray  # (T,)
    col: np.ndarray  # (T,)
    inside: np.ndarray  # (T,) False in the ring around each chart
    position: np.ndarray  # (T, 3) mm
    normal: np.ndarray  # (T, 3) interpolated vertex normal, unit
    dp_du: np.ndarray  # (T, 3) mm for a whole turn of u
    dp_dv: np.ndarray  # (T, 3)

    def image(self, values, background):
        """(H, W, C) array: painted texels, repeated into the gutter, `background` beyond."""
        values = values.reshape(len(self.row), -1)
        out = np.empty((self.size, self.size, values.shape[1]), np.float32)
        out[:] = background
        known = np.zeros((self.size, self.size), bool)
        known[self.row, self.col] = True
        out[self.row, self.col] = values
        away, (r, c) = distance_transform_edt(~known, return_indices=True)
        near = (away > 0) & (away <= DILATE)
        out[near] = out[r[near], c[near]]
        return out


def rasterise(size, uv, corner):
    """Triangle whose inside holds each texel's centre, (H, W), -1 where none. Row 0 is v = 1."""
    tri = np.stack([uv[corner][:, :, 0] * size - 0.5, (1 - uv[corner][:, :, 1]) * size - 0.5], -1)
    low = np.ceil(tri.min(1)).astype(int)
    span = np.maximum(np.floor(tri.max(1)).astype(int) - low + 1, 0)
    owner = np.full((size, size), -1)
    for part in np.array_split(np.arange(len(tri)), max(1, len(tri) // 8000)):
        count = span[part, 0] * span[part, 1]
        face = np.repeat(part, count)
        k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        col, row = low[face, 0] + k % span[face, 0], low[face, 1] + k // span[face, 0]
        w = barycentric(tri[face], np.stack([col, row], 1))
        hit = (w >= -1e-9).all(1)
        owner[row[hit], col[hit]] = face[hit]
    return owner


def barycentric(tri, p):
    """Barycentric coordinates (N, 3) of points in triangles (N, 3, 2)."""
    a, e1, e2 = tri[:, 0], tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]
    d = p - a
    det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    b1 = (d[:, 0] * e2[:, 1] - d[:, 1] * e2[:, 0]) / det
    b2 = (e1[:, 0] * d[:, 1] - e1[:, 1] * d[:, 0]) / det
    return np.stack([1 - b1 - b2, b1, b2], 1)


def address(size, vertices, normals, faces, uv, corner):
    """Texels of the mesh, with a ring past every chart's border that continues the border triangles."""
    owner = rasterise(size, uv, corner)
    away, (r, c) = distance_transform_edt(owner < 0, return_indices=True)
    row, col = np.nonzero(away <= RING)
    face = owner[r[row, col], c[row, col]]
    tri = uv[corner[face]]
    # texels of the ring: the address of the nearest covered texel, then straight on along the skin
    from_row, from_col = r[row, col], c[row, col]
    point = np.stack([(from_col + 0.5) / size, 1 - (from_row + 0.5) / size], 1)
    w = barycentric(tri, point)
    p = vertices[faces[face]]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    q1, q2 = tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]
    det = (q1[:, 0] * q2[:, 1] - q1[:, 1] * q2[:, 0])[:, None]
    dp_du, dp_dv = (e1 * q2[:, 1:] - e2 * q1[:, 1:]) / det, (e2 * q1[:, :1] - e1 * q2[:, :1]) / det
    step = dp_du * ((col - from_col) / size)[:, None] + dp_dv * ((from_row - row) / size)[:, None]
    normal = (w[:, :, None] * normals[faces[face]]).sum(1)
    return Texels(
        size=size,
        row=row,
        col=col,
        inside=owner[row, col] >= 0,
        position=(w[:, :, None] * p).sum(1) + step,
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        dp_du=dp_du,
        dp_dv=dp_dv,
    )
