"""YAML with the file and line of each key."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from skinbake.errors import ConfigError, InputError

Key = tuple[str | int, ...]
# Text, numbers and trees of them; !!binary, !!set and the like would pass for something else further on
_PLAIN = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool", "null", "timestamp", "seq", "map")}


@dataclass
class Located:
    """Parsed YAML and, for each key path, the file and line it came from."""

    value: Any
    places: dict[Key, str] = field(default_factory=dict)

    def place(self, key: Key) -> str:
        """`file:line` of a key, or of the nearest parent that stands in the file."""
        while key and key not in self.places:
            key = key[:-1]
        return self.places.get(key, "?")

    def say(self, key: Key, sentence: str) -> str:
        """A message about a key: `file:line: key: sentence`."""
        return f"{self.place(key)}: {dotted(key)}: {sentence}" if key else f"{self.place(key)}: {sentence}"


def read_yaml(path: Path | str) -> Located:
    """Read a YAML mapping.

    Raises
    ------
    InputError
        No such file, or it cannot be read.
    ConfigError
        Not YAML, not a mapping, or a key stands twice.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: expected a configuration file, got: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, got bytes that are not: {error.reason}") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, name: str) -> Located:
    """Parse a YAML mapping; `name` stands for the file in messages.

    Raises
    ------
    ConfigError
        Not YAML, not a mapping, or a key stands twice.
    """
    loader = None
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if node is None:
            raise ConfigError([f"{name}:1: expected a mapping, got an empty file"])
        if not isinstance(node, yaml.MappingNode):
            raise ConfigError([f"{name}:{node.start_mark.line + 1}: expected a mapping, got {_kind(node)}"])
        places: dict[Key, str] = {}
        faults = list(_walk(node, (), name, places, set()))
        if faults:
            raise ConfigError(faults)
        return Located(loader.construct_document(node), places)
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0] if str(error) else "nested too deep"
        raise ConfigError([f"{name}:{mark.line + 1 if mark else 1}: expected YAML, got: {problem}"]) from error
    finally:
        if loader is not None:
            loader.dispose()


def _walk(node: yaml.Node, at: Key, name: str, places: dict[Key, str], parents: set[int]) -> Iterator[str]:
    """Faults of a node and all below it; `places` gets the place of every key."""
    if id(node) in parents:
        yield f"{name}:{node.start_mark.line + 1}: expected a tree, got an anchor that contains itself"
        return
    if node.tag not in _PLAIN:
        yield f"{name}:{node.start_mark.line + 1}: {dotted(at)}: expected plain YAML, got the tag {node.tag}"
        return
    parents = parents | {id(node)}
    places[at] = f"{name}:{node.start_mark.line + 1}"
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key_node, value_node in node.value:
            place = f"{name}:{key_node.start_mark.line + 1}"
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            if not isinstance(key_node, yaml.ScalarNode):
                yield f"{place}: expected a plain key, got {_kind(key_node)}"
                continue
            if key_node.value in seen:
                yield f"{place}: {dotted((*at, key_node.value))}: key stands twice"
            seen.add(key_node.value)
            yield from _walk(value_node, (*at, key_node.value), name, places, parents)
            places[*at, key_node.value] = place
    elif isinstance(node, yaml.SequenceNode):
        for i, child in enumerate(node.value):
            yield from _walk(child, (*at, i), name, places, parents)


def _kind(node: yaml.Node) -> str:
    """Kind of a node, in words."""
    return type(node).__name__.removesuffix("Node").lower()


def dotted(key: Key) -> str:
    """`('lights', 0, 'name')` as `lights[0].name`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def parse_value(text: str) -> Any:
    """One YAML value, as given to `--set`."""
    return yaml.safe_load(text)
