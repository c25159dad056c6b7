"""A mesh file as a SkinMesh in millimetres with v up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.mesh.opacity import with_opacity
from skinbake.io.mesh.parts import choose_parts
from skinbake.io.mesh.placement import placed, turned_axes
from skinbake.io.mesh.raw_file import LARGEST, read_raw
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.io.mesh.size import refuse_wrong_size
from skinbake.io.mesh.unwrap import unwrap_mesh
from skinbake.io.waiting import Waiting, unseen
from skinbake.numerics import Float, normalized
from skinbake.scene.casters import OPAQUE, Casters
from skinbake.scene.mesh import SkinMesh, smooth_vertex_normals


def read_mesh(
    path: Path | str,
    mm_per_unit: float | None,
    flip_v: bool = False,
    unwrap: str = "none",
    any_size: bool = False,
    without_uvs: bool = False,
    uv_set: int | None = None,
    time: float | None = None,
    up: str | None = None,
    front: str = "z",
    skin: Sequence[str] = (),
    cast: Sequence[str] = (),
    ignore: Sequence[str] = (),
    opacity: Mapping[str, str] | None = None,
    waiting: Waiting = unseen,
) -> SkinMesh:
    """Read a mesh: polygons cut into triangles, positions welded, UVs and normals kept per corner.

    Parameters
    ----------
    path : path of an OBJ, GLB, glTF, PLY, STL, OFF or USD file
    mm_per_unit : float or None
        None: what the file says.
    flip_v : bool
        Replaces v by 1 - v after the format's own convention (glTF has v down, all else v up).
    unwrap : "none" or "xatlas"
        "xatlas" makes UVs; those of the file become `map_uv`.
    any_size : bool
        Skips the scale gate.
    without_uvs : bool
        Accepts a mesh that has no UVs and gives it zeros.
    uv_set : int, optional
        Which of a glTF's UV sets; by default the one that its material's base colour uses.
    time : float, optional
        Time code of a USD stage.
    up, front : str
        See `placed`.
    skin, cast, ignore : sequences of str
        See `choose_parts`.
    opacity : mapping of str to str, optional
        See `with_opacity`.
    waiting : Waiting
        Told while UVs are made.

    Raises
    ------
    InputError
        The file is missing, is not a mesh, has no triangles, NaN vertices or no UVs, has no part of a given name, or
        is not as large as a head.
    """
    path = Path(path)
    raw = read_raw(path, uv_set, time)
    own_mm_per_unit, turn = raw.mm_per_unit, turned_axes(raw, up, front)
    raw = placed(path, raw, mm_per_unit, up, front)
    roles = choose_parts(path, raw, skin, cast, ignore, uvs_needed=unwrap == "none" and not without_uvs)
    mesh = skin_of(raw, roles.skin)
    if not any_size:
        refuse_wrong_size(path, mesh.positions_mm, raw.mm_per_unit or 1.0, own_mm_per_unit)
    bad = np.flatnonzero(~np.isfinite(mesh.corner_uv).all(axis=(1, 2)))
    if len(bad):
        raise InputError(f"{path}: expected finite UVs, got NaN or Inf in {len(bad)} triangles, the first is {bad[0]}")
    has_uvs = bool(raw.has_uv[roles.skin].all())
    casters = casters_of(raw, roles.cast, flip_v) if roles.cast.any() or opacity else None
    if casters is not None and opacity:
        casters = with_opacity(path, raw, roles.cast, casters, opacity, uv_set, "mesh.opacity")
    corner_uv = _flipped(mesh.corner_uv) if flip_v and has_uvs else mesh.corner_uv
    mesh = replace(mesh, corner_uv=corner_uv, casters=casters, turn=turn, notes=roles.notes)
    return unwrap_mesh(mesh, has_uvs=has_uvs, waiting=waiting) if unwrap == "xatlas" else mesh


def skin_of(raw: RawMesh, skin: NDArray[np.bool_]) -> SkinMesh:
    """Triangles of a mesh, already in millimetres, as skin: welded, with unit normals."""
    everything = bool(skin.all())

    def chosen(rows: NDArray) -> NDArray:
        """The rows of the skin's triangles."""
        return rows if everything else rows[skin]

    positions, faces = _weld(raw.positions, chosen(raw.faces))
    # What is no direction is left out, and made from the triangles
    normal = chosen(raw.corner_normal)
    usable = np.isfinite(normal) & (np.abs(normal) < LARGEST)
    normal = normalized(np.where(usable, normal, 0.0)) + 0.0
    missing = ~normal.any(axis=2)
    if missing.any():
        normal[missing] = smooth_vertex_normals(positions, faces)[faces[missing]]
    return SkinMesh(
        positions,
        faces,
        chosen(raw.corner_uv),
        normal,
        chosen(raw.part),
        raw.labels,
        corner_tangent=None if raw.corner_tangent is None else chosen(raw.corner_tangent),
        corner_rgb=None if raw.corner_rgb is None else chosen(raw.corner_rgb),
        part_material=raw.material,
    )


def casters_of(raw: RawMesh, cast: NDArray[np.bool_], flip_v: bool = False) -> Casters:
    """Triangles of a mesh, already in millimetres, that only cast shadows; opaque.

    Parameters
    ----------
    raw : RawMesh
    cast : ndarray of shape (F,), bool
    flip_v : bool
    """
    used, corner = np.unique(raw.faces[cast], return_inverse=True)
    uv = np.nan_to_num(raw.corner_uv[cast], posinf=0.0, neginf=0.0)
    return Casters(
        raw.positions[used],
        corner.reshape(-1, 3).astype(np.int32),
        _flipped(uv) if flip_v else uv,
        np.full(np.count_nonzero(cast), OPAQUE, np.int32),
    )


def _flipped(corner_uv: Float) -> Float:
    return np.stack([corner_uv[..., 0], 1 - corner_uv[..., 1]], axis=-1)


def _weld(positions: Float, faces: NDArray[np.int32]) -> tuple[Float, NDArray[np.int32]]:
    """One vertex for each position that a triangle uses, in the order of first use; adding 0.0 makes -0 equal 0."""
    positions = positions + 0.0
    # By pairs of numbers, x and y, then those and z: rows sort ten times slower
    _, column = np.unique(positions[:, 0] + 1j * positions[:, 1], return_inverse=True)
    _, place = np.unique(column + 1j * positions[:, 2], return_inverse=True)
    corner = place[faces.ravel()]
    first = np.full(int(place.max()) + 1, len(corner))
    first[corner[::-1]] = np.arange(len(corner))[::-1]  # the last of equal indices is kept: the first use
    order = np.argsort(first, kind="stable")[: np.count_nonzero(first < len(corner))]
    rank = np.empty(len(first), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return positions[faces.ravel()[first[order]]], rank[corner].reshape(faces.shape)
