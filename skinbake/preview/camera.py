"""Cameras of the preview: named views as a portrait photographer would choose them, and a turntable."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.output import FARTHEST_MM, PreviewSpec

PORTRAIT_YFOV_DEG = float(np.degrees(2 * np.arctan(18 / 85)))  # 85 mm lens on 36 mm tall film
HEAD_DIAGONAL_MM = 350.0
MARGIN = 1.08  # about the head, as a share of its size

# Azimuth towards the head's own left, elevation, in degrees; +z is where the face looks, +y up
ANGLES = {
    "front": (0.0, 0.0),
    "left": (90.0, 0.0),
    "right": (-90.0, 0.0),
    "three-quarter": (32.0, 4.0),
    "three-quarter-right": (-32.0, 4.0),
    "back": (180.0, 0.0),
}
# Landmark, its offset and the height of the frame in mm of an adult head, azimuth, elevation
CLOSE_UPS: dict[str, tuple[str, tuple[float, float, float], float, float, float]] = {
    "nose": ("nose", (0.0, 10.0, -12.0), 72.0, 24.0, 2.0),
    "lips": ("nose", (0.0, -36.0, -14.0), 80.0, 14.0, 0.0),
    "eyes": ("nose", (0.0, 38.0, -24.0), 105.0, 10.0, 2.0),
    "ear": ("ear", (0.0, 0.0, 12.0), 92.0, 78.0, 2.0),
}
VIEWS = (*ANGLES, *CLOSE_UPS)  # `scene.output.View`


@dataclass(frozen=True)
class Camera:
    """A camera on an orbit about `target_mm`; y is up.

    Attributes
    ----------
    target_mm : ndarray of shape (3,)
    distance_mm, azimuth_deg, elevation_deg : float
        Azimuth 0 looks at the face, 90 at the head's left side.
    yfov_deg : float
        Vertical field of view.
    """

    target_mm: Float
    distance_mm: float
    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0
    yfov_deg: float = PORTRAIT_YFOV_DEG

    @property
    def backward(self) -> Float:
        """Unit vector from the target to the camera."""
        a, e = np.radians([self.azimuth_deg, self.elevation_deg])
        return np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])

    @property
    def position_mm(self) -> Float:
        """Position of the camera, mm, shape (3,)."""
        return self.target_mm + self.distance_mm * self.backward

    @property
    def pose(self) -> Float:
        """Camera to world, shape (4, 4), looking along -z."""
        back = self.backward
        right = normalized(np.cross([0.0, 1.0, 0.0], back))
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        pose[:3, 3] = self.position_mm
        return pose

    def turned(self, azimuth_deg: float, elevation_deg: float = 0.0) -> Camera:
        """Camera moved along its orbit; it stops 1 degree before the poles."""
        elevation = float(np.clip(self.elevation_deg + elevation_deg, -89, 89))
        return replace(self, azimuth_deg=(self.azimuth_deg + azimuth_deg) % 360, elevation_deg=elevation)

    def zoomed(self, factor: float) -> Camera:
        """Camera with its distance multiplied by `factor`."""
        return replace(self, distance_mm=float(np.clip(self.distance_mm * factor, 1.0, FARTHEST_MM)))

    def panned(self, right: float, up: float) -> Camera:
        """Camera with its target moved by shares of the frame's height."""
        height = 2 * self.distance_mm * np.tan(np.radians(self.yfov_deg) / 2)
        axes = self.pose[:3, :3]
        return replace(self, target_mm=self.target_mm + height * (right * axes[:, 0] + up * axes[:, 1]))


def same_place(one: Camera, other: Camera) -> bool:
    """Whether two cameras stand at one place and look the same way."""
    angles = (one.distance_mm, one.azimuth_deg, one.elevation_deg)
    same = angles == (other.distance_mm, other.azimuth_deg, other.elevation_deg)
    return same and np.array_equal(one.target_mm, other.target_mm)


def camera_of(mesh: SkinMesh, look: PreviewSpec, aspect: float) -> Camera:
    """The camera of a look: its own, else its view's.

    Parameters
    ----------
    mesh : SkinMesh
    look : PreviewSpec
    aspect : float
        Width / height of the frame.
    """
    own = look.camera
    if own is None:
        return view(mesh, look.view, aspect)
    return Camera(np.array(own.target_mm, np.float64), own.distance_mm, own.azimuth_deg, own.elevation_deg)


def refuse_unknown_views(names: Iterable[str]) -> None:
    """Stop at a view that there is not.

    Raises
    ------
    InputError
    """
    for name in names:
        if name not in VIEWS:
            raise InputError(f"--views: expected {', '.join(VIEWS)}, got {name}")


def view(mesh: SkinMesh, name: str, aspect: float) -> Camera:
    """Camera of a named view of a mesh.

    Parameters
    ----------
    mesh : SkinMesh
    name : one of VIEWS
        Whole-head views fit every vertex of head and neck (of anything, where the mesh has not the size of a head or a
        bust); close-ups stand before a landmark: the foremost point for nose, lips and
        eyes, the outermost one on the head's left for the ear.
    aspect : float
        Width / height of the frame.

    Raises
    ------
    InputError
        For an unknown name.
    """
    refuse_unknown_views([name])
    positions = mesh.positions_mm[np.unique(mesh.faces)]
    low, high = positions.min(0), positions.max(0)
    if name in ANGLES:
        return _fitted(_head(positions), Camera((low + high) / 2, 1.0, *ANGLES[name]), aspect)

    landmark, offset, frame_mm, azimuth, elevation = CLOSE_UPS[name]
    diagonal = float(np.linalg.norm(high - low))
    scale = 1.0 if 150 < diagonal < 800 else max(diagonal, 1e-6) / HEAD_DIAGONAL_MM
    if landmark == "nose":
        point = positions[positions[:, 2].argmax()]
    else:
        # Shoulders may stand out further than ears: look in the upper half only
        upper = positions[positions[:, 1] > (low[1] + high[1]) / 2]
        point = upper[upper[:, 0].argmax()]
    target = point + scale * np.array(offset)
    distance = scale * frame_mm / min(aspect, 1.0) / 2 / np.tan(np.radians(PORTRAIT_YFOV_DEG) / 2)
    return Camera(target, distance, azimuth, elevation)


def turntable(mesh: SkinMesh, name: str, aspect: float, frames: int) -> list[Camera]:
    """Cameras once around the head from a named view, all at the least distance from which every frame fits.

    Parameters
    ----------
    mesh : SkinMesh
    name : one of VIEWS
    aspect : float
        Width / height of the frame.
    frames : int

    Raises
    ------
    InputError
        For an unknown name.
    """
    camera = view(mesh, name, aspect)
    if name in ANGLES:
        positions = _head(mesh.positions_mm[np.unique(mesh.faces)])
        camera = replace(camera, target_mm=(positions.min(0) + positions.max(0)) / 2)
        away = [_distance(positions, camera.turned(360 * k / frames), aspect) for k in range(frames)]
        camera = replace(camera, distance_mm=max(away))
    return [camera.turned(360 * k / frames) for k in range(frames)]


def _head(positions: Float) -> Float:
    """Positions (n, 3) of head and neck of a bust: shoulders would make the face small."""
    low, high = positions.min(0), positions.max(0)
    if not 150 < np.linalg.norm(high - low) < 1200:
        return positions
    skull = positions[positions[:, 1] > high[1] - 120]
    away = np.linalg.norm(positions[:, ::2] - (skull.min(0) + skull.max(0))[::2] / 2, axis=1)
    return positions[(positions[:, 1] > high[1] - 290) & (away < 135)]


def _fitted(positions: Float, camera: Camera, aspect: float) -> Camera:
    """Camera centred on what is seen, at the least distance from which every point is in the frame."""
    axes = camera.pose[:3, :3]
    seen = (positions - camera.target_mm) @ axes  # right, up, towards the camera
    centre = (seen.min(0) + seen.max(0)) / 2
    camera = replace(camera, target_mm=camera.target_mm + axes[:, :2] @ centre[:2])
    return replace(camera, distance_mm=_distance(positions, camera, aspect))


def _distance(positions: Float, camera: Camera, aspect: float) -> float:
    """Least distance from which every point is in the frame, the target staying in its middle, mm."""
    seen = (positions - camera.target_mm) @ camera.pose[:3, :3]
    slope = np.tan(np.radians(camera.yfov_deg) / 2) / MARGIN
    reach = np.maximum(np.abs(seen[:, 1]), np.abs(seen[:, 0]) / aspect) / slope
    size = float(np.ptp(positions, axis=0).max())
    return max(float((reach + seen[:, 2]).max()), size * 1e-3, 1e-3)
