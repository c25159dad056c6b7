"""Effects of the window's keys, without the window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skinbake.numerics import Float
from skinbake.preview.mode import Mode
from skinbake.preview.relit_controls import NOT_RELIT, RELIT_HELP, RelitControls
from skinbake.preview.scene import PreviewScene
from skinbake.scene.lights import DirectionalLight, LightSpec, RectangleLight, SpotLight

GAIN_STEP = 2**0.25
EXPOSURE_STEP = 0.25
TURN_DEG = 5.0
HELP = (  # key, what it does; a tab between columns
    "drag\torbit\tshift+drag\tpan\twheel\tzoom",
    "F\teverything\tD\tdiffuse only\tS\tspecular only",
    "N\tno scattering\t1 ... 9\tone lobe\tV\tnext view",
    "TAB\tnext light\tUP, DOWN\tits gain\tL\tit alone",
    ", .\tmove it\t[ ]\texposure\tR\treset",
    "K\tnext skin\tP\tsave the picture\tW\twrite gains and view into the look",
    "H\tthis help\tQ\tquit",
)


@dataclass(frozen=True)
class Controls:
    """State that keys can change; the camera is apart.

    Attributes
    ----------
    lights : tuple of LightSpec
        As they stand now.
    gains : tuple of ndarray of shape (3,)
        Factor on each light.
    mode : Mode
    exposure : float
        Stops.
    selected : int
        The light that keys act on.
    solo, help : bool
        Whether the selected light is shown alone, and the help is shown.
    moved : frozenset of str
        Lights that are no longer where their diffuse part was baked.
    """

    lights: tuple[LightSpec, ...]
    gains: tuple[Float, ...]
    mode: Mode = Mode()  # noqa: RUF009  (frozen)
    exposure: float = 0.0
    selected: int = 0
    solo: bool = False
    help: bool = False
    moved: frozenset[str] = frozenset()

    @property
    def gains_rgb(self) -> Float:
        """Factor on each light as it is shown, shape (L, 3)."""
        gains = np.array(self.gains, dtype=np.float64)
        if self.solo:
            gains[np.arange(len(gains)) != self.selected] = 0
        return gains


def press(controls: Controls, start: Controls, scene: PreviewScene, key: str) -> Controls:
    """Controls after a key; a key without a meaning changes nothing.

    Parameters
    ----------
    controls : Controls
    start : Controls
        What R goes back to.
    scene : PreviewScene
    key : str
    """
    if scene.basis is not None and key in NOT_RELIT:
        return controls
    modes = {"F": Mode("full"), "D": Mode("diffuse"), "S": Mode("specular"), "N": Mode("none")}
    if key in modes:
        return replace(controls, mode=modes[key])
    if len(key) == 1 and key in "123456789":
        lobe = int(key) - 1
        return replace(controls, mode=Mode("lobe", lobe)) if lobe < len(scene.lobes) else controls
    if key in ("[", "]"):
        return replace(controls, exposure=controls.exposure + (EXPOSURE_STEP if key == "]" else -EXPOSURE_STEP))
    if key == "TAB":
        return replace(controls, selected=(controls.selected + 1) % len(controls.lights))
    if key == "H":
        return replace(controls, help=not controls.help)
    if key == "R":
        return replace(start, help=controls.help)
    if key in (",", "."):
        return _turned(controls, start, scene, -TURN_DEG if key == "," else TURN_DEG)
    if scene.separate and key == "L":
        return replace(controls, solo=not controls.solo)
    if scene.separate and key in ("UP", "DOWN"):
        gains = list(controls.gains)
        gains[controls.selected] = gains[controls.selected] * (GAIN_STEP if key == "UP" else 1 / GAIN_STEP)
        return replace(controls, gains=tuple(gains))
    return controls


def _turned(controls: Controls, start: Controls, scene: PreviewScene, degrees: float) -> Controls:
    """Controls with the selected light carried about the head's upright axis."""
    index = controls.selected
    low, high = scene.mesh.positions_mm.min(0), scene.mesh.positions_mm.max(0)
    light = turned_light(controls.lights[index], degrees, (low + high) / 2)
    lights = (*controls.lights[:index], light, *controls.lights[index + 1 :])
    same = _place(light).shape == _place(start.lights[index]).shape and np.allclose(
        _place(light), _place(start.lights[index]), atol=1e-6
    )
    moved = controls.moved - {light.name} if same else controls.moved | {light.name}
    return replace(controls, lights=lights, moved=moved)


def turned_light(light: LightSpec, degrees: float, about_mm: Float) -> LightSpec:
    """Light carried about the upright axis through a point. An environment stays: a bake does not hold its picture.

    Parameters
    ----------
    light : LightSpec
    degrees : float
    about_mm : ndarray of shape (3,)
    """
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])

    def vector(name: str) -> tuple[float, ...]:
        """A vector of the light, turned."""
        return tuple(float(x) for x in turn @ np.array(getattr(light, name), float))

    if light.everywhere:
        return light
    if isinstance(light, DirectionalLight):
        return light.model_copy(update={"direction": vector("direction")})
    at = about_mm + turn @ (_place(light) - about_mm)
    update = {"position_mm": tuple(float(x) for x in at)}
    if isinstance(light, SpotLight):
        update["axis"] = vector("axis")
    if isinstance(light, RectangleLight):
        update |= {"edge_u_mm": vector("edge_u_mm"), "edge_v_mm": vector("edge_v_mm")}
    return light.model_copy(update=update)


def _place(light: LightSpec) -> Float:
    """Direction or position of a light, by which it is told whether it was moved, shape (3,)."""
    if light.everywhere:
        return np.zeros(3)
    at = light.direction if isinstance(light, DirectionalLight) else light.position_mm  # type: ignore[union-attr]
    return np.array(at, dtype=np.float64)


def overlay(
    controls: Controls,
    scene: PreviewScene,
    frames_per_second: float,
    relit: RelitControls | None = None,
    view: str = "",
) -> list[str]:
    """Lines of text over the picture: what is shown from where, how fast, the lights, and the help if asked for.

    Parameters
    ----------
    controls : Controls
    scene : PreviewScene
    frames_per_second : float
    relit : RelitControls, optional
        Light that comes later, in place of the bake's.
    view : str
        Name of the view.
    """
    names = {
        "full": "everything",
        "diffuse": "diffuse only",
        "specular": "specular only",
        "none": "no scattering",
    }
    mode = controls.mode
    if mode.name == "lobe":
        variance = scene.lobes[mode.lobe].variance_mm2
        width = "light through thin parts" if variance is None else f"sigma {np.sqrt(variance):.2f} mm"
        shown = f"lobe {mode.lobe + 1} of {len(scene.lobes)}, {width}"
    else:
        shown = names[mode.name]
    place = f"{view}   " if view else ""
    lines = [f"{place}{shown}   exposure {controls.exposure:+.2f}   {frames_per_second:.0f} fps   H: help"]
    lines += _light_lines(controls, scene) if relit is None else [relit.line]
    keys = HELP if relit is None else RELIT_HELP
    return [*lines, *keys] if controls.help else lines


def _light_lines(controls: Controls, scene: PreviewScene) -> Sequence[str]:
    """A line for each light: its gain, and whether it was moved."""
    lines = []
    for i, light in enumerate(controls.lights):
        mark = ">" if i == controls.selected else " "
        gain = controls.gains_rgb[i]
        level = f"{gain[0]:.2f}" if np.ptp(gain) == 0 else "/".join(f"{g:.2f}" for g in gain)
        off = "  off" if controls.solo and i != controls.selected else ""
        stale = "  MOVED: its diffuse part is stale, bake again" if light.name in controls.moved else ""
        lines.append(f"{mark} {light.name}  x {level}{off}{stale}")
    if not scene.separate:
        lines.append("lights were summed in this bake: gains need output.lights: separate")
    return lines
