"""UVs for a mesh that has none."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.digests import array_digest, key_of
from skinbake.io.mesh.xatlas_layout import SMALL_FACES, Layout, xatlas_layout
from skinbake.io.user_cache import user_cache
from skinbake.io.waiting import Waiting, unseen
from skinbake.scene.mesh import SkinMesh

GUTTER_TEXELS = 4  # between charts, of a texture of 1024 texels
FACE_SECONDS = 2e-4  # of xatlas for a triangle of a head, on one core of a 2.6 GHz server


def unwrap_mesh(mesh: SkinMesh, has_uvs: bool = False, waiting: Waiting = unseen) -> SkinMesh:
    """The same mesh with one non-overlapping chart layout in [0, 1]^2, made by xatlas.

    The layout of a large mesh is kept in the user's cache: `check`, `bake` and `preview` make it once.

    Parameters
    ----------
    mesh : SkinMesh
    has_uvs : bool
        The mesh's own UVs are some, for which maps may have been painted; they become `map_uv`.
    waiting : Waiting
        Told when it takes long.

    Raises
    ------
    InputError
        xatlas leaves out or reorders triangles of this mesh.
    MachineError
        xatlas has died.
    """
    vertex, corner, uv = _layout(mesh.positions_mm.astype(np.float32), mesh.faces.astype(np.uint32), waiting)
    if not np.array_equal(vertex[corner], mesh.faces):
        raise InputError("xatlas could not unwrap this mesh face by face; clean it of duplicate triangles, or add UVs")
    corner_uv = np.clip(uv[corner].astype(np.float64), 0.0, 1.0)
    return replace(mesh, corner_uv=corner_uv, map_uv=mesh.corner_uv if has_uvs else None)


def unwrap_seconds(faces: int) -> float:
    """About how long xatlas takes for so many triangles."""
    return faces * FACE_SECONDS


def _layout(positions: NDArray[np.float32], faces: NDArray[np.uint32], waiting: Waiting) -> Layout:
    """The layout of xatlas, made or kept."""

    def made() -> Layout:
        seconds = unwrap_seconds(len(faces))
        with waiting(f"xatlas unwraps {len(faces)} triangles", seconds) as tick:
            return xatlas_layout(positions, faces, GUTTER_TEXELS, tick)

    cache = user_cache() if len(faces) > SMALL_FACES else None
    if cache is None:
        return made()
    key = key_of("xatlas", version("xatlas"), GUTTER_TEXELS, array_digest(positions), array_digest(faces))

    def entries(names: tuple[str, ...]) -> dict[str, dict[str, NDArray[Any]]]:
        return {name: dict(zip(("vertex", "corner", "uv"), made(), strict=True)) for name in names}

    found = cache.get_many({"layout": key}, entries)["layout"]
    return found["vertex"], found["corner"], found["uv"]
