"""export.json: which files of a folder an export has made, so that no other file is ever replaced."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import skinbake
from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.io.code_digest import package_digest
from skinbake.io.digests import key_of
from skinbake.io.manifest import NAME as MANIFEST
from skinbake.io.manifest import read_manifest

NAME = "export.json"


def bake_digest(bake: Path) -> str:
    """What tells one bake from another: its look, the contents of its files, and its lobes; not how long it took.

    Raises
    ------
    InputError
        There is none, or it is damaged.
    """
    manifest = read_manifest(bake)
    return key_of([manifest[name] for name in ("config", "inputs", "lobes", "lights")])


def refuse_foreign(folder: Path, names: Sequence[str]) -> None:
    """Look at what lies where an export is going to write.

    Parameters
    ----------
    folder : Path
    names : sequence of str

    Raises
    ------
    InputError
        The folder is a bake, a file is in its place, or it holds a file of one of these names that no export made.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to export to, got a file")
    if (folder / MANIFEST).exists():
        raise InputError(f"{folder}: expected a folder of its own to export to, got one with a bake; choose another")
    own = set(_listed(folder))
    for name in (*names, NAME):
        if (folder / name).exists() and name not in own:
            raise InputError(
                f"{folder / name}: expected no file, or one of an earlier export, got one that is not listed in"
                f" {NAME}; move it, or export to another folder"
            )


def keep_export_list(folder: Path, names: Sequence[str], bake: Path) -> tuple[int, Path]:
    """Write down, before they are there, which files an export makes, and remove what is left of another bake.

    Files that an earlier export of the same bake made stay, and stay listed. Gives how many
    files were removed, and the bake of the earlier export.

    Parameters
    ----------
    folder : Path
    names : sequence of str
    bake : Path
        Where the bake lies.

    Raises
    ------
    InputError, MachineError
        As `write_text`.
    """
    digest, earlier, made = bake_digest(bake), _listed(folder), _made(folder)
    stale = [name for name, of in earlier.items() if of != digest and name not in (*names, NAME)]
    of_bake = Path(str(_read(folder).get("bake", "")))
    files = {name: of for name, of in earlier.items() if of == digest} | dict.fromkeys((*names, NAME), digest)
    removed = sum(_remove(folder / name) for name in stale)
    _write(folder, bake, files, {name: of for name, of in made.items() if name in files and name not in names})
    return removed, of_bake


def remove_exports(folder: Path) -> None:
    """Remove all that exports have made, the list too, and the folder where nothing else is in it."""
    for name in (*_listed(folder), NAME):
        _remove(folder / name)
    with suppress(OSError):  # what others have put there stays
        folder.rmdir()


def _remove(path: Path) -> bool:
    """Remove a file; whether there was one."""
    there = not path.is_dir() and (path.exists() or path.is_symlink())
    if there:
        path.unlink(missing_ok=True)
    return there


def finish_export_list(folder: Path, names: Sequence[str], bake: Path, figures: Mapping[str, Any]) -> None:
    """Write down that the files are whole, and what they were made of.

    Parameters
    ----------
    folder : Path
    names : sequence of str
        All listed by `keep_export_list`.
    bake : Path
        Where the bake lies.
    figures : mapping of file name to JSON object
        What is known of some of them.

    Raises
    ------
    InputError, MachineError
        As `write_text`.
    """
    key, made = _key(bake), _made(folder)
    for name in names:
        about = {"figures": figures[name]} if name in figures else {}
        made[name] = {"bytes": (folder / name).stat().st_size, "key": key} | about
    _write(folder, bake, _listed(folder), made)


def export_figures(folder: Path) -> dict[str, Any]:
    """What is known of the files of the last export, by name."""
    return {name: of["figures"] for name, of in _made(folder).items() if "figures" in of}


def is_exported(folder: Path, names: Sequence[str], bake: Path) -> bool:
    """Whether these files, and no others, are there, as this code writes them of this bake.

    Parameters
    ----------
    folder : Path
    names : sequence of str
    bake : Path
        Where the bake lies.
    """
    made, key = _made(folder), _key(bake)
    if set(made) != set(names) or set(_listed(folder)) != {*names, NAME}:
        return False
    sizes = {name: (folder / name).stat().st_size for name in names if (folder / name).is_file()}
    return all((made[name]["bytes"], made[name]["key"]) == (sizes.get(name), key) for name in names)


def _key(bake: Path) -> str:
    """What an export depends on: the code, and all that the manifest says of the bake but how long it took."""
    manifest = read_manifest(bake)
    return key_of(package_digest(), [manifest[name] for name in _BAKED])


_BAKED = ("version", "config", "inputs", "irradiance", "lobes", "lights", "terms", "error", "plan", "bytes")


def _write(folder: Path, bake: Path, files: dict[str, str], made: dict[str, Any]) -> None:
    """Write the list.

    Parameters
    ----------
    folder, bake : Path
    files : dict of name to digest of the bake
    made : dict of name to size and key
    """
    record = {
        "version": skinbake.__version__,
        "bake": str(bake.resolve()),
        "files": dict(sorted(files.items())),
        "made": dict(sorted(made.items())),
    }
    write_text(folder / NAME, json.dumps(record, indent=1) + "\n")


def _listed(folder: Path) -> dict[str, str]:
    """Files that the last export's list names, and the bake of each; none where there is no list, or a damaged one."""
    return {name: str(of) for name, of in _entries(folder, "files").items()}


def _made(folder: Path) -> dict[str, Any]:
    """Files that the last export's list calls whole, with size and key."""
    found = _entries(folder, "made")
    return {name: of for name, of in found.items() if isinstance(of, dict) and {"bytes", "key"} <= of.keys()}


def _entries(folder: Path, key: str) -> dict[str, Any]:
    """An entry of the list by file name; nothing where there is none, or a damaged one."""
    files = _read(folder).get(key)
    return files if isinstance(files, dict) and all(map(_is_plain, files)) else {}


def _read(folder: Path) -> dict[str, Any]:
    """The list; nothing where there is none, or a damaged one."""
    try:
        found = json.loads((folder / NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _is_plain(name: str) -> bool:
    """Whether a name is that of a file in the folder: nothing outside it is ever touched."""
    return Path(name).name == name and name not in ("", "..") and "\0" not in name and name.isprintable()
