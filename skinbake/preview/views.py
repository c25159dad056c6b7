"""Views to render, and their tone mapping to 8 bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.preview.camera import Camera, camera_of, turntable, view
from skinbake.preview.draw import PreviewImage
from skinbake.preview.tonemap import tonemap
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.output import PreviewSpec


@dataclass(frozen=True)
class View:
    """Camera with a name for its file."""

    name: str
    camera: Camera


def plan_views(
    mesh: SkinMesh, look: PreviewSpec, views: Sequence[str], frames: int | None, aspect: float
) -> list[View]:
    """Views to render: one a name, or `frames` of them once around the head from each.

    Parameters
    ----------
    mesh : SkinMesh
    look : PreviewSpec
    views : sequence of str
        Names, as `camera.VIEWS`; without any, the look's own camera or view.
    frames : int, optional
    aspect : float
        Width / height of the frame.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if not frames:
        named = [View(name, view(mesh, name, aspect)) for name in views]
        return named or [View("camera" if look.camera else look.view, camera_of(mesh, look, aspect))]
    views = views or [look.view]
    prefix = "{}_" if len(views) > 1 else ""
    return [
        View(f"{prefix.format(name)}{k:04d}", camera)
        for name in views
        for k, camera in enumerate(turntable(mesh, name, aspect, frames))
    ]


def side_by_side(frames: Sequence[PreviewImage]) -> PreviewImage:
    """One frame of several of the same height, from left to right."""
    return PreviewImage(np.concatenate([frame.rgba for frame in frames], axis=1))


def tone_map(image: PreviewImage, background_rgb: tuple[float, float, float], exposure: float) -> NDArray[np.uint8]:
    """Picture before a background as 8-bit sRGB, (H, W, 3). Exposure changes the skin, not the background.

    Parameters
    ----------
    image : PreviewImage
    background_rgb : tuple of 3 floats
        Linear.
    exposure : float
        Stops.

    Raises
    ------
    ValueError
        If a value is not finite.
    """
    return tonemap(image.over(tuple(np.asarray(background_rgb) / 2.0**exposure)), exposure)
