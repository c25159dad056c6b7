"""batch.png: the picture, name and error of each look on one sheet."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import printable
from skinbake.io.figures import png_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    columns = columns or math.ceil(math.sqrt(len(cells)))
    rows = math.ceil(len(cells) / columns)
    pictures = [_read(cell.picture) for cell in cells]
    aspect = next((image.shape[0] / image.shape[1] for image in pictures if image is not None), 1.25)
    width = min(CELL_PX, (SHEET_PX - GAP_PX) // columns - GAP_PX)
    height = round(width * aspect)
    size = (GAP_PX + columns * (width + GAP_PX), GAP_PX + rows * (height + CAPTION_PX + GAP_PX))
    with png_figure(path, DPI, figsize=(size[0] / DPI, size[1] / DPI), facecolor=BACKGROUND) as figure:
        for i, (cell, image) in enumerate(zip(cells, pictures, strict=True)):
            left = GAP_PX + i % columns * (width + GAP_PX)
            top = GAP_PX + i // columns * (height + CAPTION_PX + GAP_PX)
            place = left / size[0], 1 - (top + height) / size[1], width / size[0], height / size[1]
            _draw_cell(figure, cell, image, place, width / CELL_PX, size[1])


def _draw_cell(
    figure: Figure,
    cell: Cell,
    image: NDArray[np.floating] | None,
    place: tuple[float, float, float, float],
    scale: float,
    height_px: int,
) -> None:
    """Draw a look's picture, or why there is none, and its caption.

    Parameters
    ----------
    figure : Figure
    cell : Cell
    image : ndarray of shape (h, w, channels) or None
    place : tuple of 4 floats
        Left, bottom, width and height of the picture, in shares of the sheet.
    scale : float
        Size of the text.
    height_px : int
        Of the sheet.
    """
    from matplotlib.patches import Rectangle

    axes = figure.add_axes(place)
    axes.set_axis_off()
    note, colour = printable(cell.note), BAD if cell.failed else FAINT
    if image is None:
        axes.add_patch(Rectangle((0, 0), 1, 1, color=EMPTY, transform=axes.transAxes))
        text = textwrap.fill(note, 34, max_lines=12)
        axes.text(
            0.5, 0.5, text, color=colour, fontsize=9 * scale, parse_math=False, ha="center", va="center",
            transform=axes.transAxes,
        )  # fmt: skip
        note = "failed" if cell.failed else ""
    else:
        axes.imshow(image, interpolation="antialiased")
    for text, down_px, shade, points in (
        (printable(cell.name), 17, TEXT, 10),
        (textwrap.shorten(note, 52), 34, colour, 8),
    ):
        y = place[1] - down_px * scale / height_px
        figure.text(place[0], y, text, color=shade, fontsize=points * scale, parse_math=False)


def _read(path: Path | None) -> NDArray[np.floating] | None:
    """Pixels of a picture, None where there is none."""
    from PIL import Image

    try:
        with Image.open(path) if path is not None else nullcontext() as picture:
            return np.asarray(picture.convert("RGB")) if picture is not None else None
    except (OSError, SyntaxError, ValueError):  # none there, or no picture: its cell stays empty
        return None
