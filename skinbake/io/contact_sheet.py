"""batch.png: the picture, name and error of each look on one sheet."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.io.atomic import atomic_write

DPI = 100
CELL_PX, SHEET_PX = 360, 3200  # width of a cell, and what the sheet's width may grow to
CAPTION_PX, GAP_PX = 46, 10
BACKGROUND, EMPTY = "#232425", "#2e2f31"  # the preview's own background, and a shade above it
TEXT, FAINT, BAD = "#e8e6e3", "#a5a39f", "#ff8f7a"


@dataclass(frozen=True)
class Cell:
    """One look of the sheet.

    Attributes
    ----------
    name : str
    picture : Path or None
        May also be a file that is not there; `note` then says why.
    note : str
    failed : bool
    """

    name: str
    picture: Path | None
    note: str
    failed: bool = False


def write_contact_sheet(path: Path | str, cells: Sequence[Cell], columns: int | None = None) -> None:
    """Write the sheet as PNG.

    Parameters
    ----------
    path : path
    cells : sequence of Cell
    columns : int, optional
        Cells a row; about square unless given.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    columns = columns or math.ceil(math.sqrt(len(cells)))
    rows = math.ceil(len(cells) / columns)
    pictures = [_read(cell.picture) for cell in cells]
    aspect = next((image.shape[0] / image.shape[1] for image in pictures if image is not None), 1.25)
    width = min(CELL_PX, (SHEET_PX - GAP_PX) // columns - GAP_PX)
    height = round(width * aspect)
    size = (GAP_PX + columns * (width + GAP_PX), GAP_PX + rows * (height + CAPTION_PX + GAP_PX))
    scale = width / CELL_PX
    figure = pyplot.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, facecolor=BACKGROUND)
    for i, (cell, image) in enumerate(zip(cells, pictures, strict=True)):
        left = GAP_PX + i % columns * (width + GAP_PX)
        top = GAP_PX + i // columns * (height + CAPTION_PX + GAP_PX)
        axes = figure.add_axes((left / size[0], 1 - (top + height) / size[1], width / size[0], height / size[1]))
        axes.set_axis_off()
        note = cell.note
        if image is None:
            axes.add_patch(pyplot.Rectangle((0, 0), 1, 1, color=EMPTY, transform=axes.transAxes))
            axes.text(
                0.5,
                0.5,
                textwrap.fill(cell.note, 34, max_lines=12),
                ha="center",
                va="center",
                color=BAD if cell.failed else FAINT,
                fontsize=9 * scale,
                transform=axes.transAxes,
            )
            note = "failed" if cell.failed else ""
        else:
            axes.imshow(image, interpolation="antialiased")
        y = 1 - (top + height) / size[1]
        for text, down, colour, points in (
            (cell.name, 17, TEXT, 10),
            (textwrap.shorten(note, 52), 34, BAD if cell.failed else FAINT, 8),
        ):
            figure.text(left / size[0], y - down * scale / size[1], text, color=colour, fontsize=points * scale)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=DPI, facecolor=BACKGROUND, metadata={"Software": "skinbake"})
    pyplot.close(figure)


def _read(path: Path | None) -> NDArray[np.floating] | None:
    """Pixels of a picture, None where there is none."""
    from matplotlib import image

    try:
        return np.asarray(image.imread(path)) if path is not None else None
    except (OSError, SyntaxError, ValueError):  # none there, or no picture: its cell stays empty
        return None
