"""Changes values of a YAML text and nothing else: comments, order and spacing stay."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from skinbake.errors import InputError
from skinbake.io.atomic import write_bytes
from skinbake.io.yaml_lines import Key, dotted

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def edit_yaml(text: str, changes: Mapping[Key, Any], name: str = "YAML") -> str:
    """The text with other values at some keys; a key that is not there is added to the mapping that would hold it.

    Parameters
    ----------
    text : str
        A mapping, that was read without a fault.
    changes : mapping of key path to value
        Numbers, text, lists and mappings of them; only the last part of a path may be missing.
    name : str
        Of the file, for messages.

    Raises
    ------
    InputError
        A path leads nowhere, or through an alias: what it would change stands elsewhere, too.
    """
    root = yaml.compose(text, Loader=_Loader)
    shared = _shared(root)
    edits = []
    for key, value in changes.items():
        edits.append(_edit(text, root, key, value, shared, name))
    for start, end, new in sorted(edits, reverse=True):  # from the end, so that places before it hold
        text = text[:start] + new + text[end:]
    return text


def edit_yaml_file(path: Path, changes: Mapping[Key, Any]) -> None:
    """Change values of a YAML file, which appears whole or not at all; as `edit_yaml`.

    Raises
    ------
    InputError
        It cannot be read or written, or as `edit_yaml`.
    """
    try:
        with open(path, encoding="utf-8", newline="") as file:  # line ends stay
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    write_bytes(path, edit_yaml(text, changes, str(path)).encode())


def _edit(text: str, root: Any, key: Key, value: Any, shared: set[int], name: str) -> tuple[int, int, str]:
    """Place and text of one change."""
    node = root
    for depth, part in enumerate(key):
        if id(node) in shared:
            raise InputError(
                f"{name}: {dotted(key[:depth])}: cannot be changed, for an alias stands there; write it out"
            )
        child = _child(node, part)
        if child is None and depth == len(key) - 1 and isinstance(node, yaml.MappingNode):
            return _insertion(text, node, str(part), value, whole=depth == 0)
        if child is None:
            raise InputError(f"{name}: {dotted(key[: depth + 1])}: expected it in the file, found none")
        node = child
    if id(node) in shared:
        raise InputError(f"{name}: {dotted(key)}: cannot be changed, for an alias stands there; write it out")
    end = node.end_mark.index
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:  # up to the next token: keep what is between
        end = node.start_mark.index + len(text[node.start_mark.index : end].rstrip())
    return node.start_mark.index, end, _flow(value)


def _child(node: Any, part: str | int) -> Any:
    """The node at a key or an index, or None."""
    if isinstance(node, yaml.SequenceNode):
        return node.value[part] if isinstance(part, int) and part < len(node.value) else None
    if isinstance(node, yaml.MappingNode):
        return next((inner for key, inner in node.value if key.value == str(part)), None)
    return None


def _insertion(text: str, node: Any, part: str, value: Any, whole: bool) -> tuple[int, int, str]:
    """Place and text of a new key of a mapping; `whole` if that is the file's."""
    new = f"{part}: {_flow(value)}"
    if node.flow_style:
        brace = node.end_mark.index - 1
        before = text[:brace].rstrip()
        comma = "" if not node.value or before.endswith(",") else ", "
        return len(before), len(before), f"{comma}{new}"
    if whole and not re.search(r"^(---|\.\.\.)", text, re.MULTILINE):
        line = "" if text.endswith("\n") else "\n"
        return len(text), len(text), f"{line}{new}\n"
    first = node.value[0][0].start_mark
    return first.index, first.index, f"{new}\n{' ' * first.column}"


def _shared(root: Any) -> set[int]:
    """Nodes that stand at more than one place."""
    seen: set[int] = set()
    shared: set[int] = set()
    stack = [root]
    while stack:
        node = stack.pop()
        if id(node) in seen:
            shared.add(id(node))
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            stack += [inner for _, inner in node.value]
        elif isinstance(node, yaml.SequenceNode):
            stack += node.value
    return shared


def _flow(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(inner) for inner in value) + "]"
    if isinstance(value, float):
        if value.is_integer() and abs(value) < 1e6:
            return str(int(value))
        digits, _, power = repr(value).partition("e")  # YAML 1.1 wants a point and a sign
        return f"{digits}{'' if '.' in digits else '.0'}e{int(power):+d}" if power else digits
    return "null" if value is None else str(value)
