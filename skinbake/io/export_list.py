"""export.json: which files of a folder an export has made, so that no other file is ever replaced."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import skinbake
from skinbake.errors import InputError
from skinbake.io.atomic import write_text
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


def keep_export_list(folder: Path, names: Sequence[str], bake: Path) -> None:
    """Write down, before they are there, which files an export makes, and remove what is left of another bake.

    Files that an earlier export of the same bake made stay, and stay listed.

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
    digest, earlier = bake_digest(bake), _listed(folder)
    stale = [name for name, of in earlier.items() if of != digest and name not in (*names, NAME)]
    files = {name: of for name, of in earlier.items() if of == digest} | dict.fromkeys((*names, NAME), digest)
    for name in stale:
        (folder / name).unlink(missing_ok=True)
    record = {"version": skinbake.__version__, "bake": str(bake.resolve()), "files": dict(sorted(files.items()))}
    write_text(folder / NAME, json.dumps(record, indent=1) + "\n")


def _listed(folder: Path) -> dict[str, str]:
    """Files that the last export's list names, and the bake of each; none where there is no list, or a damaged one."""
    try:
        files = json.loads((folder / NAME).read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    plain = isinstance(files, dict) and all(Path(name).name == name for name in files)  # nothing outside the folder
    return {name: str(of) for name, of in files.items()} if plain else {}
