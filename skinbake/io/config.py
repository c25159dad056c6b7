"""Configuration files: a look, or just its skin, with overrides, presets and paths resolved."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError, InputError
from skinbake.io.fingerprint import files_named
from skinbake.io.frames import at_frame, given_frames
from skinbake.io.look_paths import input_paths, resolve_paths
from skinbake.io.output_names import is_output, refuse_inputs
from skinbake.io.overrides import apply_overrides, put
from skinbake.io.presets import merge_preset, preset_folders, skin_names
from skinbake.io.yaml_lines import Key, Located, read_yaml
from skinbake.scene.batch import BatchSpec
from skinbake.scene.parse import parse, unknown_keys
from skinbake.scene.skin import SkinSpec
from skinbake.scene.spec import DIFFUSION_METHODS, SceneSpec, fitted_for


def load_look(
    path: Path | str,
    overrides: Sequence[str] = (),
    out: Path | str | None = None,
    files: bool = True,
    first_frame: bool = False,
) -> SceneSpec:
    """Read a look, apply `--set` overrides (`dotted.key=value`) and `--out`, and check it.

    Paths in the file are relative to the file; paths in overrides to the working folder. `${NAME}` and
    `${NAME:-default}` in a path are environment variables.

    Parameters
    ----------
    files : bool
        Refuse a look whose mesh, maps, sky or table is missing: here the line and the key are known.
    first_frame : bool
        Of a look of several frames take the first; otherwise it is refused.

    Raises
    ------
    InputError, ConfigError
        With a line for each fault.
    """
    located = _prepared_for(path, overrides, out)
    numbers = given_frames(located)
    if numbers is not None:
        if len(numbers) > 1 and not first_frame:
            expected = (
                f"expected one frame here, got {len(numbers)}: `skinbake bake` and `skinbake batch` bake them all,"
                f" --set frames={numbers[0]} chooses one"
            )
            raise ConfigError([located.say(("frames",), expected)])
        located = at_frame(located, numbers[0])
    look = parse_look(located)
    beside = Path(look.output.dir) / Path(path).name
    if is_output(beside.name):
        refuse_inputs([beside], [path])
    if files:
        _refuse_missing(located)
        _refuse_unknown_color_spaces(located)
    return look


def frames_of(path: Path | str, overrides: Sequence[str] = ()) -> tuple[int, ...]:
    """Frames of a look; empty where it is no sequence.

    Raises
    ------
    InputError, ConfigError
        It cannot be read, or its frames are none.
    """
    located = read_yaml(path)
    chosen = [text for text in overrides if text.partition("=")[0].strip() == "frames"]
    apply_overrides(located, chosen)
    return given_frames(located) or ()


def load_frames(
    path: Path | str, overrides: Sequence[str] = (), out: Path | str | None = None
) -> tuple[Path, dict[int, SceneSpec]]:
    """The folder of a sequence, and its looks by their frame, each with a folder in it.

    Parameters
    ----------
    path : path
        Of a look with `frames`.
    overrides, out
        As of `load_look`.

    Raises
    ------
    InputError, ConfigError
        With a line for each fault; missing files are for whoever reads them.
    """
    located = _prepared_for(path, overrides, out)
    looks = {number: parse_look(at_frame(located, number)) for number in given_frames(located) or ()}
    _refuse_unknown_color_spaces(located)
    return Path(located.value["output"]["dir"]), looks


def _prepared_for(path: Path | str, overrides: Sequence[str], out: Path | str | None) -> Located:
    """YAML of a look with its overrides and its folder."""
    located = _prepared(path, overrides)
    if out is not None:
        put(located, "output.dir", str(Path(out).absolute()), "--out")
    return located


def load_skin(path: Path | str, overrides: Sequence[str] = (), as_baked: bool = False) -> SkinSpec:
    """Read the `skin:` part of a look, or a file that holds nothing but a skin.

    The rest of a look may be unfinished, but a key that no look has is refused: it might be a slip for `skin`. Keys of
    overrides may begin with `skin.` or not where the file is only a skin.

    Parameters
    ----------
    as_baked : bool
        Fitted as a bake of the look's tolerance fits it (`fitted_for`), where it has one.

    Raises
    ------
    InputError, ConfigError
        With a line for each fault.
    """
    located = _prepared(path, overrides, whole=False)
    faults = unknown_keys(SceneSpec, located.value, located.say)
    try:
        skin: SkinSpec = parse(SkinSpec, located.value.get("skin"), lambda key, text: located.say(("skin", *key), text))
    except ConfigError as error:
        raise ConfigError(list(dict.fromkeys((*faults, *error.faults)))) from error
    if faults:
        raise ConfigError(faults)
    _refuse_missing(Located({"skin": located.value["skin"]}, located.places))
    tolerance, diffusion = located.value.get("tolerance"), located.value.get("diffusion")
    if tolerance is None and isinstance(diffusion, dict):
        tolerance = diffusion.get("tolerance")
    known = isinstance(tolerance, int | float) and not isinstance(tolerance, bool)
    return fitted_for(skin, tolerance) if as_baked and known else skin


def load_named_skin(name: str) -> SkinSpec:
    """A skin by its name, or of a file: a look's, or one that holds a skin alone.

    Raises
    ------
    InputError, ConfigError
        There is no such skin, or its file cannot be used.
    """
    if name in skin_names():
        file = next(folder / f"{name}.yaml" for folder in preset_folders() if (folder / f"{name}.yaml").is_file())
        return load_skin(file)
    if not Path(name).is_file():
        raise InputError(f"skin: expected a file, or one of {', '.join(skin_names())}, got {name or 'nothing'}")
    return load_skin(name)


def parse_look(located: Located) -> SceneSpec:
    """Check a mapping whose paths are already resolved."""
    return parse_scene(located.value, located.say)


def parse_scene(mapping: Any, say: Callable[[Key, str], str]) -> SceneSpec:
    """Check a whole look, its diffusion method too; `say` gives the message line of a key and a sentence.

    Raises
    ------
    ConfigError
        With one message for each fault.
    """

    def diffusion_methods() -> dict[str, bool]:
        from skinbake.diffuse.methods import METHODS

        return {each.name: each.classical for each in METHODS.values() if each.asked_for}

    scene: SceneSpec = parse(SceneSpec, mapping, say, {DIFFUSION_METHODS: diffusion_methods})
    return scene


def _refuse_missing(located: Located) -> None:
    """Refuse a look whose input files are missing, naming line and key of each. Other faults are their readers'."""
    faults = [
        located.say(key, f"expected a file, there is none at {path}")
        for key, path in input_paths(located.value)
        if not any(os.path.exists(file) for file in files_named(path))
    ]
    if faults:
        raise ConfigError(faults)


def _refuse_unknown_color_spaces(located: Located) -> None:
    """Name the line of a colour space that nobody knows."""
    faults = []
    maps, lights = located.value.get("maps"), located.value["lights"]
    maps = maps if isinstance(maps, dict) else {}
    chosen: list[tuple[Key, Any]] = [(("maps", name), of) for name, of in maps.items()]
    for key, of in [*chosen, *((("lights", i), light) for i, light in enumerate(lights))]:
        space = of.get("color_space", "auto") if isinstance(of, dict) else "auto"
        if space not in ("auto", "srgb", "linear"):
            from skinbake.io.colour import known_color_space

            wrong = known_color_space(space)
            faults += [located.say((*key, "color_space"), wrong)] if wrong else []
    if faults:
        raise ConfigError(faults)


def _prepared(path: Path | str, overrides: Sequence[str], whole: bool = True) -> Located:
    """YAML of a look or a skin, with its paths resolved, its overrides applied and its preset merged."""
    located = read_yaml(path)
    if "mesh" not in located.value and set(BatchSpec.model_fields) & set(located.value):
        raise ConfigError([located.say((), "expected a look, this is a batch file: use `skinbake batch`")])
    if not whole and "skin" not in located.value and "mesh" not in located.value:
        located = Located({"skin": located.value}, {("skin", *key): place for key, place in located.places.items()})
        overrides = [text if re.match(r"\s*skin\s*[.=]", text) else f"skin.{text.lstrip()}" for text in overrides]
    resolve_paths(located, Path(path).absolute().parent)
    apply_overrides(located, overrides)
    merge_preset(located, Path(path).absolute().parent)
    return located
