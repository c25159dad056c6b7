"""STL and OFF; the only file that knows trimesh."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.raw_mesh import RawMesh, joined, refuse_missing_vertices


def read_with_trimesh(path: Path) -> RawMesh:
    """Read a mesh that holds neither UVs nor parts.

    Raises
    ------
    InputError
        trimesh cannot read it.
    """
    import trimesh  # half a second: only where it is needed

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # its lines are not for our terminal
    try:
        with warnings.catch_warnings():  # numpy's, about arithmetic inside trimesh; what it reads is checked later
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(path, process=False)
            found = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh)]
            meshes = [(np.asarray(m.vertices, np.float64), np.asarray(m.faces, np.int64)) for m in found]
    except Exception as error:  # trimesh raises whatever its parsers meet
        first_line = (str(error).splitlines() or [""])[0][:200]
        raise InputError(f"{path}: not a mesh that can be read ({type(error).__name__}: {first_line})") from None
    parts = []
    for positions, faces in meshes:
        if positions.ndim != 2 or positions.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(f"{path}: expected triangles, got shapes {positions.shape} and {faces.shape}")
        refuse_missing_vertices(path, faces, len(positions))
        count = len(faces)
        parts.append(
            RawMesh(
                positions,
                faces.astype(np.int32),
                np.zeros((count, 3, 2)),
                np.zeros(count, np.bool_),
                np.zeros((count, 3, 3)),
                np.zeros(count, np.int32),
                ((),),
            )
        )
    return joined(parts)
