"""One HTML page that draws a bake with the preview's own shaders, in any current browser, without a network."""

from __future__ import annotations

from pathlib import Path

from skinbake.io.atomic import write_text
from skinbake.page import bake_page

NAME = "head.html"


def write_web(folder: Path, target: Path) -> dict[str, float]:
    """Write `head.html`, and give the rms error of the coding of each kind of texture, relative to its values.

    Parameters
    ----------
    folder : Path
        A bake folder.
    target : Path

    Raises
    ------
    InputError
        A file of the bake is missing or damaged, or the folder cannot be written to.
    MachineError
        Disk full.
    """
    page, coding = bake_page(folder)
    write_text(target / NAME, page)
    return coding
