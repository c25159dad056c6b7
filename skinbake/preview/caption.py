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


def caption(lines: Sequence[str], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Ink of each pixel, 0 ... 255, shape (height, width), row 0 at the top; `size` is (width, height)."""
    from PIL import Image, ImageDraw

    width, height = size
    picture = Image.new("L", (width, height), 0)
    pen = ImageDraw.Draw(picture)
    for row, line in enumerate(lines):
        pen.text((MARGIN_PIXELS, MARGIN_PIXELS + LINE_PIXELS * row), line, fill=255, font=_font())
    return np.asarray(picture)


@lru_cache(maxsize=1)
def _font() -> Any:
    from PIL import ImageFont

    package = find_spec("pyrender")
    assert package is not None
    assert package.origin is not None
    return ImageFont.truetype(str(Path(package.origin).parent / "fonts" / "OpenSans-Regular.ttf"), FONT_POINTS)
