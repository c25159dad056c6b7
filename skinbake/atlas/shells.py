"""Closed shells of a mesh that face inwards although nothing is about them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.connected import connected
from skinbake.kernels.compile import kernel
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
        about = [_winding(corner, of_shell, place) for place in places]
        found |= of_shell & (np.quantile(about, 0.25) < 0.5)  # a quarter of it is seen from outside
    return found


@kernel
def _winding(corner: Float, of_shell: NDArray[np.bool_], place: Float) -> float:
    """How often triangles go about a place: 1 inside a closed mesh, 0 outside [VanOosterom1983].

    Parameters
    ----------
    corner : ndarray of shape (F, 3, 3)
    of_shell : ndarray of shape (F,)
        Triangles that are left out.
    place : ndarray of shape (3,)
    """
    angle = 0.0
    for f in range(len(corner)):
        if of_shell[f]:
            continue
        ax, ay, az = corner[f, 0, 0] - place[0], corner[f, 0, 1] - place[1], corner[f, 0, 2] - place[2]
        bx, by, bz = corner[f, 1, 0] - place[0], corner[f, 1, 1] - place[1], corner[f, 1, 2] - place[2]
        cx, cy, cz = corner[f, 2, 0] - place[0], corner[f, 2, 1] - place[1], corner[f, 2, 2] - place[2]
        a, b, c = np.sqrt(ax**2 + ay**2 + az**2), np.sqrt(bx**2 + by**2 + bz**2), np.sqrt(cx**2 + cy**2 + cz**2)
        solid = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
        angle += np.arctan2(solid, a * b * c + ab * c + bc * a + ca * b)
    return angle / (2 * np.pi)
