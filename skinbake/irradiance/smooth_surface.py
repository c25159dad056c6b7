"""Smooth surface that a mesh's vertex normals imply, as finer triangles.

Shading normals pretend that a coarse mesh is smooth; shadows of its flat triangles give it away, as blocks along the
terminator and polygons in place of curved shadow edges. Rays therefore meet this surface, and start on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh

FLAT_ENOUGH_MM = 0.02  # height of the bulges that may remain: a tenth of a texel of a 2048^2 head
MAX_FACES = 600_000
MAX_SLOPE = (
    0.1  # height of an edge's arc over its length; a steeper one is a crease with poor normals, not a round form
)


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

    at_a, at_b = surface.corner_normal, np.roll(surface.corner_normal, -1, axis=1)
    swap = (a > b)[..., None]
    ends = np.where(swap, at_b, at_a).reshape(-1, 3), np.where(swap, at_a, at_b).reshape(-1, 3)
    hard = np.zeros(len(first), dtype=np.bool_)
    for normal in ends:
        differs = np.abs(normal - normal[first][edge]).max(axis=1) > 1e-3
        hard[edge[differs]] = True

    chord = (surface.positions_mm[high] - surface.positions_mm[low]).reshape(-1, 3)[first]
    offset = np.zeros_like(chord)
    for normal, sign in zip(ends, (1.0, -1.0), strict=True):
        n = normal[first]
        offset -= 0.25 * n * (sign * 0.5 * (chord * n).sum(axis=1, keepdims=True))
    # Poor normals must not fold the surface
    length, height = np.linalg.norm(chord, axis=1), np.linalg.norm(offset, axis=1)
    scale = np.minimum(1.0, MAX_SLOPE * length / np.maximum(height, 1e-300))
    scale[hard] = 0.0
    return edge.reshape(-1, 3), offset * scale[:, None]


def _subdivide(surface: SmoothSurface, edge: NDArray[np.int64], offset: Float) -> SmoothSurface:
    """The surface with each triangle cut into four: one at each corner, then the middle one."""
    middle = np.empty_like(offset)
    a, b = surface.faces, np.roll(surface.faces, -1, axis=1)
    middle[edge] = 0.5 * (surface.positions_mm[a] + surface.positions_mm[b])
    positions = np.concatenate([surface.positions_mm, middle + offset])
    c, m = surface.faces, (edge + len(surface.positions_mm)).astype(np.int32)
    n = surface.corner_normal
    # Normals at the middles stand on the edge's Hermite curve, so that the next level follows the same surface
    to_next = np.roll(n, -1, axis=1)
    chord = surface.positions_mm[b] - surface.positions_mm[a]
    ends = 2 * chord - n * (chord * n).sum(-1, keepdims=True) - to_next * (chord * to_next).sum(-1, keepdims=True)
    tangent = normalized(1.5 * chord - 0.25 * ends)
    k = n + to_next
    k = normalized(k - tangent * (k * tangent).sum(-1, keepdims=True))
    children = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (4, 5, 3)]  # 0..2 corners, 3..5 middles of edges 01, 12, 20
    index, normal = np.concatenate([c, m], axis=1), np.concatenate([n, k], axis=1)
    return SmoothSurface(
        surface.levels + 1,
        positions,
        np.ascontiguousarray(index[:, children].reshape(-1, 3)),
        np.ascontiguousarray(normal[:, children].reshape(-1, 3, 3)),
        surface.relief_mm,
    )


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
