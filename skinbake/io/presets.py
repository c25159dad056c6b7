"""Skins by name, put under what a look says of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError
from skinbake.io.look_paths import resolve_paths
from skinbake.io.yaml_lines import Located, read_yaml


def skin_names() -> list[str]:
    """Names of the skins that come with skinbake, sorted."""
    return sorted({file.stem for folder in preset_folders() if folder.is_dir() for file in folder.glob("*.yaml")})


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
