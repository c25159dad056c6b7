"""What the options of `skinbake preview` say in text, and the light that they ask for."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from skinbake.errors import InputError

if TYPE_CHECKING:
    from skinbake.irradiance.environment_map import Image
    from skinbake.preview.relit import LaterLight
    from skinbake.preview.relit_controls import RelitControls


def later_light(environment: str | None, rotate_deg: float, suns: tuple[str, ...]) -> LaterLight:
    """Light of --environment, --rotate and --sun.

    Parameters
    ----------
    environment : str, optional
        File of a sky, or the name of one of ours.
    rotate_deg : float
    suns : tuple of str

    Raises
    ------
    InputError
        No such sky, or a sun that is none.
    """
    from skinbake.io.environment import read_sky
    from skinbake.preview.relit import LaterLight

    if environment == "":
        raise InputError("--environment: expected a file, studio or sunset, got an empty text")
    sky = None if environment is None else read_sky(environment)
    return LaterLight(sky, tuple(map(parse_sun, suns)), rotate_deg)


def relit_controls(later: LaterLight | None, environment: str | None) -> RelitControls | None:
    """What the window does with light of the command line; K goes through its sky and ours.

    Parameters
    ----------
    later : LaterLight, optional
    environment : str, optional
    """
    from skinbake.preview.relit_controls import RelitControls
    from skinbake.relight.skies import made_sky, sky_names

    if later is None:
        return None
    skies: dict[str, Callable[[], Image]] = {name: partial(made_sky, name) for name in sky_names()}
    given, sky = Path(environment or "").stem, later.sky
    if sky is not None and given not in skies:
        skies = {given: lambda: sky} | skies
    return RelitControls(later, given, skies)


def parse_sun(text: str) -> tuple[list[float], list[float]]:
    """Direction of the light and irradiance R, G, B of "x,y,z=r/g/b" or "x,y,z=e".

    Raises
    ------
    InputError
        Anything else.
    """
    way, equals, colour = text.partition("=")
    if not equals:
        raise InputError(f"--sun {text}: expected its irradiance, too, as in {text}=3/3/2.8 or {text}=3")
    try:
        direction, irradiance = [float(x) for x in way.split(",")], [float(x) for x in colour.split("/")]
    except ValueError:
        direction, irradiance = [], []
    irradiance = irradiance * 3 if len(irradiance) == 1 else irradiance
    finite = all(abs(x) <= 1e9 for x in (*direction, *irradiance))  # NaN compares false
    if len(direction) != 3 or len(irradiance) != 3 or not finite or min(irradiance) < 0:
        raise InputError(
            f"--sun {text}: expected X,Y,Z=R/G/B: where its light travels, and its irradiance, three finite numbers "
            "each, irradiance from 0 up"
        )
    if not any(direction):
        raise InputError(f"--sun {text}: expected a direction in which its light travels, got 0,0,0, which is none")
    return direction, irradiance


def parse_names(views: str | None) -> list[str]:
    """Names of "front,left"."""
    return [name.strip() for name in views.split(",") if name.strip()] if views else []


def parse_size(text: str) -> tuple[int, int]:
    """(width, height) of "800x1000" or "512".

    Raises
    ------
    InputError
        Anything else, or a side outside 1 ... 16384.
    """
    sides = text.lower().replace("×", "x").split("x")
    if len(sides) in (1, 2) and all(side.strip().isdecimal() and 1 <= int(side) <= 16384 for side in sides):
        return int(sides[0]), int(sides[-1])
    raise InputError(f"--size: expected WIDTHxHEIGHT in pixels, each 1 to 16384, got {text}")


def parse_lights(text: str | None) -> dict[str, list[float]]:
    """Gains by light of "key=1.5,rim=1/0.9/0.8".

    Raises
    ------
    InputError
        Anything else. Whether the bake has such a light is seen when it is read.
    """
    gains: dict[str, list[float]] = {}
    for item in (text or "").split(","):
        name, equals, value = item.strip().partition("=")
        if not item.strip():
            continue
        try:
            numbers = [float(number) for number in value.split("/")]
        except ValueError:
            numbers = []
        if not equals or not name or len(numbers) not in (1, 3):
            raise InputError(f"--lights: expected NAME=GAIN or NAME=R/G/B, got {item.strip()}")
        gains[name.strip()] = numbers * 3 if len(numbers) == 1 else numbers
    return gains
