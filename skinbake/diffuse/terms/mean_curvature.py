"""Mean curvature of skin at the scale that scattered light knows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, normalized, safe_div
from skinbake.scene.mesh import SkinMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOST_STEPS, CLOSE_ENOUGH = 300, 3e-4  # of the iteration; residual (rms) in units of the smoothing's length


def mean_curvature(mesh: SkinMesh, smoothing_mm: Sequence[float] | Float) -> Float:
    """Mean curvature at the mesh's vertices, 1/mm, (V, K): 1 / radius of a ball, below 0 in hollows.

    Heat of the variance `smoothing_mm`^2 moves positions by its half times the surface's Laplacian, which is twice the
    mean curvature along the inward normal. One implicit step smooths as it measures: bumps of a smaller size have
    no curvature. Heat stays on the skin, so that the other side of an ear is far away.

    Parameters
    ----------
    mesh : SkinMesh
    smoothing_mm : sequence of K float
        Above 0.

    References
    ----------
    [Desbrun1999]
    """
    positions, faces = mesh.positions_mm.astype(np.float64), mesh.faces.astype(np.int64)
    between, area = _cotangents(positions, faces)
    used, normal = area > 0, _vertex_normals(mesh)
    centred = positions - positions[used].mean(axis=0) if used.any() else positions
    found = np.zeros((len(positions), len(smoothing_mm)))
    for k, length in enumerate(smoothing_mm):
        away = ((centred - _smoothed(between, area, centred, float(length))) * normal).sum(axis=1)
        found[used, k] = away[used] / length**2
    return found


def _smoothed(between: csr_matrix, area: Float, positions: Float, length_mm: float) -> Float:
    """Positions after heat of a length: (area + time L) moved = area positions, time = length^2 / 2.

    By conjugate gradients, preconditioned by the diagonal: triangles of all sizes and shapes take few steps.
    """
    time = length_mm**2 / 2
    diagonal = area + time * np.asarray(between.sum(axis=1)).ravel()
    heat = _Heat(between.indptr, between.indices, between.data, diagonal, time)
    inverse = safe_div(np.ones_like(diagonal), diagonal)[:, None]
    moved, changed = positions.copy(), np.empty_like(positions)
    parallel_for(_apply, len(positions), heat, moved, changed)
    left = area[:, None] * positions - changed
    way = inverse * left
    norm = (left * way).sum(axis=0)
    enough = (CLOSE_ENOUGH * length_mm) ** 2 * area.sum()
    for _ in range(MOST_STEPS):
        if norm.sum() <= enough:
            break
        parallel_for(_apply, len(positions), heat, way, changed)
        step = safe_div(norm, (way * changed).sum(axis=0))
        moved += step * way
        left -= step * changed
        next_way = inverse * left
        before, norm = norm, (left * next_way).sum(axis=0)
        way = next_way + safe_div(norm, before) * way
    return moved


class _Heat(NamedTuple):
    """The matrix of the heat on a surface, as `_apply` reads it.

    Attributes
    ----------
    start, end, weight : ndarrays
        Rows of the symmetric matrix: neighbours of vertex v and what binds them are start[v] ... start[v + 1] of both.
    diagonal : ndarray of shape (V,)
    time : float
    """

    start: NDArray[np.int32]
    end: NDArray[np.int32]
    weight: Float
    diagonal: Float
    time: float


@kernel
def _apply(first: int, stop: int, heat: _Heat, vector: Float, out: Float) -> None:
    """The matrix times vectors, at some vertices.

    Parameters
    ----------
    first, stop : int
        Vertices.
    heat : _Heat
    vector : ndarray of shape (V, 3)
    out : ndarray of shape (V, 3)
        Written.
    """
    for v in range(first, stop):
        x, y, z = 0.0, 0.0, 0.0
        for k in range(heat.start[v], heat.start[v + 1]):
            w, n = heat.weight[k], heat.end[k]
            x += w * vector[n, 0]
            y += w * vector[n, 1]
            z += w * vector[n, 2]
        out[v, 0] = heat.diagonal[v] * vector[v, 0] - heat.time * x
        out[v, 1] = heat.diagonal[v] * vector[v, 1] - heat.time * y
        out[v, 2] = heat.diagonal[v] * vector[v, 2] - heat.time * z


def _cotangents(positions: Float, faces: NDArray[np.int64]) -> tuple[csr_matrix, Float]:
    """Half the cotangents opposite each edge, not below 0, as a symmetric matrix, and a third of the faces' area."""
    from scipy.sparse import coo_matrix  # only where curvature is asked for

    count = len(positions)
    rows, cols, values, area = [], [], [], np.zeros(count)
    corner = positions[faces]
    twice = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        along = ((corner[:, a] - corner[:, k]) * (corner[:, b] - corner[:, k])).sum(axis=1)
        half = np.maximum(safe_div(along, twice), 0) / 2
        rows += [faces[:, a], faces[:, b]]
        cols += [faces[:, b], faces[:, a]]
        values += [half, half]
        area += np.bincount(faces[:, k], twice / 6, count)
    ends = np.concatenate(rows), np.concatenate(cols)
    return coo_matrix((np.concatenate(values), ends), (count, count)).tocsr(), area


def _vertex_normals(mesh: SkinMesh) -> Float:
    """Unit normals at the vertices, the mean of their corners', (V, 3)."""
    index, count = mesh.faces.ravel(), len(mesh.positions_mm)
    corner = mesh.corner_normal.reshape(-1, 3)
    total = np.stack([np.bincount(index, corner[:, axis], count) for axis in range(3)], axis=1)
    return normalized(total)
