"""export.json: which files of a folder an export has made, so that no other file is ever replaced."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import skinbake
from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.io.manifest import NAME as MANIFEST

NAME = "export.json"


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
    """Write down, before they are there, which files an export makes; those of earlier exports stay listed.

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
    files = sorted({*names, *_listed(folder), NAME})
    record = {"version": skinbake.__version__, "bake": str(bake.resolve()), "files": files}
    write_text(folder / NAME, json.dumps(record, indent=1) + "\n")


def _listed(folder: Path) -> list[str]:
    """Files that the last export's list names; none where there is no list, or a damaged one."""
    try:
        files = json.loads((folder / NAME).read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return [name for name in files if isinstance(name, str)] if isinstance(files, list) else []
