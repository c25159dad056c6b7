"""A mesh file of any kind as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.gltf import read_gltf
from skinbake.io.mesh.kept_obj import read_kept_obj
from skinbake.io.mesh.off import read_off
from skinbake.io.mesh.ply import read_ply
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.io.mesh.stl import read_stl
from skinbake.io.mesh.usd import SUFFIXES as USD_SUFFIXES
from skinbake.io.mesh.usd import read_usd
from skinbake.numerics import Float

SUFFIXES = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off", *USD_SUFFIXES)
LARGEST = 1e18  # of any coordinate: its fourth power is still a float64


def read_raw(path: Path, uv_set: int | None = None, time: float | None = None, key: str = "mesh") -> RawMesh:
    """The triangles of a file of any kind.

    Parameters
    ----------
    path : path
    uv_set : int, optional
        Of a glTF or USD file.
    time : float, optional
        Of a USD stage.
    key : str
        Of the look, for messages: where the file is named.

    Raises
    ------
    InputError
        The file is missing, is not a mesh, has no triangles, or vertices that are not finite; a time, or a set of
        UVs, is asked of one that has none.
    """
    suffix = path.suffix.lower()
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir() or suffix not in SUFFIXES:
        raise InputError(f"{path}: expected a mesh file ({', '.join(SUFFIXES)})")
    if time is not None and suffix not in USD_SUFFIXES:
        raise InputError(f"{path}: {key}.time: expected a USD file, which knows time, got {suffix}")
    if uv_set is not None and suffix not in (".glb", ".gltf", *USD_SUFFIXES):
        raise InputError(f"{path}: {key}.uv_set: expected a glTF or USD file, which may have several, got {suffix}")
    try:
        if suffix == ".obj":
            raw = read_kept_obj(path)
        elif suffix in (".glb", ".gltf"):
            raw = read_gltf(path, uv_set)
        elif suffix in USD_SUFFIXES:
            raw = read_usd(path, uv_set, time)
        else:
            raw = {".ply": read_ply, ".stl": read_stl, ".off": read_off}[suffix](path)
    except PermissionError:
        raise InputError(f"{path}: permission to read it is missing") from None
    except OSError as error:
        raise InputError(f"{path}: expected a file that can be read, got: {error.strerror or error}") from None
    if not len(raw.faces):
        raise InputError(f"{path}: expected triangles, got none")
    if uv_set is not None and not raw.has_uv.any():
        raise InputError(
            f"{path}: {key}.uv_set: expected UVs of a set that the file has, got {uv_set}, which no part has"
        )
    refuse_endless(path, raw.positions)
    return raw


def refuse_endless(path: Path, positions: Float) -> None:
    """Refuse vertices that no arithmetic can follow; the size gate comes later, in millimetres.

    Raises
    ------
    InputError
        A vertex is not finite, or further out than anything is.
    """
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise InputError(
            f"{path}: expected finite vertices, got {len(bad)} with NaN or Inf, the first at index {bad[0]}"
        )
    if positions.size and np.abs(positions).max() >= LARGEST:
        raise InputError(f"{path}: expected vertices below {LARGEST:g}, got {np.abs(positions).max():g}")
