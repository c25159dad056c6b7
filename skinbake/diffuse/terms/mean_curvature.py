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

MOST_STEPS, CLOSE_ENOUGH = 80, 1e-4  # of the iteration; change of a position in units of the smoothing's length


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

    Jacobi's iteration, sped up as Chebyshev polynomials do.
    """
    time = length_mm**2 / 2
    diagonal = area + time * np.asarray(between.sum(axis=1)).ravel()
    used = diagonal > 0
    radius = float(np.max(1 - area[used] / diagonal[used], initial=0.0))
    heat = _Heat(between.indptr, between.indices, between.data, positions, area, diagonal, time)
    before, moved, factor = positions.copy(), positions, 2.0
    change = np.empty(len(positions))
    for step in range(MOST_STEPS):
        factor = 1 / (1 - radius**2 * factor / 4) if step else 1.0
        if step == 1:
            factor = 1 / (1 - radius**2 / 2)
        parallel_for(_move, len(positions), heat, moved, factor, before, change)
        before, moved = moved.copy() if step == 0 else moved, before  # what was given stays as it is
        if change.max(initial=0.0) < CLOSE_ENOUGH * length_mm:
            break
    return moved


class _Heat(NamedTuple):
    """What `_move` reads of the heat on a surface.

    Attributes
    ----------
    start, end, weight : ndarrays
        Rows of the symmetric matrix: neighbours of vertex v and what binds them are start[v] ... start[v + 1] of both.
    positions : ndarray of shape (V, 3)
        Before there was heat.
    area, diagonal : ndarrays of shape (V,)
        Of the vertices, and of the system.
    time : float
    """

    start: NDArray[np.int32]
    end: NDArray[np.int32]
    weight: Float
    positions: Float
    area: Float
    diagonal: Float
    time: float


@kernel
def _move(first: int, stop: int, heat: _Heat, moved: Float, factor: float, before: Float, change: Float) -> None:
    """One step of the iteration at some vertices.

    Parameters
    ----------
    first, stop : int
        Vertices.
    heat : _Heat
    moved : ndarray of shape (V, 3)
        Positions after the last step.
    factor : float
        Of Chebyshev's polynomials.
    before : ndarray of shape (V, 3)
        After the one before; becomes those after this one.
    change : ndarray of shape (V,)
        Written: how far the vertex came along an axis at most.
    """
    for v in range(first, stop):
        change[v] = 0.0
        x, y, z = 0.0, 0.0, 0.0
        for k in range(heat.start[v], heat.start[v + 1]):
            w, n = heat.weight[k], heat.end[k]
            x += w * moved[n, 0]
            y += w * moved[n, 1]
            z += w * moved[n, 2]
        inverse = 1.0 / heat.diagonal[v] if heat.diagonal[v] > 0.0 else 0.0
        for axis in range(3):
            flow = x if axis == 0 else (y if axis == 1 else z)
            again = inverse * (heat.area[v] * heat.positions[v, axis] + heat.time * flow)
            to = factor * (again - before[v, axis]) + before[v, axis]
            if heat.diagonal[v] > 0.0:
                change[v] = max(change[v], abs(to - moved[v, axis]))
            before[v, axis] = to


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
