"""Paths in a look: which keys hold one, and where it leads."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError, InputError
from skinbake.io.yaml_lines import Key, Located, dotted
from skinbake.scene.mesh_files import OF_FILE

_PATH_KEYS = re.compile(
    r"mesh\.path|mesh\.opacity(\..+)?|occluders\[\d+\]\.(path|opacity)|maps\.(?!source$|vertex_colors$)\w+(\.path)?|lights\[\d+\]\.path|skin\.path|output\.dir"
)
_VARIABLE = re.compile(r"\$\{(\w+)(?::-([^}]*))?\}")


def input_paths(value: Any, key: Key = ()) -> Iterator[tuple[Key, str]]:
    """Keys and paths of the files that a checked look reads."""
    if is_path(value, key) and key[0] != "output":
        yield key, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for part, inner in items:
        yield from input_paths(inner, (*key, part))


def resolve_paths(located: Located, base: Path, only: str | None = None) -> None:
    """Make paths absolute, in place.

    Parameters
    ----------
    located : Located
    base : Path
        Folder that they are relative to.
    only : str, optional
        Change just the keys that came from this place.

    Raises
    ------
    ConfigError
        A path names an environment variable that is not set, or a home that does not exist.
    """
    faults: list[str] = []

    def visit(value: Any, key: Key) -> Any:
        """The value with every path below it absolute."""
        if isinstance(value, dict):
            return {k: visit(v, (*key, k)) for k, v in value.items()}
        if isinstance(value, list):
            return [visit(v, (*key, i)) for i, v in enumerate(value)]
        if is_path(value, key) and only in (None, located.place(key)):
            try:
                return str(absolute_path(value, base))
            except InputError as error:
                faults.append(f"{located.place(key)}: {dotted(key)}: {error}")
        return value

    located.value = visit(located.value, ())
    if faults:
        raise ConfigError(faults)


def is_path(value: Any, key: Key) -> bool:
    """Whether a value is a path, not the word for what the mesh's own file holds."""
    name = dotted(key)
    return isinstance(value, str) and bool(_PATH_KEYS.fullmatch(name)) and not (value == OF_FILE and "opacity" in name)


def absolute_path(text: str, base: Path) -> Path:
    """Absolute path of a text, relative to a folder, `${NAME}` and `~` expanded.

    Raises
    ------
    InputError
        It is empty, or names a variable that is not set or a home that does not exist.
    """
    if "\0" in text:
        raise InputError("expected a path, got text with a NUL character")
    if not text:
        raise InputError("expected a path, got an empty text")

    def variable(match: re.Match[str]) -> str:
        """Value of an environment variable, or its default."""
        value = os.environ.get(match[1]) or match[2]
        if value is None:
            raise InputError(f"expected the environment variable {match[1]}, which is not set")
        return value

    try:
        text = _VARIABLE.sub(variable, text)
        if not text:
            raise InputError("expected a path, got variables that are empty")
        return Path(os.path.normpath(base / Path(text).expanduser()))
    except RuntimeError as error:  # ~somebody, who has no home here
        raise InputError(f"expected a path, got {text!r}: {error}") from error
