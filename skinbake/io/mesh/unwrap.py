"""UVs for a mesh that has none; the only file that knows xatlas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.xatlas_layout import xatlas_layout
from skinbake.scene.mesh import SkinMesh


def unwrap_mesh(mesh: SkinMesh, gutter_texels: int = 4, has_uvs: bool = False) -> SkinMesh:
    """The same mesh with one non-overlapping chart layout in [0, 1]^2, made by xatlas.

    Parameters
    ----------
    mesh : SkinMesh
    gutter_texels : int
        Between charts, of a texture of 1024 texels.
    has_uvs : bool
        The mesh's own UVs are some, for which maps may have been painted; they become `map_uv`.

    Raises
    ------
    InputError
        xatlas leaves out or reorders triangles of this mesh.
    MachineError
        xatlas has died.
    """
    vertex, corner, uv = xatlas_layout(
        mesh.positions_mm.astype(np.float32), mesh.faces.astype(np.uint32), gutter_texels
    )
    if not np.array_equal(vertex[corner], mesh.faces):
        raise InputError("xatlas could not unwrap this mesh face by face; clean it of duplicate triangles, or add UVs")
    corner_uv = np.clip(uv[corner].astype(np.float64), 0.0, 1.0)
    return replace(mesh, corner_uv=corner_uv, map_uv=mesh.corner_uv if has_uvs else None)
