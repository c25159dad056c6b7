"""SkinMesh: the triangles everything else is computed on."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float, normalized
from skinbake.scene.casters import Casters

T = TypeVar("T")


@dataclass(frozen=True)
class SkinMesh:
    """Triangles with welded positions and per-corner UVs and normals.

    Attributes
    ----------
    positions_mm : ndarray of shape (V, 3), float64
        Welded: both sides of a UV seam share their vertices.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside.
    corner_uv : ndarray of shape (F, 3, 2), float64
        u to the right, v up, (0, 0) the lower left corner of the texture (of tile 1001).
    corner_normal : ndarray of shape (F, 3, 3), float64
        Unit shading normals.
    part : ndarray of shape (F,), int32
        Index into `part_names`.
    part_names : tuple of str
        What each part of the file is called in messages.
    map_uv : ndarray of shape (F, 3, 2), optional
        The file's own UVs, for which maps were painted, where `corner_uv` was made anew.
    corner_tangent : ndarray of shape (F, 3, 3), optional
        Tangents that the file brings, along growing u of `map_uv`, or of `corner_uv` where there is no other; zero or
        not a number where it brings none.
    corner_rgb : ndarray of shape (F, 3, 3), optional
        Linear Rec.709 of coloured vertices; NaN where a triangle has none.
    part_material : tuple of int
        For each part of a glTF its material's index, -1 for none; empty for other files.
    casters : Casters, optional
        What rays meet besides the skin.
    turn : ndarray of shape (3, 3), optional
        Rotation from the file's axes to these, for vectors as columns.
    notes : tuple of str
        What was decided while reading that a person should know.
    """

    positions_mm: Float
    faces: NDArray[np.int32]
    corner_uv: Float
    corner_normal: Float
    part: NDArray[np.int32] | None = None
    part_names: tuple[str, ...] = ()
    map_uv: Float | None = None
    corner_tangent: Float | None = None
    corner_rgb: Float | None = None
    part_material: tuple[int, ...] = ()
    casters: Casters | None = None
    turn: Float | None = None
    notes: tuple[str, ...] = ()
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        n = len(self.faces)
        for name, got, want in (
            ("positions_mm", self.positions_mm.shape[1:], (3,)),
            ("faces", self.faces.shape, (n, 3)),
            ("corner_uv", self.corner_uv.shape, (n, 3, 2)),
            ("corner_normal", self.corner_normal.shape, (n, 3, 3)),
        ):
            if got != want:
                raise ValueError(f"SkinMesh.{name}: expected shape {want}, got {got}")

    def derived(self, make: Callable[[SkinMesh], T]) -> T:
        """What a function makes of this mesh: for what stages ask again that is not known to `scene`.

        Made once, also where several threads ask at the same time: all but the first one wait.
        """
        mine: Future[T] = Future()
        first: Future[T] = self._derived.setdefault(make, mine)
        if first is mine:
            try:
                mine.set_result(make(self))
            except BaseException as fault:
                del self._derived[make]
                mine.set_exception(fault)
        return first.result()

    @cached_property
    def corner_position_mm(self) -> Float:
        """Positions per corner, shape (F, 3, 3)."""
        return self.positions_mm[self.faces]

    @cached_property
    def face_normal(self) -> Float:
        """Unit geometric normals, shape (F, 3); zero for a degenerate face."""
        a, b, c = np.moveaxis(self.corner_position_mm, 1, 0)
        return normalized(np.cross(b - a, c - a))

    @cached_property
    def face_area_mm2(self) -> Float:
        """Area of each face, mm^2, shape (F,)."""
        a, b, c = np.moveaxis(self.corner_position_mm, 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def smooth_vertex_normals(positions_mm: Float, faces: NDArray[np.int32]) -> Float:
    """Unit vertex normals, shape (V, 3): the faces' normals weighted by their angles at the vertex [Thuermer1998]."""
    corners = positions_mm[faces]
    normal = normalized(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    summed = np.zeros_like(positions_mm)
    for k in range(3):
        to_next = normalized(corners[:, (k + 1) % 3] - corners[:, k])
        to_last = normalized(corners[:, (k + 2) % 3] - corners[:, k])
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", to_next, to_last), -1, 1))
        np.add.at(summed, faces[:, k], normal * angle[:, None])
    return normalized(summed)
