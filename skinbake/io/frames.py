"""One frame of a look that is a sequence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError
from skinbake.io.look_paths import is_path
from skinbake.io.yaml_lines import Key, Located, dotted
from skinbake.scene.frames import frame_numbers

_TIME = re.compile(r"(mesh|occluders\[\d+\])\.time")
_FRAME = re.compile(r"#{2,}|%0\d+d|%d")


def frame_name(number: int) -> str:
    """Name of a frame's folder."""
    return f"{number:04d}"


def given_frames(located: Located) -> tuple[int, ...] | None:
    """Frames that a look gives, or None.

    Raises
    ------
    ConfigError
        What it gives is no frames.
    """
    given = located.value.get("frames")
    if given is None:
        return None
    try:
        return frame_numbers(given)
    except ValueError as error:
        got = "" if "got" in str(error) else f", got {given!r}"
        raise ConfigError([located.say(("frames",), f"{error}{got}")]) from error


def at_frame(located: Located, number: int) -> Located:
    """The look of one frame: the number in its paths, a folder of its own.

    Raises
    ------
    ConfigError
        No path of it has a mark for the number.
    """
    changed = False

    def visit(value: Any, key: Key) -> Any:
        """The value with the number in every input's path below it."""
        nonlocal changed
        if isinstance(value, dict):
            return {k: visit(v, (*key, k)) for k, v in value.items()}
        if isinstance(value, list):
            return [visit(v, (*key, i)) for i, v in enumerate(value)]
        if isinstance(value, str) and _TIME.fullmatch(dotted(key)) and _FRAME.fullmatch(value):
            changed = True
            return number
        if not is_path(value, key) or key[0] == "output":
            return value
        named = _FRAME.sub(lambda mark: str(number).zfill(_digits(mark[0])), value)
        changed = changed or named != value
        return named

    found = {key: visit(value, (key,)) for key, value in located.value.items() if key != "frames"}
    if not changed:
        raise ConfigError([located.say(("frames",), "expected #### or %04d in a path, or as mesh.time, got none")])
    output = found.get("output")
    if isinstance(output, dict) and isinstance(output.get("dir"), str):
        found["output"] = output | {"dir": str(Path(output["dir"], frame_name(number)))}
    return Located(found, located.places)


def _digits(mark: str) -> int:
    """Least digits of a mark: as many as it has signs, or as it says."""
    return len(mark) if mark[0] == "#" else int(mark[1:-1] or 1)
