"""Which pictures to take, and their development into 8 bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.preview.camera import Camera, view
from skinbake.preview.draw import PreviewImage
from skinbake.preview.tonemap import tonemap
from skinbake.scene.mesh import SkinMesh


@dataclass(frozen=True)
class Shot:
    """A camera with a name for its file."""

    name: str
    camera: Camera


def plan_shots(mesh: SkinMesh, views: Sequence[str], turntable: int | None, aspect: float) -> list[Shot]:
    """One shot a view, or `turntable` of them once around the head from each view.

    A turntable keeps the distance at which the widest of its frames still fits.
    """
    shots = []
    for name in views:
        camera = view(mesh, name, aspect)
        if not turntable:
            shots.append(Shot(name, camera))
            continue
        turned = [camera.turned(360 * k / turntable) for k in range(turntable)]
        prefix = f"{name}_" if len(views) > 1 else ""
        shots += [Shot(f"{prefix}{k:04d}", frame) for k, frame in enumerate(turned)]
    return shots


def side_by_side(frames: Sequence[PreviewImage]) -> PreviewImage:
    """Frames of one height from left to right."""
    return PreviewImage(np.concatenate([frame.rgba for frame in frames], axis=1))


def develop(image: PreviewImage, background_rgb: tuple[float, float, float], exposure: float) -> NDArray[np.uint8]:
    """8-bit sRGB before a background; exposure moves the skin, not the background."""
    return tonemap(image.over(tuple(np.asarray(background_rgb) / 2.0**exposure)), exposure)
