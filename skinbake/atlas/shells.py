"""Closed shells of a mesh that face inwards although nothing is about them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.connected import connected
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

HOLLOW = 0.02  # of the volume of a ball of the mesh's area: a flatter mesh has no inside
LEAST_SHARE = 1e-3  # of the mesh's area, that a shell has for it to be looked at
PLACES = 9  # of a shell, at which it is asked what is about it


def ball_volume(area: Any) -> Any:
    """Volume of the ball of an area."""
    return area**1.5 / (6 * np.sqrt(np.pi))


def shells_inside_out(mesh: SkinMesh) -> NDArray[np.bool_]:
    """Faces of closed shells with a negative volume, (F,), but for those inside other skin: these are its cavities."""
    faces = mesh.faces.astype(np.int64)
    count = len(mesh.positions_mm)
    found = np.zeros(len(faces), np.bool_)
    shell = connected(faces[:, :2].ravel(), faces[:, 1:].ravel(), count)[faces[:, 0]]
    area = np.bincount(shell, mesh.face_area_mm2)
    corner = mesh.corner_position_mm
    middle = np.stack([np.bincount(shell, corner[:, 0, axis]) for axis in range(3)], axis=1)
    p = corner - (middle / np.bincount(shell).clip(1)[:, None])[shell][:, None]
    volume = np.bincount(shell, np.einsum("ij,ij->i", np.cross(p[:, 0], p[:, 1]), p[:, 2]) / 6)
    inwards = np.flatnonzero((volume < -HOLLOW * ball_volume(area)) & (area > LEAST_SHARE * area.sum()))
    for number in inwards:
        of_shell = shell == number
        ends = np.sort(
            np.stack([faces[of_shell], np.roll(faces[of_shell], -1, axis=1)], axis=-1).reshape(-1, 2), axis=1
        )
        _, uses = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0, return_counts=True)
        if (uses == 1).any():
            continue
        places = corner[of_shell][:: max(of_shell.sum() // PLACES, 1), 0]
        about = [_winding(corner[~of_shell] - place) for place in places]
        found |= of_shell & (np.quantile(about, 0.25) < 0.5)  # a quarter of it is seen from outside
    return found


def _winding(p: Float) -> float:
    """How often triangles (F, 3, 3) go about the origin: 1 inside a closed mesh, 0 outside [VanOosterom1983]."""
    length = np.linalg.norm(p, axis=2)
    a, b, c = p[:, 0], p[:, 1], p[:, 2]
    solid = np.einsum("ij,ij->i", a, np.cross(b, c))
    beside = length.prod(axis=1)
    for (one, other), left in (((a, b), 2), ((b, c), 0), ((c, a), 1)):
        beside += np.einsum("ij,ij->i", one, other) * length[:, left]
    return float(np.arctan2(solid, beside).sum() / (2 * np.pi))
