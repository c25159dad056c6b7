"""What a person has set in the window, for whoever writes it into a look."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float
from skinbake.preview.camera import Camera
from skinbake.preview.controls import Controls
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


def state_of(controls: Controls, written: Mapping[str, Float], view: str, camera: Camera | None) -> WindowState:
    """What is set in the window.

    Parameters
    ----------
    controls : Controls
    written : mapping of light name to ndarray of shape (3,)
        Gains that the look has by now.
    view : str
        The named view that the camera began with.
    camera : Camera or None
        Where it stands, if it was moved from there.
    """
    gains = {}
    for light, gain in zip(controls.lights, controls.gains, strict=True):
        before = written[light.name]
        r, g, b = np.divide(gain, before, out=np.ones(3), where=before > 0)
        gains[light.name] = (float(r), float(g), float(b))
    moved = {light.name: light for light in controls.lights if light.name in controls.moved}
    return WindowState(gains, moved, view, camera, controls.exposure)
