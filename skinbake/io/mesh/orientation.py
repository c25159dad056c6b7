"""Where the crown and the face of a head seem to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

POINTS = 20000  # of the skin
EACH = 5  # of them, one in so many is compared with what lies about it
SYMMETRIC = 0.03  # of the head's size: mean distance of a point's mirror image from the skin, at most
CLEARER = 1.15  # by which one answer must be better than the next
AXES = "xyz"


@dataclass(frozen=True)
class Orientation:
    """Guesses; None where the mesh gives no clear sign.

    Attributes
    ----------
    lateral : "x", "y", "z" or None
        Axis from ear to ear.
    crown, face : such as "+y" or None
        Directions in which the crown and the face lie.
    """

    lateral: str | None
    crown: str | None
    face: str | None

    @property
    def advice(self) -> str | None:
        """What to set where the head does not stand with its face along z; None where it does, or nobody knows."""
        if self.crown is not None and self.crown != "+y":
            turn = (
                "set mesh.up: z" if self.crown == "+z" else "turn it so that its crown is along y, or z and mesh.up: z"
            )
            return f"the head seems to lie down, its crown along {self.crown}: {turn}"
        if self.lateral == "y":
            return "the head seems to lie on its side, its ears along y: turn it upright"
        if self.face is not None and self.face != "+z" and self.face[1] != "y":
            return f"the face seems to look along {self.face}: set mesh.front: {self.face.lstrip('+')}"
        return None


def guess_orientation(mesh: SkinMesh) -> Orientation:
    """Guess how a head lies in its coordinates.

    Ears lie along the axis about which the skin is its own mirror image. Of the other two the head is taller than deep.
    The neck is where the widest opening is, the face where normals vary most.
    """
    from scipy.spatial import cKDTree

    points, normal = _scattered(mesh)
    extent = np.ptp(mesh.positions_mm, axis=0)
    tree = cKDTree(points)
    middle = points.mean(axis=0)
    unlike = np.array([_asymmetry(tree, points, middle, axis) for axis in range(3)]) / max(float(extent.max()), 1e-300)
    order = np.argsort(unlike)
    if unlike[order[0]] > SYMMETRIC or unlike[order[1]] < CLEARER * unlike[order[0]]:
        return Orientation(None, None, None)
    lateral = int(order[0])
    tall, deep = sorted((axis for axis in range(3) if axis != lateral), key=lambda axis: -extent[axis])
    if extent[tall] < 1.1 * extent[deep]:
        return Orientation(AXES[lateral], None, None)
    rim = _rim_middle(mesh)
    crown = None
    if rim is not None:
        lean = (middle - rim)[[tall, deep]] / extent[[tall, deep]]
        # The opening of a mask is behind, not below
        if abs(lean[0]) > 0.25:
            crown = _signed(tall, lean[0])
    else:
        crown = f"+{AXES[tall]}"
    side = points[:, deep] > middle[deep]
    rough = [_roughness(points[part], normal[part]) for part in (side, ~side)]
    face = None
    if max(rough) > CLEARER * min(rough):
        face = _signed(deep, rough[0] - rough[1])
    if crown is None and rim is not None and face is not None:
        crown = f"+{AXES[tall]}"
    return Orientation(AXES[lateral], crown, face)


def _signed(axis: int, value: float) -> str:
    return ("+" if value > 0 else "-") + AXES[axis]


def _scattered(mesh: SkinMesh) -> tuple[Float, Float]:
    """Points spread evenly over the skin, and their normals."""
    total = np.cumsum(mesh.face_area_mm2)
    step = (np.arange(POINTS) + 0.5) / POINTS
    face = np.searchsorted(total, step * total[-1]).clip(max=len(total) - 1)
    golden = (1 + 5**0.5) / 2
    root, along = np.sqrt(np.arange(POINTS) / golden % 1), np.arange(POINTS) / golden**2 % 1
    weight = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    points = np.einsum("nk,nki->ni", weight, mesh.corner_position_mm[face])
    return points, normalized(np.einsum("nk,nki->ni", weight, mesh.corner_normal[face]))


def _asymmetry(tree: cKDTree, points: Float, middle: Float, axis: int) -> float:
    """Mean distance of the points' mirror images from the nearest point, mm."""
    mirrored = points[::EACH].copy()
    mirrored[:, axis] = 2 * middle[axis] - mirrored[:, axis]
    return float(tree.query(mirrored)[0].mean())


def _rim_middle(mesh: SkinMesh) -> Float | None:
    """Middle of all open edges by length, or None for a closed mesh."""
    a, b = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
    count = len(mesh.positions_mm)
    key, uses = np.unique((np.minimum(a, b) * count + np.maximum(a, b))[a != b], return_counts=True)
    rim = key[uses == 1]
    if not len(rim):
        return None
    ends = mesh.positions_mm[np.stack([rim // count, rim % count], axis=1)]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.average(ends.mean(axis=1), axis=0, weights=np.maximum(length, 1e-300))


def _roughness(points: Float, normal: Float) -> float:
    """Mean angle, as a chord, between the normals of neighbouring points: large about eyes, nose and mouth."""
    from scipy.spatial import cKDTree

    points, normal = points[::EACH], normal[::EACH]
    if len(points) < 5:
        return 0.0
    _, near = cKDTree(points).query(points, k=5)
    return float(np.linalg.norm(normal[near[:, 1:]] - normal[:, None], axis=2).mean())
