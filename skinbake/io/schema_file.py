"""skinbake.schema.json beside looks, with which editors complete and check them; it needs no network."""

from __future__ import annotations

import json
from pathlib import Path

from skinbake.io.atomic import write_text
from skinbake.scene.schema import TITLE

NAME = "skinbake.schema.json"
HEADER = f"# yaml-language-server: $schema={NAME}"


def keep_schema(folder: Path, text: str) -> bool:
    """Write the schema into a folder of looks, over an older one; False where a file of others has its name.

    Parameters
    ----------
    folder : Path
    text : str
        JSON.

    Raises
    ------
    InputError, MachineError
        As `write_text`.
    """
    path = folder / NAME
    try:
        before = path.read_text(encoding="utf-8") if path.exists() else ""
        if before and json.loads(before)["title"] != TITLE:
            return False
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False
    if before != text:
        write_text(path, text)
    return True
