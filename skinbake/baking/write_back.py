"""Writes what a person has set in the window into the look: gains, moved lights, camera, exposure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from skinbake.baking.verdict import as_typed
from skinbake.errors import InputError
from skinbake.io.config import load_look
from skinbake.io.yaml_edit import edit_yaml_file
from skinbake.io.yaml_lines import Key
from skinbake.preview.window_state import WindowState
from skinbake.scene.lights import LightSpec
from skinbake.scene.spec import SceneSpec

BRIGHTNESS = ("irradiance", "intensity", "radiance")  # of a light, whichever it has
PLACE = ("direction", "position_mm", "axis", "edge_u_mm", "edge_v_mm")
DIGITS = 4


def write_back(config: Path | str, state: WindowState) -> str:
    """Change the look's file so that it says what the window shows; what was written, in words.

    Comments and everything else in the file stay as they are.

    Parameters
    ----------
    config : path
    state : WindowState

    Raises
    ------
    InputError, ConfigError
        The file has changed so that it has no such light, cannot be read or written, or says a value by an alias.
    """
    path = Path(config)
    look = load_look(path, files=False, first_frame=True)
    changes = _of_lights(path, look, state) | _of_preview(look, state)
    if not changes:
        return f"{as_typed(path.absolute())} says so already"
    edit_yaml_file(path, changes)
    load_look(path, files=False, first_frame=True)
    return f"written to {as_typed(path.absolute())}: {', '.join(_words(key, look) for key in changes)}"


def _of_lights(path: Path, look: SceneSpec, state: WindowState) -> dict[Key, Any]:
    """Changes of lights by their place in the file."""
    changes: dict[Key, Any] = {}
    place = {light.name: index for index, light in enumerate(look.lights)}
    wanted = {name: gain for name, gain in state.gains.items() if not np.allclose(gain, 1, atol=1e-6)}
    if missing := sorted({*wanted, *state.moved} - set(place)):
        raise InputError(f"{path}: lights: expected {', '.join(missing)}, found none of that name")
    for name, gain in wanted.items():
        light = look.lights[place[name]]
        for key, value in _brighter(path, light, gain).items():
            changes["lights", place[name], key] = value
    for name, moved in state.moved.items():
        for key in PLACE:
            if hasattr(moved, key) and getattr(moved, key) != getattr(look.lights[place[name]], key, None):
                changes["lights", place[name], key] = [_short(x) for x in getattr(moved, key)]
    return changes


def _brighter(path: Path, light: LightSpec, gain: tuple[float, float, float]) -> dict[str, Any]:
    """The key that says how bright a light is, and its value times a gain."""
    for key in BRIGHTNESS:
        now = getattr(light, key, None)
        if now is not None:
            return {key: [_short(x * g) for x, g in zip(now, gain, strict=True)]}
    if max(gain) - min(gain) > 1e-6 * max(gain):
        raise InputError(f"{path}: light {light.name}: its picture has one scale for all colours; gains are coloured")
    return {"scale": _short(getattr(light, "scale", 1.0) * gain[0])}


def _of_preview(look: SceneSpec, state: WindowState) -> dict[Key, Any]:
    """Changes of camera and exposure."""
    changes: dict[str, Any] = {}
    if state.view != look.preview.view:
        changes["view"] = state.view
    if state.camera is not None:
        camera = state.camera
        new = {
            "target_mm": [_short(x) for x in camera.target_mm],
            "distance_mm": _short(camera.distance_mm),
            "azimuth_deg": _short(camera.azimuth_deg),
            "elevation_deg": _short(camera.elevation_deg),
        }
        before = look.preview.camera
        if before is None or new != before.model_dump() | {"target_mm": list(before.target_mm)}:
            changes["camera"] = new
    elif look.preview.camera is not None:
        changes["camera"] = None
    if abs(state.exposure - look.preview.exposure) > 1e-6:
        changes["exposure"] = _short(state.exposure)
    if not changes:
        return {}
    if "preview" not in look.model_fields_set:
        return {("preview",): changes}
    return {("preview", key): value for key, value in changes.items()}


def _short(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")


def _words(key: Key, look: SceneSpec) -> str:
    """A key as a person would name it."""
    if key[0] == "lights":
        return f"{look.lights[int(key[1])].name}.{key[2]}"
    return ".".join(map(str, key))
