"""RawMesh: triangles as a file holds them, before units, welding and the choice of parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.numerics import Float


@dataclass(frozen=True)
class RawMesh:
    """Triangles of one file in the file's own unit and world space, v up.

    Attributes
    ----------
    positions : ndarray of shape (V, 3), float64
        May hold vertices that no triangle uses, and equal ones.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside.
    corner_uv : ndarray of shape (F, 3, 2), float64
        Zero where `has_uv` is false.
    has_uv : ndarray of shape (F,), bool
    corner_normal : ndarray of shape (F, 3, 3), float64
        Of any length; zero where the file has none.
    part : ndarray of shape (F,), int32
        Index into `names`.
    names : tuple of tuples of str
        For each part the names it goes by: of an OBJ its object, groups and material, of a glTF its node, mesh and
        material, of a USD stage its path and the names of prim, subset and material. May be empty.
    mm_per_unit : float or None
        Where the format or the file says it.
    up : "y", "z" or None
        Which axis the file says is up.
    corner_tangent : ndarray of shape (F, 3, 3), float64, or None
        Along growing u; NaN in parts that have none, None where no part has any.
    corner_rgb : ndarray of shape (F, 3, 3), float64, or None
        Linear Rec.709 of coloured vertices; NaN in parts that have none, None where no part has any.
    material : tuple of int
        For each part of a glTF its material's index, -1 for none; empty for other files.
    """

    positions: Float
    faces: NDArray[np.int32]
    corner_uv: Float
    has_uv: NDArray[np.bool_]
    corner_normal: Float
    part: NDArray[np.int32]
    names: tuple[tuple[str, ...], ...]
    mm_per_unit: float | None = None
    up: str | None = None
    corner_tangent: Float | None = None
    corner_rgb: Float | None = None
    material: tuple[int, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """What each part is called in messages."""
        return tuple(
            names[0] if names and names[0].startswith("/") else "/".join(names) or "unnamed part"
            for names in self.names
        )


def bare_mesh(positions: Float, faces: NDArray[np.integer]) -> RawMesh:
    """One part without name, UVs and normals, of positions (V, 3) and triangles (F, 3)."""
    count = len(faces)
    return RawMesh(
        positions,
        faces.astype(np.int32),
        np.zeros((count, 3, 2)),
        np.zeros(count, np.bool_),
        np.zeros((count, 3, 3)),
        np.zeros(count, np.int32),
        ((),),
    )


def refuse_missing_vertices(path: Path, index: NDArray[np.integer], count: int) -> None:
    """Refuse triangles that name vertices which a file does not hold.

    Parameters
    ----------
    path : Path
        For the message.
    index : ndarray of int
    count : int
        Vertices of the file.

    Raises
    ------
    InputError
        An index is not from 0 to `count` - 1.
    """
    if index.size and (index.min() < 0 or index.max() >= count):
        bad = int(index.min() if index.min() < 0 else index.max())
        raise InputError(f"{path}: a triangle names vertex {bad}, of {count} vertices")


def joined(meshes: Sequence[RawMesh]) -> RawMesh:
    """One RawMesh with the triangles and parts of several, in their order."""
    if len(meshes) == 1:
        return meshes[0]
    vertices = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    parts = np.cumsum([0, *(len(mesh.names) for mesh in meshes)])
    return RawMesh(
        np.concatenate([np.zeros((0, 3)), *(mesh.positions for mesh in meshes)]),
        np.concatenate(
            [np.zeros((0, 3), np.int32), *(m.faces + np.int32(o) for m, o in zip(meshes, vertices, strict=False))]
        ),
        np.concatenate([np.zeros((0, 3, 2)), *(mesh.corner_uv for mesh in meshes)]),
        np.concatenate([np.zeros(0, np.bool_), *(mesh.has_uv for mesh in meshes)]),
        np.concatenate([np.zeros((0, 3, 3)), *(mesh.corner_normal for mesh in meshes)]),
        np.concatenate([np.zeros(0, np.int32), *(m.part + np.int32(o) for m, o in zip(meshes, parts, strict=False))]),
        tuple(names for mesh in meshes for names in mesh.names),
        meshes[0].mm_per_unit if meshes else None,
        meshes[0].up if meshes else None,
        _joined_corners(meshes, "corner_tangent"),
        _joined_corners(meshes, "corner_rgb"),
        tuple(index for mesh in meshes for index in mesh.material),
    )


def _joined_corners(meshes: Sequence[RawMesh], name: str) -> Float | None:
    """What only some meshes have at their corners, NaN for the others; None where none has it."""
    found = [getattr(mesh, name) for mesh in meshes]
    if all(rows is None for rows in found):
        return None
    bare = [np.full((len(mesh.faces), 3, 3), np.nan) for mesh in meshes]
    return np.concatenate([none if rows is None else rows for rows, none in zip(found, bare, strict=True)])
