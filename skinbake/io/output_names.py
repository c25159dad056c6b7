"""Names of the files of a bake folder, and files that a command must not write over: its own inputs, other people's."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from skinbake.errors import InputError

MANIFEST = "bake.json"
FIT_FILES = ("profile.json", "profile.csv", "profile.png")  # in the order of their writing
PICTURE, PICTURE_KEY = "preview.png", ".preview"
MESH = "mesh.obj"
RELIGHT = ("relight.exr", "relight.visibility.exr", "relight.json")
SOFTWARE = "skinbake"  # what our pictures and meshes say they were made with
_TEXTURES = r"(irradiance|lobe_\d+|transmission|relight)(\.[A-Za-z0-9_-]+)?(\.\d{4})?\.(exr|tx)"
_OTHERS = (*FIT_FILES, PICTURE, PICTURE_KEY, MESH, MANIFEST, RELIGHT[-1])
_OUTPUT = re.compile("|".join([_TEXTURES, *map(re.escape, _OTHERS)]))
_BEGIN_BYTES = 1 << 18  # of a file, in which the headers of all its parts are
_MARKS = {  # by the end of a name, what the file begins with, or has in its header, if it is ours
    ".exr": rb"(?s).*skinbake:",
    ".tx": rb"(?s).*skinbake:",
    ".png": rb"(?s).*tEXtSoftware\0skinbake",
    ".obj": rb"# skinbake",
    ".csv": rb"r_mm,R,G,B,fit_R,fit_G,fit_B",
    "relight.json": rb'\{\s*"basis"',
    "profile.json": rb'\{\s*"variance_mm2"',
    MANIFEST: rb'(?s).*"(version|config|inputs|lobes)"',  # damaged state of our own is made anew
    PICTURE_KEY: rb"",
}


def is_output(name: str) -> bool:
    """Whether a bake may write a file of this name into its folder."""
    return _OUTPUT.fullmatch(name) is not None


def refuse_inputs(outputs: Iterable[Path | str], inputs: Iterable[Path | str]) -> None:
    """Stop before a command writes over a file that it reads, under whatever name and through whatever link.

    Parameters
    ----------
    outputs, inputs : iterable of path

    Raises
    ------
    InputError
        An output is there, and is one of the inputs.
    """
    read = {identity: path for path in inputs if (identity := _identity(path)) is not None}
    for path in outputs:
        if (identity := _identity(path)) in read:
            raise InputError(
                f"{read[identity]}: expected inputs that the command does not write over, got the name of its output "
                f"{path}; choose another one"
            )


def refuse_foreign(paths: Iterable[Path]) -> None:
    """Stop before something is written over a file that we have not made.

    A file of ours is told by what it begins with, even if it was cut short; an empty one holds nothing to lose.

    Parameters
    ----------
    paths : iterable of Path
        What will be written.

    Raises
    ------
    InputError
        A file is there that is somebody else's.
    """
    for path in paths:
        if not _made_here(path):
            raise InputError(
                f"{path}: expected a file of an earlier bake or none, got one that skinbake has not written; move it "
                "away, or choose another output.dir, or --out"
            )


def _made_here(path: Path) -> bool:
    """Whether a file is ours, empty, or not there."""
    mark = _MARKS.get(path.name) or _MARKS.get(path.suffix)
    try:
        with open(path, "rb") as file:
            begin = file.read(_BEGIN_BYTES)
    except OSError:  # not there, or not to be read: whoever writes there hears of it
        return True
    return not begin or mark is None or re.match(mark, begin) is not None


def _identity(path: Path | str) -> tuple[int, int] | None:
    """Which file a path leads to; None where there is none."""
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino
