"""YAML with the file and line of each key.

The marks of PyYAML's nodes, not those of `ruamel.yaml`: libyaml parses twenty times as fast, so that a file too large
for a configuration is refused in a second; a node graph can be measured before aliases are followed; and all faults are
found at once, keys that stand twice and foreign tags included, where `ruamel.yaml` stops at the first.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from yaml.constructor import SafeConstructor

from skinbake.errors import ConfigError, InputError

Key = tuple[str | int, ...]
Place = Callable[[int], str]  # line to `file:line`
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
MOST_BYTES = 2**20
MOST_VALUES = 50_000  # keys and values, an alias for as many as it stands for
DEEPEST = 60  # mappings and lists in one another
# Text, numbers and trees of them; !!binary, !!set and the like would pass for something else further on
_PLAIN = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool", "null", "timestamp", "seq", "map")}
# YAML 1.1, which PyYAML reads, takes 0010 for 8 and 1:30 for 90; YAML 1.2, people and editors do not
_OTHERWISE = re.compile(r"[-+]?(0[0_]*[1-9]_*[0-9][0-9_]*|[0-9][0-9_]*(:[0-9]+)+(\.[0-9_]*)?)")
_MERGE, _TEXT = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:str"
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


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
        Not YAML, not a mapping, a key stands twice, or more than a configuration holds.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
            if len(data) > MOST_BYTES:
                size = max(os.fstat(file.fileno()).st_size, len(data))
                raise ConfigError([f"{path}:1: expected at most {MOST_BYTES:,} bytes of configuration, got {size:,}"])
        text = data.decode("utf-8")
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
        Not YAML, not a mapping, a key stands twice, or more than a configuration holds.
    """
    place = partial("{}:{}".format, name)
    with _explained(place):
        node = _compose(text, place)
        if node is None:
            raise ConfigError([f"{name}:1: expected a mapping, got an empty file"])
        if not isinstance(node, yaml.MappingNode):
            raise ConfigError([f"{name}:{node.start_mark.line + 1}: expected a mapping, got {_kind(node)}"])
        places: dict[Key, str] = {}
        faults = list(_walk(node, (), place, places, set()))
        if faults:
            raise ConfigError(faults)
        return Located(_tree(SafeConstructor().construct_document(node)), places)


def parse_value(text: str, name: str) -> Any:
    """One YAML value, as given to `--set`; `name` stands for file and line in messages.

    Raises
    ------
    ConfigError
        Not YAML, a comment, a key stands twice, or more than a configuration holds.
    """

    def place(line: int) -> str:
        return name

    with _explained(place):
        if _has_comment(text):
            raise ConfigError([f"{name}: expected a value, got a comment: quote what begins with #, as '\"{text}\"'"])
        node = _compose(text, place)
        if node is None:
            return None
        faults = list(_walk(node, (), place, {}, set()))
        if faults:
            raise ConfigError(faults)
        return _tree(SafeConstructor().construct_document(node))


def _tree(value: Any) -> Any:
    """The value without parts that stand in it twice, as aliases do: what is set in one of them stays there."""
    if isinstance(value, dict):
        return {key: _tree(inner) for key, inner in value.items()}
    return [_tree(inner) for inner in value] if isinstance(value, list) else value


def _has_comment(text: str) -> bool:
    """Whether a part of a value is a comment to YAML, which would drop it without a word."""
    rest = list(text)
    for token in yaml.scan(text):
        for at in range(token.start_mark.index, token.end_mark.index):
            rest[at] = " "
    return "#" in rest


@contextmanager
def _explained(place: Place) -> Iterator[None]:
    """Faults that the library finds, with the line where they are."""
    try:
        yield
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0] if str(error) else "nested too deep"
        raise ConfigError([f"{place(mark.line + 1 if mark else 1)}: expected YAML, got: {problem}"]) from error


def _compose(text: str, place: Place) -> yaml.Node | None:
    """Root of the node graph of a document, None where there is none.

    Raises
    ------
    ConfigError
        More keys and values, or deeper ones, than a configuration holds.
    """
    # Counted before anything is built from them
    values = depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        values += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if values > MOST_VALUES or depth > DEEPEST:
            what = f"{MOST_VALUES:,} keys and values" if values > MOST_VALUES else f"{DEEPEST} levels"
            line = event.start_mark.line + 1 if event.start_mark else 1
            raise ConfigError([f"{place(line)}: expected at most {what}, got more"])
    node: yaml.Node | None = yaml.compose(text, Loader=_Loader)
    if node is not None:
        values, depth = _size(node, {})
        for limit, got, what in ((MOST_VALUES, values, "keys and values"), (DEEPEST, depth, "levels")):
            if got > limit:
                raise ConfigError([f"{place(1)}: expected at most {limit:,} {what}, got {got:,}, aliases written out"])
    return node


def _size(node: yaml.Node, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Number of keys and values of a node and all below it, and of levels, aliases written out.

    An anchor that contains itself counts as one there. `known` holds the sizes so far by identity.
    """
    if id(node) not in known:
        known[id(node)] = 1, 0
        children = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            children = [child for pair in children for child in pair]
        sizes = [_size(child, known) for child in children]
        deepest = max((depth for _, depth in sizes), default=0)
        known[id(node)] = 1 + sum(values for values, _ in sizes), deepest + isinstance(node, yaml.CollectionNode)
    return known[id(node)]


def _walk(node: yaml.Node, at: Key, place: Place, places: dict[Key, str], parents: set[int]) -> Iterator[str]:
    """Faults of a node and all below it; `places` gets the place of every key."""
    if id(node) in parents:
        yield f"{place(node.start_mark.line + 1)}: expected a tree, got an anchor that contains itself"
        return
    if node.tag not in _PLAIN:
        key = f"{dotted(at)}: " if at else ""
        yield f"{place(node.start_mark.line + 1)}: {key}expected plain YAML, got the tag {node.tag}"
        return
    parents = parents | {id(node)}
    places[at] = place(node.start_mark.line + 1)
    if node.tag in _NUMBERS and _OTHERWISE.fullmatch(node.value):
        key = f"{dotted(at)}: " if at else ""
        read = SafeConstructor().construct_object(node)
        yield (
            f"{place(node.start_mark.line + 1)}: {key}expected a plain number, got {node.value}, which YAML takes for"
            f" {read}; write it without leading zeros and colons, or in quotes where it is text"
        )
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for i, (key_node, value_node) in enumerate(node.value):
            here = place(key_node.start_mark.line + 1)
            if key_node.tag == _MERGE:
                yield from _walk(value_node, at, place, {}, parents)
                if _MERGE in seen:
                    yield f"{here}: {dotted((*at, key_node.value))}: key stands twice"
                seen.add(_MERGE)
                continue
            if not isinstance(key_node, yaml.ScalarNode):
                yield f"{here}: expected a plain key, got {_kind(key_node)}"
                continue
            # As it is written: a key `on`, 0010 or 1024 is a name
            node.value[i] = (yaml.ScalarNode(_TEXT, key_node.value, key_node.start_mark), value_node)
            if key_node.value in seen:
                yield f"{here}: {dotted((*at, key_node.value))}: key stands twice"
            seen.add(key_node.value)
            yield from _walk(value_node, (*at, key_node.value), place, places, parents)
            places[*at, key_node.value] = here
        node.value = _with_merged(node.value)
    elif isinstance(node, yaml.SequenceNode):
        for i, child in enumerate(node.value):
            yield from _walk(child, (*at, i), place, places, parents)


def _with_merged(pairs: list[tuple[yaml.Node, yaml.Node]]) -> list[tuple[yaml.Node, yaml.Node]]:
    """Keys and values of a mapping with those that it merges, of which the first goes before later ones.

    PyYAML 6.0.4 lets the last of a list win where a key is longer than a letter. What can be no merge it refuses.
    """
    found = [(key, value) for key, value in pairs if key.tag != _MERGE]
    names = {key.value for key, _ in found if isinstance(key, yaml.ScalarNode)}
    for key, value in pairs:
        if key.tag == _MERGE:
            sources = value.value if isinstance(value, yaml.SequenceNode) else [value]
            if not all(isinstance(source, yaml.MappingNode) for source in sources):
                return pairs
            for name, inner in (pair for source in sources for pair in source.value):
                if isinstance(name, yaml.ScalarNode) and name.value not in names:  # others are faults already
                    names.add(name.value)
                    found.append((name, inner))
    return found


def _kind(node: yaml.Node) -> str:
    """Kind of a node, in words."""
    return type(node).__name__.removesuffix("Node").lower()


def dotted(key: Key) -> str:
    """`('lights', 0, 'name')` as `lights[0].name`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text
