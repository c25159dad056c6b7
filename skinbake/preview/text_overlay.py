"""Lines of text as a picture, in the typeface that comes with pyrender.

pyrender's own `render_text` fails on a space with current FreeType bindings (it takes the empty glyph for a picture).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FONT_POINTS = 14
LINE_PIXELS = 20
MARGIN_PIXELS = 12
COLUMN_PIXELS = 18  # between columns


def overlay_text(lines: Sequence[str]) -> NDArray[np.uint8]:
    """Text on a plate, shape (height, width, 2), 0 ... 255: the ink, and the plate that darkens what lies behind.

    Row 0 is at the top. What tabs part in a line stands in columns, which all lines share that have tabs.
    """
    from PIL import Image, ImageDraw

    font = _font()
    rows = [line.split("\t") for line in lines]
    tabbed = [row for row in rows if len(row) > 1]
    columns = [MARGIN_PIXELS]
    for column in range(max(map(len, tabbed), default=1) - 1):
        widest = max(font.getlength(row[column]) for row in tabbed if column < len(row) - 1)
        columns.append(columns[-1] + round(widest) + COLUMN_PIXELS)
    ends = [columns[len(row) - 1] + font.getlength(row[-1]) for row in rows]
    size = (round(max(ends, default=0.0)) + MARGIN_PIXELS, 2 * MARGIN_PIXELS + LINE_PIXELS * len(lines))
    ink, plate = Image.new("L", size, 0), Image.new("L", size, 0)
    pen = ImageDraw.Draw(ink)
    for number, row in enumerate(rows):
        for left, cell in zip(columns, row, strict=False):
            pen.text((left, MARGIN_PIXELS + LINE_PIXELS * number), cell, fill=255, font=font)
    edge = MARGIN_PIXELS / 2
    ImageDraw.Draw(plate).rectangle((edge, edge, size[0] - edge, size[1] - edge), fill=140)
    return np.stack([np.asarray(ink), np.asarray(plate)], axis=-1)


@lru_cache(maxsize=1)
def _font() -> Any:
    from PIL import ImageFont

    package = find_spec("pyrender")
    assert package is not None
    assert package.origin is not None
    return ImageFont.truetype(str(Path(package.origin).parent / "fonts" / "OpenSans-Regular.ttf"), FONT_POINTS)
