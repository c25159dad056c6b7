"""Which pictures to take, and their development into 8 bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.preview.camera import Camera, turntable, view
from skinbake.preview.draw import PreviewImage
from skinbake.preview.tonemap import tonemap
from skinbake.scene.mesh import SkinMesh


@dataclass(frozen=True)
class View:
    """A camera with a name for its file."""

    name: str
    camera: Camera


def plan_views(mesh: SkinMesh, views: Sequence[str], frames: int | None, aspect: float) -> list[View]:
    """One shot a view, or `frames` of them once around the head from each view."""
    if not frames:
        return [View(name, view(mesh, name, aspect)) for name in views]
    prefix = "{}_" if len(views) > 1 else ""
    return [
        View(f"{prefix.format(name)}{k:04d}", camera)
        for name in views
        for k, camera in enumerate(turntable(mesh, name, aspect, frames))
    ]


def side_by_side(frames: Sequence[PreviewImage]) -> PreviewImage:
    """Frames of one height from left to right."""
    return PreviewImage(np.concatenate([frame.rgba for frame in frames], axis=1))


def tone_map(image: PreviewImage, background_rgb: tuple[float, float, float], exposure: float) -> NDArray[np.uint8]:
    """8-bit sRGB before a background; exposure moves the skin, not the background."""
    return tonemap(image.over(tuple(np.asarray(background_rgb) / 2.0**exposure)), exposure)
