"""A SkinMesh as OBJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.io.atomic import atomic_write
from skinbake.io.output_names import SOFTWARE
from skinbake.scene.mesh import SkinMesh


def write_obj(path: Path | str, mesh: SkinMesh, mm_per_unit: float = 1.0) -> None:
    """Write positions, UVs (v up) and normals as OBJ; equal UVs and normals are written once.

    Parameters
    ----------
    path : path
    mesh : SkinMesh
    mm_per_unit : float
        Millimetres of one unit in the file.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    uv, uv_of = np.unique(mesh.corner_uv.reshape(-1, 2), axis=0, return_inverse=True)
    normal, normal_of = np.unique(mesh.corner_normal.reshape(-1, 3), axis=0, return_inverse=True)
    address = 1 + np.stack([mesh.faces.ravel(), uv_of.ravel(), normal_of.ravel()], axis=1).reshape(-1, 9)
    with atomic_write(path) as beside, open(beside, "w", encoding="ascii", newline="\n") as file:
        file.write(f"# {SOFTWARE}\n")
        for tag, rows in (("v", mesh.positions_mm / mm_per_unit), ("vt", uv), ("vn", normal)):
            file.writelines(f"{tag} {' '.join(f'{x:.9g}' for x in row)}\n" for row in rows)
        file.writelines("f {}/{}/{} {}/{}/{} {}/{}/{}\n".format(*row) for row in address)
