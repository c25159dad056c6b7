"""Validation: a plain mapping becomes a SceneSpec, or a list of all its faults in the words of the file's author."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError

from skinbake.errors import MOST_FAULTS, ConfigError
from skinbake.scene.strict import Strict

Key = tuple[str | int, ...]


def parse(kind: Any, mapping: Any, say: Callable[[Key, str], str], context: Mapping[str, Any] | None = None) -> Any:
    """Validate `mapping`, as it came out of a file, as `kind`, and give that model.

    Parameters
    ----------
    kind : type
        A model, or an annotated union of models.
    mapping : mapping
    say : callable
        Given a key path and a sentence, the message line with its file and line.
    context : mapping, optional
        What validators may ask for that lies outside `scene` (`spec.DIFFUSION_METHODS`); without it they let it pass.

    Raises
    ------
    ConfigError
        With one message for each fault.
    """
    try:
        made = TypeAdapter(kind).validate_python(mapping, context=context)
        switches = [say(key, f"expected a number, got {_shown(value)}") for key, value in _taken_for_1(mapping, made)]
        if switches:
            raise ConfigError(switches)
        return made
    except ValidationError as error:
        faults: dict[str, None] = {}  # each once, in order
        found = error.errors(include_url=False)
        for fault in found:
            if fault["type"] == "too_short" and any(
                f["loc"][: len(fault["loc"])] == fault["loc"] and f != fault for f in found
            ):
                continue  # short only because its faulty items were left out
            if fault["type"] == "missing" and any(_meant(kind, f) == fault["loc"] for f in found):
                continue  # it is there, misspelt
            key = _key(mapping, fault["loc"], fault["type"])
            if fault["type"].startswith("union_tag"):
                key = (*key, fault["ctx"]["discriminator"].strip("'"))
            faults.setdefault(say(key, _sentence(kind, fault) if len(faults) < MOST_FAULTS else fault["msg"]))
        raise ConfigError(tuple(faults)) from error


def _taken_for_1(given: Any, made: Any, key: Key = ()) -> Iterator[tuple[Key, bool]]:
    """Keys of `true`, `on`, `false` ... that became numbers, as they do to pydantic, and these.

    Where None is left of one, its number has gone to another key, as a look's `tolerance` does.
    """
    if isinstance(given, bool):
        if made is None or (isinstance(made, int | float) and not isinstance(made, bool)):
            yield key, given
    elif isinstance(given, Mapping) and isinstance(made, BaseModel | Mapping):
        below = made if isinstance(made, Mapping) else dict(made)
        for name in given:
            yield from _taken_for_1(given[name], below.get(name, given[name]), (*key, name))
    elif isinstance(given, list | tuple) and isinstance(made, list | tuple):
        for i, (one, other) in enumerate(zip(given, made, strict=False)):
            yield from _taken_for_1(one, other, (*key, i))


def unknown_keys(kind: Any, mapping: Mapping[str, Any], say: Callable[[Key, str], str]) -> list[str]:
    """A message for each key of `mapping` that `kind` does not know; other faults are ignored.

    Parameters
    ----------
    kind : type
        A model, or an annotated union of models.
    mapping : mapping
    say : callable
        As `parse`.
    """
    try:
        TypeAdapter(kind).validate_python(mapping)
    except ValidationError as error:
        faults = [fault for fault in error.errors(include_url=False) if fault["type"] == "extra_forbidden"]
        return [
            say(_key(mapping, f["loc"], f["type"]), _sentence(kind, f) if i < MOST_FAULTS else f["msg"])
            for i, f in enumerate(faults)
        ]
    return []


def _key(value: Any, loc: tuple[str | int, ...], kind: str) -> Key:
    """Key path in the file for a location of pydantic's, which also holds tags of unions and names of validators."""
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


def _sentence(kind: Any, fault: Any) -> str:
    """Sentence on one fault of pydantic's: what was expected, and what came."""
    found, got, context = fault["type"], fault.get("input"), fault.get("ctx", {})
    if found == "extra_forbidden":
        return _unknown(str(fault["loc"][-1]), _keys_at(kind, fault["loc"][:-1]))
    if found in ("missing", "union_tag_not_found"):
        return "missing; expected a value"
    if found in _EXPECTED:
        return f"expected {_EXPECTED[found]}, got {_shown(got)}"
    if found in ("too_short", "too_long"):
        limit = f"at least {context['min_length']}" if found == "too_short" else f"at most {context['max_length']}"
        return f"expected a list of {limit}, got {context['actual_length']}"
    if found == "union_tag_invalid":
        tags = context.get("expected_tags", "").replace("'", "")
        return f"expected one of {tags}, got {context.get('tag')}{_suggest(str(context.get('tag')), tags.split(', '))}"
    message = str(fault["msg"]).removeprefix("Value error, ")
    for before, after in _PHRASES:
        message = message.replace(before, after)
    if found == "literal_error":
        options = context.get("expected", "").replace("'", "").replace(" or ", ", ").split(", ")
        return f"{message}, got {got!r}{_suggest(str(got), options)}"
    if "got" not in message and (got is None or isinstance(got, bool | int | float | str)):
        message += f", got {_shown(got)}"
    return message


def _shown(value: Any) -> str:
    """A value as its YAML has it; mappings and lists are only named."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    return "nothing" if value is None else repr(value) if isinstance(value, str) else str(value)


_EXPECTED = {
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dict_type": "a mapping",
    "invalid_key": "text as a key",
    "tuple_type": "a list",
    "string_type": "text",
    "string_unicode": "text in UTF-8",
    "bool_type": "a boolean",
    "bool_parsing": "a boolean",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_from_float": "a whole number",
}
_PHRASES = (
    ("Input should be ", "expected "),
    ("greater than or equal to", ">="),
    ("less than or equal to", "<="),
    ("expected greater than", "expected a number >"),
    ("expected less than", "expected a number <"),
    ("expected >=", "expected a number >="),
    ("expected <=", "expected a number <="),
    ("String should match pattern '^[A-Za-z0-9_-]+$'", "expected letters, digits, _ and - only"),
)


def _suggest(word: str, options: list[str]) -> str:
    """The ending "; did you mean ...?" for a misspelt word, or nothing."""
    close = difflib.get_close_matches(word, options, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def _meant(kind: Any, fault: Any) -> tuple[str | int, ...] | None:
    """Location of the key that a misspelt one is taken for."""
    *above, word = fault["loc"]
    if fault["type"] != "extra_forbidden" or word in _known_keys():
        return None
    close = difflib.get_close_matches(str(word), _keys_at(kind, tuple(above)), n=1)
    return (*above, close[0]) if close else None


def _unknown(word: str, allowed: list[str]) -> str:
    """Sentence about a key that is not allowed where it stands."""
    if word in _known_keys():
        return f"does not belong here; expected one of {', '.join(allowed)}"
    return "unknown key" + (_suggest(word, allowed) or f"; expected one of {', '.join(allowed)}")


def _keys_at(kind: Any, loc: tuple[str | int, ...]) -> list[str]:
    """Keys that are allowed where pydantic's location leads, from `kind` down: by fields and by tags of unions."""
    models = list(_models(kind))
    for part in loc:
        below = [field.annotation for model in models if (field := model.model_fields.get(str(part)))]
        tagged = [
            model for model in models if any(get_args(f.annotation) == (part,) for f in model.model_fields.values())
        ]
        models = [model for annotation in below for model in _models(annotation)] or tagged or models
    return list(dict.fromkeys(key for model in models for key in model.model_fields))


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Every model inside an annotation, such as a union, a list or an optional."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _known_keys() -> set[str]:
    """Keys of all models, wherever they belong."""
    keys: set[str] = set()
    todo = [Strict]
    while todo:
        model = todo.pop()
        keys |= set(model.model_fields)
        todo += model.__subclasses__()
    return keys
