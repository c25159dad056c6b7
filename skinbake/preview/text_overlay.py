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


def overlay_text(lines: Sequence[str], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Text on a plate, shape (height, width, 2), 0 ... 255: the ink, and the plate that darkens what lies behind.

    `size` is (width, height); row 0 is at the top.
    """
    from PIL import Image, ImageDraw

    ink, plate = Image.new("L", size, 0), Image.new("L", size, 0)
    pen = ImageDraw.Draw(ink)
    at = [(MARGIN_PIXELS, MARGIN_PIXELS + LINE_PIXELS * row) for row in range(len(lines))]
    for corner, line in zip(at, lines, strict=True):
        pen.text(corner, line, fill=255, font=_font())
    widest = max((pen.textlength(line, font=_font()) for line in lines), default=0.0)
    right, bottom = 1.5 * MARGIN_PIXELS + widest, 1.5 * MARGIN_PIXELS + LINE_PIXELS * len(lines)
    ImageDraw.Draw(plate).rectangle((MARGIN_PIXELS / 2, MARGIN_PIXELS / 2, right, bottom), fill=140)
    return np.stack([np.asarray(ink), np.asarray(plate)], axis=-1)


@lru_cache(maxsize=1)
def _font() -> Any:
    from PIL import ImageFont

    package = find_spec("pyrender")
    assert package is not None
    assert package.origin is not None
    return ImageFont.truetype(str(Path(package.origin).parent / "fonts" / "OpenSans-Regular.ttf"), FONT_POINTS)
