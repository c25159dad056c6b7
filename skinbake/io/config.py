"""Configuration files: a look, or just its skin, with overrides, presets and paths resolved."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError, InputError
from skinbake.io.fingerprint import files_named
from skinbake.io.output_names import is_output, refuse_inputs
from skinbake.io.yaml_lines import Key, Located, dotted, parse_value, read_yaml
from skinbake.scene.batch import BatchSpec
from skinbake.scene.frames import frame_numbers
from skinbake.scene.mesh_files import OF_FILE
from skinbake.scene.parse import parse, unknown_keys
from skinbake.scene.skin import SkinSpec
from skinbake.scene.spec import DIFFUSION_METHODS, SceneSpec

_PATH_KEYS = re.compile(
    r"mesh\.path|mesh\.opacity(\..+)?|occluders\[\d+\]\.(path|opacity)|maps\.(?!source$|vertex_colors$)\w+(\.path)?|lights\[\d+\]\.path|skin\.path|output\.dir"
)
_TIME = re.compile(r"(mesh|occluders\[\d+\])\.time")
_FRAME = re.compile(r"#{2,}|%0\d+d|%d")
_VARIABLE = re.compile(r"\$\{(\w+)(?::-([^}]*))?\}")


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
    numbers = _frames(located)
    if numbers is not None:
        if len(numbers) > 1 and not first_frame:
            expected = (
                f"expected one frame here, got {len(numbers)}: `skinbake bake` and `skinbake batch` bake them all,"
                f" --set frames={numbers[0]} chooses one"
            )
            raise ConfigError([located.say(("frames",), expected)])
        located = _at_frame(located, numbers[0])
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
    return _frames(located) or ()


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
    looks = {number: parse_look(_at_frame(located, number)) for number in _frames(located) or ()}
    _refuse_unknown_color_spaces(located)
    return Path(located.value["output"]["dir"]), looks


def frame_name(number: int) -> str:
    """Name of a frame's folder."""
    return f"{number:04d}"


def _prepared_for(path: Path | str, overrides: Sequence[str], out: Path | str | None) -> Located:
    """YAML of a look with its overrides and its folder."""
    located = _prepared(path, overrides)
    if out is not None:
        put(located, "output.dir", str(Path(out).absolute()), "--out")
    return located


def _frames(located: Located) -> tuple[int, ...] | None:
    """Frames that a look gives, or None."""
    given = located.value.get("frames")
    if given is None:
        return None
    try:
        return frame_numbers(given)
    except ValueError as error:
        got = "" if "got" in str(error) else f", got {given!r}"
        raise ConfigError([located.say(("frames",), f"{error}{got}")]) from error


def _at_frame(located: Located, number: int) -> Located:
    """The look of one frame: the number in its paths, a folder of its own."""
    changed = False

    def visit(value: Any, key: Key) -> Any:
        """The value with the number in every input's path below it."""
        nonlocal changed
        if isinstance(value, dict):
            return {k: visit(v, (*key, k)) for k, v in value.items()}
        if isinstance(value, list):
            return [visit(v, (*key, i)) for i, v in enumerate(value)]
        if isinstance(value, str) and _TIME.fullmatch(dotted(key)) and _FRAME.fullmatch(value):
            changed = True
            return number
        if not _is_path(value, key) or key[0] == "output":
            return value
        named = _FRAME.sub(lambda mark: str(number).zfill(_digits(mark[0])), value)
        changed = changed or named != value
        return named

    found = {key: visit(value, (key,)) for key, value in located.value.items() if key != "frames"}
    if not changed:
        raise ConfigError([located.say(("frames",), "expected #### or %04d in a path, or as mesh.time, got none")])
    output = found.get("output")
    if isinstance(output, dict) and isinstance(output.get("dir"), str):
        found["output"] = output | {"dir": str(Path(output["dir"], frame_name(number)))}
    return Located(found, located.places)


def _digits(mark: str) -> int:
    """Least digits of a mark: as many as it has signs, or as it says."""
    return len(mark) if mark[0] == "#" else int(mark[1:-1] or 1)


def load_skin(path: Path | str, overrides: Sequence[str] = ()) -> SkinSpec:
    """Read the `skin:` part of a look, or a file that holds nothing but a skin.

    The rest of a look may be unfinished, but a key that no look has is refused: it might be a slip for `skin`. Keys of
    overrides may begin with `skin.` or not where the file is only a skin.

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
    return skin


def skin_names() -> list[str]:
    """Names of the skins that come with skinbake, sorted."""
    return sorted({file.stem for folder in preset_folders() if folder.is_dir() for file in folder.glob("*.yaml")})


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
        for key, path in _inputs(located.value)
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


def _inputs(value: Any, key: Key = ()) -> Iterator[tuple[Key, str]]:
    """Keys and paths of the files that a checked look reads."""
    if _is_path(value, key) and key[0] != "output":
        yield key, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for part, inner in items:
        yield from _inputs(inner, (*key, part))


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
        put(located, name.strip(), parse_value(value, f"--set {name.strip()}"), f"--set {name.strip()}")
        resolve_paths(located, Path.cwd(), only=f"--set {name.strip()}")


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
        if _is_path(value, key) and only in (None, located.place(key)):
            try:
                return str(_absolute(value, base))
            except InputError as error:
                faults.append(f"{located.place(key)}: {dotted(key)}: {error}")
        return value

    located.value = visit(located.value, ())
    if faults:
        raise ConfigError(faults)


def _is_path(value: Any, key: Key) -> bool:
    """Whether a value is a path, not the word for what the mesh's own file holds."""
    name = dotted(key)
    return isinstance(value, str) and bool(_PATH_KEYS.fullmatch(name)) and not (value == OF_FILE and "opacity" in name)


def _absolute(text: str, base: Path) -> Path:
    """Absolute path of a text, `${NAME}` and `~` expanded."""
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


def preset_folders(*beside: Path) -> list[Path]:
    """Folders with named skins: `skins/` beside the look, the installed ones, the repository's."""
    package = Path(__file__).parent.parent
    return [*(folder / "skins" for folder in beside), package / "skins", package.parent / "configs" / "skins"]


def merge_preset(located: Located, *beside: Path) -> None:
    """Put what `skin.preset` names under the other keys of `skin`, and then what `skin.medium.preset` names under its.

    Both are looked up in `skins/` of each folder.

    Raises
    ------
    ConfigError
        There is no such preset.
    """
    for at in (("skin",), ("skin", "medium")):
        _merge_preset_at(at, located, *beside)


def _merge_preset_at(at: tuple[str, ...], located: Located, *beside: Path) -> None:
    """Put the skin that the mapping at a key names by `preset` under its other keys."""
    above: Any = located.value
    for key in at[:-1]:
        above = above.get(key) if isinstance(above, dict) else None
    skin = above.get(at[-1]) if isinstance(above, dict) else None
    if not isinstance(skin, dict) or "preset" not in skin:
        return
    name = skin["preset"]
    place = f"{located.place((*at, 'preset'))}: {'.'.join(at)}.preset"
    folders = [folder for folder in preset_folders(*beside) if folder.is_dir()]
    known = sorted({file.stem for folder in folders for file in folder.glob("*.yaml")})
    if name not in known:
        raise ConfigError([f"{place}: expected one of {', '.join(known)}, got {name!r}"])
    file = next(folder / f"{name}.yaml" for folder in folders if (folder / f"{name}.yaml").is_file())
    preset = read_yaml(file)
    below = 1 if "skin" in preset.value else 0
    preset = Located(
        {"skin": preset.value["skin"] if below else preset.value},
        {("skin", *key[below:]): where for key, where in preset.places.items()},
    )
    resolve_paths(preset, file.parent)
    own = {key: value for key, value in skin.items() if key != "preset"}
    above[at[-1]] = preset.value["skin"] | own
    kept = {key[1:]: where for key, where in preset.places.items() if key[1:2] not in {(name,) for name in own}}
    located.places = {(*at, *key): where for key, where in kept.items()} | located.places
