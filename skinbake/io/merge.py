"""Layers of configuration: one mapping laid over another, each key keeping the file and line it came from."""

from __future__ import annotations

import copy
from typing import Any

from skinbake.io.yaml_lines import Key, Located

# Ways to say one thing: giving one of them takes the others back
_EITHER: dict[Key, set[str]] = {
    ("mesh",): {"unit", "mm_per_unit"},
    ("skin", "fit"): {"gaussians", "tolerance"},
}
# What another medium keeps of the skin that was there
_KEPT_OF_A_SKIN = {"fit", "normalise"}


def part_of(located: Located, at: Key) -> Located:
    """A copy of the mapping below `at`, its places with it."""
    value = located.value
    for part in at:
        value = value[part]
    places = {key[len(at) :]: place for key, place in located.places.items() if key[: len(at)] == at}
    return Located(copy.deepcopy(value), {(): located.place(at)} | places)


def lay_over(base: Located, over: Located) -> Located:
    """`over` laid on `base`: mappings are merged key by key, everything else, lists too, is replaced.

    A skin that names another `preset` or `model` replaces the one below it, all but its `fit` and `normalise`; so does
    its `medium`, all of it.
    """
    places = dict(base.places)
    value = _merged(base.value, over.value, (), places, over)
    return Located(value, places)


def _merged(base: Any, over: Any, at: Key, places: dict[Key, str], source: Located) -> Any:
    """Two values merged at a key path; `places` is changed along."""
    if isinstance(over, dict) and isinstance(base, str) and "path" not in over and at[:1] == ("maps",):
        base = {"path": base}  # a bare path is short for a map
    if not isinstance(base, dict) or not isinstance(over, dict):
        for key in [key for key in places if key[: len(at)] == at]:
            del places[key]
        places.update({key: place for key, place in source.places.items() if key[: len(at)] == at})
        return over
    result = dict(base)
    if at == ("skin",) and {"preset", "model"} & set(over):
        result = {key: value for key, value in base.items() if key in _KEPT_OF_A_SKIN}
    if at == ("skin", "medium") and {"preset", "model"} & set(over):
        result = {}
    if not at:
        result = _without_other_tolerance(result, over)
    alternatives = _EITHER.get(at, set())
    if alternatives & set(over):
        result = {key: value for key, value in result.items() if key not in alternatives}
    for key, value in over.items():
        if key in result:
            result[key] = _merged(result[key], value, (*at, key), places, source)
        else:
            result[key] = _merged(None, value, (*at, key), places, source)
    return result


def _without_other_tolerance(base: dict[Any, Any], over: dict[Any, Any]) -> dict[Any, Any]:
    """A look without the tolerance that what is laid on it gives the other way."""
    diffusion = base.get("diffusion")
    if isinstance(over.get("diffusion"), dict) and "tolerance" in over["diffusion"]:
        return {key: value for key, value in base.items() if key != "tolerance"}
    if "tolerance" in over and isinstance(diffusion, dict):
        return base | {"diffusion": {key: value for key, value in diffusion.items() if key != "tolerance"}}
    return base
