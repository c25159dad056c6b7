"""`--set dotted.key=value`, put into a look."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError
from skinbake.io.look_paths import resolve_paths
from skinbake.io.yaml_lines import Located, dotted, parse_value

_ONE_KNOB = {"tolerance": ("diffusion", "tolerance"), "diffusion.tolerance": ("tolerance",)}  # names of one value


def apply_overrides(located: Located, overrides: Iterable[str]) -> None:
    """Apply `dotted.key=value` strings in place; lists by index (`lights.0`) or by name (`lights.key`).

    Raises
    ------
    ConfigError
        One is not of that form, its value is no YAML, or its key leads nowhere.
    """
    for text in overrides:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise ConfigError([f"--set {text}: expected dotted.key=value"])
        name, place = name.strip(), f"--set {name.strip()}"
        put(located, name, given := parse_value(value, place), place)
        if name in _ONE_KNOB and given is not None:
            _drop(located.value, _ONE_KNOB[name])
        resolve_paths(located, Path.cwd(), only=place)


def _drop(mapping: Any, key: tuple[str, ...]) -> None:
    """Take away a key, whose value has been said by its other name since."""
    if isinstance(mapping, dict) and key[0] in mapping:
        if len(key) > 1:
            _drop(mapping[key[0]], key[1:])
        else:
            del mapping[key[0]]


def put(located: Located, name: str, value: Any, place: str) -> None:
    """Set a dotted key in place, lists by index or by name.

    Parameters
    ----------
    located : Located
    name : str
        The dotted key.
    value : object
    place : str
        Where the value came from, for messages.

    Raises
    ------
    ConfigError
        There is no such item, or a part of the key is empty.
    """
    parts = [part for part in re.split(r"[.\[\]]+", name) if part]
    if not parts or not all(part.strip() for part in name.split(".")):
        raise ConfigError([f"{place}: expected a key such as texture.size, got {name!r}"])
    target, key = located.value, tuple[str | int, ...]()
    for i, part in enumerate(parts):
        index: str | int = part
        if isinstance(target, list):
            names = [item.get("name") if isinstance(item, dict) else None for item in target]
            if part.isdigit() and int(part) < len(target):
                index = int(part)
            elif part in names:
                index = names.index(part)
            else:
                known = ", ".join(str(n) for n in names if n)
                raise ConfigError(
                    [
                        f"{place}: {dotted((*key, part))}: no such item; "
                        f"expected 0 to {len(target) - 1} or one of {known}"
                    ]
                )
        elif not isinstance(target, dict):
            raise ConfigError([f"{place}: {dotted(key)} is {target!r}, which has no key {part}"])
        key = (*key, index)
        if i == len(parts) - 1:
            target[index] = value
            for stale in [k for k in located.places if k[: len(key)] == key]:
                del located.places[stale]
            located.places[key] = place
        else:
            if isinstance(target, dict) and not isinstance(target.get(index), dict | list):
                kept = target.get(index)
                shorthand = "source" if key == ("maps",) else "path"
                target[index] = {shorthand: kept} if isinstance(kept, str) else {}
                located.places.setdefault(key, place)
            target = target[index]
