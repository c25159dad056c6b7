"""Smooth surface that a mesh's vertex normals imply, as finer triangles.

Shading normals pretend that a coarse mesh is smooth; shadows of its flat triangles give it away, as blocks along the
terminator and polygons in place of curved shadow edges. Rays therefore meet this surface, and start on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

FLAT_ENOUGH_MM = 0.02  # height of the bulges that may remain: a tenth of a texel of a 2048^2 head
MAX_FACES = 600_000
MAX_SLOPE = (
    0.1  # height of an edge's arc over its length; a steeper one is a crease with poor normals, not a round form
)

_CHILDREN = np.array([(0, 3, 5), (3, 1, 4), (5, 4, 2), (4, 5, 3)])  # 0..2 corners, 3..5 middles of edges 01, 12, 20


@dataclass(frozen=True)
class SmoothSurface:
    """Subdivided mesh: triangles 4^levels f ... 4^levels (f + 1) - 1 lie in face f of the mesh.

    Attributes
    ----------
    levels : int
    positions_mm : ndarray of shape (V, 3)
    faces : ndarray of shape (F 4^levels, 3)
    corner_normal : ndarray of shape (F 4^levels, 3, 3)
    relief_mm : ndarray of shape (F of the mesh, 3)
        Height of the mesh's own bulges about each corner. Within it nothing is known: patches meet with a kink, and no
        subdivision smooths that.
    """

    levels: int
    positions_mm: Float
    faces: NDArray[np.int32]
    corner_normal: Float
    relief_mm: Float


def smooth_surface(mesh: SkinMesh) -> SmoothSurface:
    """Subdivide until 99 % of the bulges left out are below `FLAT_ENOUGH_MM`, or the count is too high."""
    surface = SmoothSurface(0, mesh.positions_mm, mesh.faces, mesh.corner_normal, _relief_mm(mesh))
    while 4 * len(surface.faces) <= MAX_FACES:
        edge, offset = _edges(surface)
        heights = np.linalg.norm(offset, axis=1)
        if np.quantile(heights, 0.99) <= FLAT_ENOUGH_MM:
            break
        surface = _subdivide(surface, edge, offset)
    return surface


def _relief_mm(mesh: SkinMesh) -> Float:
    """Height by which the normals at both ends of an edge disagree on its arc: largest of a face, mean about a vertex.

    On an arc of a circle they lean outwards by the same angle; where one leans more, the edge is an S.
    """
    chord = np.roll(mesh.corner_position_mm, -1, axis=1) - mesh.corner_position_mm
    both = mesh.corner_normal + np.roll(mesh.corner_normal, -1, axis=1)
    disagreement = np.abs(np.einsum("fki,fki->fk", chord, both)) / 4
    of_face = np.minimum(disagreement, MAX_SLOPE * np.linalg.norm(chord, axis=-1)).max(axis=1)
    index, count = mesh.faces.ravel(), len(mesh.positions_mm)
    total = np.bincount(index, np.repeat(of_face, 3), count)
    return (total / np.maximum(np.bincount(index, minlength=count), 1))[mesh.faces]


def _edges(surface: SmoothSurface) -> tuple[NDArray[np.int64], Float]:
    """Edge of each corner and its successor, shape (F, 3), and the way from each edge's middle to its arc, mm, (E, 3).

    The middle of an arc lies half way between the chord and the tangent planes at its ends. Hard edges, where the two
    faces have different normals, stay straight; both faces of an edge use one middle, so that no crack opens.
    """
    a, b = surface.faces.astype(np.int64), np.roll(surface.faces, -1, axis=1).astype(np.int64)
    low, high = np.minimum(a, b), np.maximum(a, b)
    _, first, edge = np.unique((low * len(surface.positions_mm) + high).ravel(), return_index=True, return_inverse=True)
    edge = edge.ravel()

    offset = np.empty((len(first), 3))
    _bend(surface.positions_mm, surface.faces, surface.corner_normal, first, edge, offset)
    return edge.reshape(-1, 3), offset


@kernel
def _bend(
    positions: Float, faces: NDArray[np.int32], normal: Float, first: NDArray[np.int64], edge: NDArray[np.int64],
    offset: Float,
) -> None:  # fmt: skip
    """The way from each edge's middle to its arc.

    Parameters
    ----------
    positions, faces, normal : ndarrays
        Of a `SmoothSurface`.
    first : ndarray of shape (E,)
        Corner at which each edge is met first, of all corners in their order.
    edge : ndarray of shape (3 F,)
        Edge of each corner and its successor.
    offset : ndarray of shape (E, 3)
        Written, mm.
    """
    hard = np.zeros(len(first), np.bool_)
    for corner in range(len(edge)):
        f, low, high = _ends(faces, corner)
        of, its_low, its_high = _ends(faces, first[edge[corner]])
        for axis in range(3):
            if (
                abs(normal[f, low, axis] - normal[of, its_low, axis]) > 1e-3
                or abs(normal[f, high, axis] - normal[of, its_high, axis]) > 1e-3
            ):
                hard[edge[corner]] = True
    for e in range(len(first)):
        f, low, high = _ends(faces, first[e])
        chord = _subtract(positions[faces[f, high]], positions[faces[f, low]])
        from_low, from_high = 0.5 * _dot(chord, normal[f, low]), -0.5 * _dot(chord, normal[f, high])
        for axis in range(3):
            offset[e, axis] = 0.0 - 0.25 * normal[f, low, axis] * from_low - 0.25 * normal[f, high, axis] * from_high
        # Poor normals must not fold the surface
        length, height = np.sqrt(_dot(chord, chord)), np.sqrt(_dot(offset[e], offset[e]))
        scale = 0.0 if hard[e] else min(1.0, MAX_SLOPE * length / max(height, 1e-300))
        for axis in range(3):
            offset[e, axis] *= scale


@kernel(inline=True)
def _ends(faces, corner):  # type: ignore[no-untyped-def]
    """Face of a corner, and which of its corners are the lower and the higher vertex of the edge to the next one.

    Parameters
    ----------
    faces : ndarray
    corner : int
        Of all corners in their order.
    """
    f, k = corner // 3, corner % 3
    after = (k + 1) % 3
    if faces[f, k] > faces[f, after]:
        return f, after, k
    return f, k, after


def _subdivide(surface: SmoothSurface, edge: NDArray[np.int64], offset: Float) -> SmoothSurface:
    """The surface with each triangle cut into four: one at each corner, then the middle one."""
    middle = np.empty_like(offset)
    a, b = surface.faces, np.roll(surface.faces, -1, axis=1)
    middle[edge] = 0.5 * (surface.positions_mm[a] + surface.positions_mm[b])
    positions = np.concatenate([surface.positions_mm, middle + offset])
    count = len(surface.faces)
    faces, normal = np.empty((count, 4, 3), np.int32), np.empty((count, 4, 3, 3))
    _cut(surface.positions_mm, surface.faces, surface.corner_normal, edge, faces, normal)
    return SmoothSurface(
        surface.levels + 1, positions, faces.reshape(-1, 3), normal.reshape(-1, 3, 3), surface.relief_mm
    )


@kernel
def _cut(
    positions: Float, faces: NDArray[np.int32], normal: Float, edge: NDArray[np.int64], child: NDArray[np.int32],
    child_normal: Float,
) -> None:  # fmt: skip
    """Four triangles for each: their vertices, of which the middles of edges follow those of the surface, and normals.

    Normals at the middles stand on the edge's Hermite curve, so that the next level follows the same surface.

    Parameters
    ----------
    positions, faces, normal : ndarrays
        Of a `SmoothSurface`.
    edge : ndarray of shape (F, 3)
        Edge of each corner and its successor.
    child : ndarray of shape (F, 4, 3)
        Written.
    child_normal : ndarray of shape (F, 4, 3, 3)
        Written.
    """
    index, here = np.empty(6, np.int32), np.empty((6, 3))
    for f in range(len(faces)):
        for k in range(3):
            after = (k + 1) % 3
            index[k], index[3 + k] = faces[f, k], edge[f, k] + len(positions)
            chord = _subtract(positions[faces[f, after]], positions[faces[f, k]])
            n, to_next, tangent = normal[f, k], normal[f, after], here[3 + k]
            at_n, at_next = _dot(chord, n), _dot(chord, to_next)
            for axis in range(3):
                here[k, axis] = n[axis]
                ends = 2.0 * chord[axis] - n[axis] * at_n - to_next[axis] * at_next
                tangent[axis] = 1.5 * chord[axis] - 0.25 * ends
            _unit(tangent)
            along = _dot(_add(n, to_next), tangent)
            for axis in range(3):
                tangent[axis] = n[axis] + to_next[axis] - tangent[axis] * along
            _unit(tangent)
        for j in range(4):
            for k in range(3):
                child[f, j, k] = index[_CHILDREN[j, k]]
                for axis in range(3):
                    child_normal[f, j, k, axis] = here[_CHILDREN[j, k], axis]


@kernel(inline=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    """Sum of products.

    Parameters
    ----------
    a, b : three floats each
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(inline=True)
def _add(a, b):  # type: ignore[no-untyped-def]
    """Sum.

    Parameters
    ----------
    a, b : three floats each
    """
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel(inline=True)
def _subtract(a, b):  # type: ignore[no-untyped-def]
    """Difference.

    Parameters
    ----------
    a, b : three floats each
    """
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel(inline=True)
def _unit(a):  # type: ignore[no-untyped-def]
    """Scale a vector to length 1; one of zeros stays.

    Parameters
    ----------
    a : ndarray of shape (3,)
    """
    length = np.sqrt(_dot(a, a))
    for axis in range(3):
        a[axis] = a[axis] / length if length != 0.0 else 0.0


@kernel(inline=True)
def descend(f: int, b1: float, b2: float, levels: int) -> tuple[int, float, float]:
    """Triangle of the smooth surface and barycentrics in it, for a place in a face of the mesh.

    Parameters
    ----------
    f : int
        Face of the mesh.
    b1, b2 : float
        Barycentric weights of its corners 1 and 2.
    levels : int
    """
    for _ in range(levels):
        b0 = 1.0 - b1 - b2
        if b0 >= 0.5:
            f, b1, b2 = 4 * f, 2.0 * b1, 2.0 * b2
        elif b1 >= 0.5:
            f, b1, b2 = 4 * f + 1, 2.0 * b1 - 1.0, 2.0 * b2
        elif b2 >= 0.5:
            f, b1, b2 = 4 * f + 2, 2.0 * b1, 2.0 * b2 - 1.0
        else:
            # Corners are the middles of 12, 20 and 01
            f, b1, b2 = 4 * f + 3, 1.0 - 2.0 * b1, 1.0 - 2.0 * b2
    return f, b1, b2
