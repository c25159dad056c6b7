"""Whether a mesh has an inside."""

from __future__ import annotations

import numpy as np

from skinbake.errors import InputError
from skinbake.scene.mesh import SkinMesh


def refuse_open(mesh: SkinMesh, name: str = "mesh") -> None:
    """Stop where a mesh does not enclose a volume: light would leave it where no skin is.

    Parameters
    ----------
    mesh : SkinMesh
    name : str
        What messages begin with.

    Raises
    ------
    InputError
        Edges without a face on their other side (how many, and where the first is), or faces that look inwards.
    """
    a, b = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
    a, b = a[a != b], b[a != b]
    low, high = np.minimum(a, b), np.maximum(a, b)
    edge, index = np.unique(low * len(mesh.positions_mm) + high, return_inverse=True)
    # Closed: each edge is walked as often one way as the other
    balance = np.bincount(index, np.where(a < b, 1, -1), len(edge))
    open_edges = np.flatnonzero(balance)
    if len(open_edges):
        x, y, z = mesh.positions_mm[edge[open_edges[0]] // len(mesh.positions_mm)]
        raise InputError(
            f"{name}: expected a closed mesh, which light can be followed through, got {len(open_edges)} edges with a "
            f"face on one side only, the first at ({x:.4g}, {y:.4g}, {z:.4g}) mm"
        )
    corner = mesh.corner_position_mm - mesh.positions_mm.mean(axis=0)
    volume = float(np.einsum("fi,fi->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6
    if volume <= 0:
        raise InputError(f"{name}: expected faces that look outwards, the mesh is inside out ({volume:.4g} mm^3)")
