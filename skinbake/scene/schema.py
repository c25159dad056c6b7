"""The JSON schema of a look, with a sentence for each key, and the page that is made of it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Any

from pydantic import BaseModel, TypeAdapter

from skinbake.scene import frames, lights, map_files, mesh_files, output, skin, spec
from skinbake.scene.skin import _Skin
from skinbake.scene.strict import Strict

TITLE = "A look of skinbake"
_MODULES: tuple[ModuleType, ...] = (spec, mesh_files, map_files, skin, lights, output, frames)
_ORDER = ("mesh", "occluders", "maps", "texture", "skin", "lights", "diffusion", "texturing", "specular", "terms")


def look_schema(methods: Sequence[str]) -> dict[str, Any]:
    """JSON schema (2020-12) of a look, for editors: every key with its description, default and limits.

    Skins may name a preset and leave out what it says. What only a check across keys finds, it lets pass.

    Parameters
    ----------
    methods : sequence of str
        Names for `diffusion.method`, which are not known here.
    """
    schema: dict[str, Any] = TypeAdapter(spec.SceneSpec).json_schema()
    definitions = {"SceneSpec": schema} | schema["$defs"]
    models = {model.__name__: model for model in _models()}
    for name, definition in definitions.items():
        model = models.get(name)
        if model is None:
            continue
        definition["description"] = " ".join((inspect.getdoc(model) or "").split())
        docs = key_docs(model)
        for key, of in definition.get("properties", {}).items():
            of["description"] = docs[key]
        if issubclass(model, _Skin):
            definition["properties"]["preset"] = {
                "type": "string",
                "description": "A skin of configs/skins to begin with.",
            }
            definition.pop("required", None)
            definition["properties"]["model"].pop("const", None)
            definition["properties"]["model"]["enum"] = [_model_name(model)]
    definitions["DiffusionSpec"]["properties"]["method"]["enum"] = [spec.AUTO, *methods]
    for holder in _unions(schema):
        holder.pop("discriminator", None)
        holder["anyOf"] = holder.pop("oneOf")
    # Without `relight` a look has lights
    schema |= {"if": {"not": {"required": ["relight"]}}, "then": {"properties": {"lights": {"minItems": 1}}}}
    # What every file may say of itself, for editors
    schema["properties"]["$schema"] = {"type": "string", "description": "Where this schema lies."}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": TITLE} | {
        key: value for key, value in schema.items() if key != "title"
    }


def key_docs(model: type[BaseModel]) -> dict[str, str]:
    """The sentence below each field of a model, its own and inherited, by key."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not (issubclass(base, Strict) and base is not Strict):
            continue
        (tree,) = ast.parse(inspect.getsource(base)).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in zip(tree.body, tree.body[1:], strict=False):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found[name] = " ".join(text.split())
    return {key: found[key] for key in model.model_fields}


def reference_page(methods: Sequence[str]) -> str:
    """The page of every key: type, default and meaning, in Markdown; `methods` as in `look_schema`."""
    schema = look_schema(methods)
    definitions = schema["$defs"]
    out = [_HEAD]
    sections = [*_ORDER, *(key for key in schema["properties"] if key not in (*_ORDER, "$schema"))]
    for key in sections:
        of = schema["properties"][key]
        out += [f"## `{key}`", "", f"{of['description']}", ""]
        found = list(dict.fromkeys(_references(of)))
        if not found:
            out += [f"{_type(of, definitions)}, by default {_default(of)}.", ""]
        for name in found:
            out += _table(key, name, definitions[name], len(found) > 1)
            for part in dict.fromkeys(_references({"of": definitions[name].get("properties", {})})):
                if part not in found and not definitions[part].get("done"):
                    definitions[part]["done"] = True
                    out += _table(part, part, definitions[part], True)
    return "\n".join(out).rstrip() + "\n"


_HEAD = """# Every key of a look

Made from the schema by `skinbake schema --reference`; a test looks that it is up to date. `skinbake schema` prints the
schema itself. `skinbake init` writes it beside the look that it makes; with it, editors complete and check looks that
begin with

```yaml
# yaml-language-server: $schema=skinbake.schema.json
```

Lengths are millimetres, colours linear Rec.709 unless a file says otherwise, y is up and the face looks along +z.
`direction` is where light travels to. Relative paths are relative to the file that they stand in, `${NAME:-default}` in
them is a variable of the environment.

![Axes, and which way lights and skies face](directions.svg)
"""


def _table(key: str, name: str, definition: dict[str, Any], titled: bool) -> list[str]:
    """Heading and rows of one model."""
    properties = definition.get("properties", {})
    if not properties:
        return []
    kind = next((properties[tag] for tag in ("type", "model") if tag in properties and _only(properties[tag])), None)
    title = f"`{key}` of {('type' if 'type' in properties else 'model')} `{_only(kind)}`" if kind else _spoken(name)
    lines = [f"### {title}", "", definition.get("description", ""), ""] if titled else []
    lines += ["| key | value | by default | meaning |", "| --- | --- | --- | --- |"]
    for entry, of in properties.items():
        if entry == "preset" or (_only(of) and entry in ("type", "model")):
            continue
        needed = entry in definition.get("required", ())
        shown = "needed" if needed else _default(of)
        lines.append(f"| `{entry}` | {_type(of, {})} | {shown} | {of['description']} |".replace("|  |", "| |"))
    return [*lines, ""]


def _spoken(name: str) -> str:
    """A model's name as a heading."""
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name.removesuffix("Spec"))
    return words.strip().capitalize()


def _only(of: dict[str, Any] | None) -> str:
    """The one value that a key may have, or nothing."""
    if of is None:
        return ""
    values = of.get("enum", [of["const"]] if "const" in of else [])
    return str(values[0]) if len(values) == 1 else ""


def _type(of: dict[str, Any], definitions: dict[str, Any]) -> str:
    """What a key may be, in words."""
    if "anyOf" in of:
        return " or ".join(dict.fromkeys(text for each in of["anyOf"] if (text := _type(each, definitions)) != "null"))
    if "$ref" in of:
        return _spoken(of["$ref"].rpartition("/")[2]).lower()
    if "enum" in of or "const" in of:
        return ", ".join(f"`{value}`" for value in of.get("enum", [of.get("const")]))
    kind = of.get("type", "anything")
    if kind == "array":
        items = of.get("prefixItems")
        if items:
            each = {_type(item, definitions) for item in items}
            return (
                f"{len(items)} x {each.pop()}"
                if len(each) == 1
                else ", ".join(_type(item, definitions) for item in items)
            )
        return f"list of {_type(of.get('items', {}), definitions)}"
    if kind == "object":
        return f"mapping of {_type(of.get('additionalProperties') or {}, definitions)}"
    if kind in ("number", "integer"):
        return ("number" if kind == "number" else "whole number") + _limits(of)
    return {"string": "text", "boolean": "true, false"}.get(str(kind), str(kind))


def _limits(of: dict[str, Any]) -> str:
    """Limits of a number that are worth saying."""
    low, high = of.get("minimum", of.get("exclusiveMinimum")), of.get("maximum", of.get("exclusiveMaximum"))
    high = None if high is not None and high >= 1e9 else high
    if low is not None and high is not None:
        return f" {low:g} to {high:g}"
    if low is not None:
        return f" above {low:g}" if "exclusiveMinimum" in of else f" from {low:g}"
    return f" up to {high:g}" if high is not None else ""


def _default(of: dict[str, Any]) -> str:
    """A key's default as YAML."""
    value = of.get("default")
    if value is None or isinstance(value, dict) or value == []:
        return "-"
    return f"`{value}`".lower() if isinstance(value, bool) else f"`{value}`"


def _references(of: Any) -> Iterator[str]:
    """Names of the models that a schema mentions directly."""
    if isinstance(of, dict):
        for key, value in of.items():
            if key == "$ref":
                yield value.rpartition("/")[2]
            else:
                yield from _references(value)
    elif isinstance(of, list):
        for value in of:
            yield from _references(value)


def _unions(of: Any) -> Iterator[dict[str, Any]]:
    """Parts of a schema that are one of several models."""
    if isinstance(of, dict):
        if "oneOf" in of:
            yield of
        for value in list(of.values()):
            yield from _unions(value)
    elif isinstance(of, list):
        for value in of:
            yield from _unions(value)


def _models() -> Iterator[type[Strict]]:
    """Every model of the configuration."""
    for module in _MODULES:
        for value in vars(module).values():
            if isinstance(value, type) and issubclass(value, Strict):
                yield value


def _model_name(model: type[BaseModel]) -> str:
    """What `skin.model` is for a model of a skin."""
    (name,) = model.model_fields["model"].annotation.__args__  # type: ignore[union-attr]
    return str(name)
