"""A mesh file as a SkinMesh in millimetres with v up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.mesh.gltf import read_gltf
from skinbake.io.mesh.obj import read_obj
from skinbake.io.mesh.ply import read_ply
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.io.mesh.size import refuse_wrong_size
from skinbake.io.mesh.trimesh_file import read_with_trimesh
from skinbake.io.mesh.unwrap import unwrap_mesh
from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh, smooth_vertex_normals

SUFFIXES = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off")
LARGEST = 1e18  # of any coordinate: its fourth power is still a float64


def read_mesh(
    path: Path | str,
    mm_per_unit: float,
    flip_v: bool = False,
    unwrap: str = "none",
    any_size: bool = False,
    without_uvs: bool = False,
    uv_set: int | None = None,
) -> SkinMesh:
    """Read a mesh: polygons cut into triangles, positions welded, UVs and normals kept per corner.

    Parameters
    ----------
    path : path of an OBJ, GLB, glTF, PLY, STL or OFF file
    mm_per_unit : float
    flip_v : bool
        Replaces v by 1 - v after the format's own convention (glTF has v down, all else v up).
    unwrap : "none" or "xatlas"
        "xatlas" makes UVs when the file has none.
    any_size : bool
        Skips the scale gate.
    without_uvs : bool
        Accepts a mesh that has no UVs and gives it zeros.
    uv_set : int, optional
        Which of a glTF's UV sets; by default the one that its material's base colour uses.

    Raises
    ------
    InputError
        The file is missing, is not a mesh, has no triangles, NaN vertices or no UVs, or is not as large as a head.
    """
    path = Path(path)
    raw = _read(path, uv_set)
    if not len(raw.faces):
        raise InputError(f"{path}: expected triangles, got none")
    _check_positions(path, raw.positions)
    with np.errstate(over="ignore"):  # what overflows is infinite, and refused
        positions = raw.positions * mm_per_unit
    _check_positions(path, positions)
    positions, faces = _weld(positions, raw.faces)
    if not any_size:
        refuse_wrong_size(path, positions, mm_per_unit)

    has_uvs = bool(raw.has_uv.all())
    if not has_uvs and unwrap == "none" and not without_uvs:
        raise InputError(
            f"{path}: expected UVs, the mesh has none; add them, or set texture.unwrap: xatlas to make them"
        )
    corner_uv = raw.corner_uv
    bad = np.flatnonzero(~np.isfinite(corner_uv).all(axis=(1, 2)))
    if len(bad):
        raise InputError(f"{path}: expected finite UVs, got NaN or Inf in {len(bad)} triangles, the first is {bad[0]}")
    if flip_v and has_uvs:
        corner_uv = np.stack([corner_uv[..., 0], 1 - corner_uv[..., 1]], axis=-1)

    # What is no direction is left out, and made from the triangles
    usable = np.isfinite(raw.corner_normal) & (np.abs(raw.corner_normal) < LARGEST)
    normal = normalized(np.where(usable, raw.corner_normal, 0.0)) + 0.0
    missing = ~normal.any(axis=2)
    if missing.any():
        normal[missing] = smooth_vertex_normals(positions, faces)[faces[missing]]
    mesh = SkinMesh(positions, faces, corner_uv, normal)
    return unwrap_mesh(mesh) if unwrap == "xatlas" and not has_uvs else mesh


def _read(path: Path, uv_set: int | None) -> RawMesh:
    """The triangles of a file of any kind."""
    suffix = path.suffix.lower()
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir() or suffix not in SUFFIXES:
        raise InputError(f"{path}: expected a mesh file ({', '.join(SUFFIXES)})")
    try:
        if suffix == ".obj":
            return read_obj(path)
        if suffix in (".glb", ".gltf"):
            return read_gltf(path, uv_set)
        return read_ply(path) if suffix == ".ply" else read_with_trimesh(path)
    except PermissionError:
        raise InputError(f"{path}: permission to read it is missing") from None
    except OSError as error:
        raise InputError(f"{path}: expected a file that can be read, got: {error.strerror or error}") from None


def _check_positions(path: Path, positions: Float) -> None:
    """Refuse what no arithmetic can follow; the size gate comes later, in millimetres."""
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise InputError(
            f"{path}: expected finite vertices, got {len(bad)} with NaN or Inf, the first at index {bad[0]}"
        )
    if positions.size and np.abs(positions).max() >= LARGEST:
        raise InputError(f"{path}: expected vertices below {LARGEST:g}, got {np.abs(positions).max():g}")


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
