"""What a person has set in the window, for whoever writes it into a look."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from skinbake.preview.camera import Camera
from skinbake.scene.lights import LightSpec


@dataclass(frozen=True)
class WindowState:
    """Lights, camera and exposure of the window.

    Attributes
    ----------
    gains : mapping of light name to (R, G, B)
        Factor on each light since the look was last written.
    moved : mapping of light name to LightSpec
        Lights that were carried elsewhere, where they are now.
    view : str
        The named view that the camera began with.
    camera : Camera or None
        Where it stands, if it was moved from there.
    exposure : float
        Stops.
    """

    gains: Mapping[str, tuple[float, float, float]]
    moved: Mapping[str, LightSpec]
    view: str
    camera: Camera | None
    exposure: float
