"""From a plain mapping to a SceneSpec, every fault collected in the words of the person who wrote the file."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from skinbake.errors import ConfigError
from skinbake.scene.strict import Strict

T = TypeVar("T")
Key = tuple[str | int, ...]


def parse(kind: Any, mapping: Mapping[str, Any], say: Callable[[Key, str], str]) -> Any:
    """Validate `mapping` as `kind` (a model or an annotated union of models).

    Parameters
    ----------
    say : callable
        Given a key path and a sentence, the message line with its file and line.

    Raises
    ------
    ConfigError
        With one message for each fault.
    """
    try:
        return TypeAdapter(kind).validate_python(dict(mapping))
    except ValidationError as error:
        faults = []
        found = error.errors(include_url=False)
        for fault in found:
            if fault["type"] == "too_short" and any(
                f["loc"][: len(fault["loc"])] == fault["loc"] and f != fault for f in found
            ):
                continue  # short only because its faulty items were left out
            key = _key(mapping, fault["loc"], fault["type"])
            if fault["type"].startswith("union_tag"):
                key = (*key, fault["ctx"]["discriminator"].strip("'"))
            line = say(key, _sentence(fault))
            if line not in faults:
                faults.append(line)
        raise ConfigError(faults) from error


def _key(value: Any, loc: tuple[str | int, ...], kind: str) -> Key:
    """The part of pydantic's location that stands in the file: tags of unions and names of validators do not."""
    key: list[str | int] = []
    for i, part in enumerate(loc):
        last = i == len(loc) - 1
        if isinstance(value, Mapping) and part in value:
            value = value[part]
            key.append(part)
        elif isinstance(value, list | tuple) and isinstance(part, int):
            value = value[part] if part < len(value) else None
            key.append(part)
        elif last and kind == "missing":
            key.append(part)
    return tuple(key)


def _sentence(fault: Any) -> str:
    kind, got, context = fault["type"], fault.get("input"), fault.get("ctx", {})
    if kind == "extra_forbidden":
        return "unknown key" + _suggest(str(fault["loc"][-1]), sorted(_known_keys()))
    if kind == "missing":
        return "missing; expected a value"
    if kind == "union_tag_not_found":
        return "missing; expected a value"
    if kind == "union_tag_invalid":
        tags = context.get("expected_tags", "").replace("'", "")
        return f"expected one of {tags}, got {context.get('tag')}{_suggest(str(context.get('tag')), tags.split(', '))}"
    message = str(fault["msg"]).removeprefix("Value error, ")
    for before, after in _PHRASES:
        message = message.replace(before, after)
    if kind == "literal_error":
        options = context.get("expected", "").replace("'", "").replace(" or ", ", ").split(", ")
        return f"{message}, got {got!r}{_suggest(str(got), options)}"
    if "got" not in message and (got is None or isinstance(got, bool | int | float | str)):
        message += f", got {got!r}"
    return message


_PHRASES = (
    ("Input should be a valid ", "expected a "),
    ("Input should be an instance of ", "expected "),
    ("Input should be ", "expected "),
    ("greater than or equal to", ">="),
    ("less than or equal to", "<="),
    ("expected greater than", "expected a number >"),
    ("expected less than", "expected a number <"),
    ("expected >=", "expected a number >="),
    ("expected <=", "expected a number <="),
    ("expected a integer", "expected an integer"),
    ("dictionary", "mapping"),
    ("expected a tuple", "expected a list"),
    ("String should match pattern '^[A-Za-z0-9_-]+$'", "expected letters, digits, _ and - only"),
)


def _suggest(word: str, options: list[str]) -> str:
    close = difflib.get_close_matches(word, options, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def _known_keys() -> set[str]:
    keys: set[str] = set()
    todo = [Strict]
    while todo:
        model = todo.pop()
        keys |= set(model.model_fields)
        todo += model.__subclasses__()
    return keys
