"""What keys and the mouse do to light that comes later, without the window."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from skinbake.irradiance.environment_map import Image
from skinbake.preview.relit import LaterLight

TURN_DEG = 5.0
NOT_RELIT = frozenset(("N", "TAB", "L", "UP", "DOWN", ",", ".", *"123456789"))  # keys on a bake's own lights and lobes
RELIT_HELP = (  # as `skinbake.preview.controls.HELP`
    "drag\torbit\tshift+drag\tpan\twheel\tzoom",
    "F\teverything\tD\tdiffuse only\tS\tspecular only",
    "ctrl+drag\tturn the light\t, .\tturn it\tK\tnext sky",
    "V\tnext view\t[ ]\texposure\tR\treset",
    "P\tsave the picture\tH\tthis help\tQ\tquit",
)


@dataclass(frozen=True)
class RelitControls:
    """Light that comes later as it is shown.

    Attributes
    ----------
    light : LaterLight
    sky : str
        Name of its sky; empty where it has none.
    skies : mapping of str to callable
        What gives the radiance of each sky that K goes through.
    """

    light: LaterLight
    sky: str
    skies: Mapping[str, Callable[[], Image]]

    @property
    def line(self) -> str:
        """What is shown, for the text over the picture."""
        parts = [f"sky {self.sky}"] if self.sky else []
        count = len(self.light.suns)
        parts += [f"{count} sun{'s' if count > 1 else ''}"] if count else []
        return f"{' and '.join(parts) or 'no light'}, turned {self.light.rotate_deg % 360:.0f} degrees"

    def dragged(self, degrees: float, higher_deg: float) -> RelitControls:
        """The light turned, its suns raised."""
        return replace(self, light=self.light.turned(degrees, higher_deg))


def press_relit(controls: RelitControls, start: RelitControls, key: str) -> RelitControls:
    """Controls after a key; a key without a meaning changes nothing.

    Parameters
    ----------
    controls : RelitControls
    start : RelitControls
        What R goes back to.
    key : str
    """
    if key in (",", "."):
        return controls.dragged(-TURN_DEG if key == "," else TURN_DEG, 0.0)
    if key == "R":
        return start
    if key == "K" and controls.skies:
        names = list(controls.skies)
        name = names[(names.index(controls.sky) + 1) % len(names)] if controls.sky in names else names[0]
        old = controls.light
        light = LaterLight(controls.skies[name](), old.suns, old.rotate_deg, old.raise_deg)
        return replace(controls, light=light, sky=name)
    return controls
