"""Numbers of the frames of a sequence, as a look gives them."""

from __future__ import annotations

import re
from typing import Any

MOST_FRAMES = 10_000
_RANGE = re.compile(r"\s*(\d{1,6})\s*(?:-\s*(\d{1,6})\s*(?:x\s*(\d{1,6})\s*)?)?")
EXPECTED = "expected frames such as 7, 1-24, 1-24x2 (every second one) or 1-8,12"


def frame_numbers(value: Any) -> tuple[int, ...]:
    """Frames in their order: of a number, of text such as `1-24`, `1-24x2` or `1-8,12`, or of a list of these.

    Raises
    ------
    ValueError
        It is none of these, has no frame, one twice, or more than 10,000.
    """
    if isinstance(value, bool) or not isinstance(value, int | str | list | tuple):
        raise ValueError(EXPECTED)
    if isinstance(value, list | tuple):
        if any(isinstance(each, list | tuple) for each in value):
            raise ValueError(EXPECTED)
        found = [number for each in value for number in frame_numbers(each)]
    else:
        found = []
        for part in str(value).split(","):
            match = _RANGE.fullmatch(part)
            if match is None:
                raise ValueError(EXPECTED)
            first, step = int(match[1]), int(match[3] or 1)
            if not step:
                raise ValueError(EXPECTED)
            found += range(first, int(match[2] or first) + 1, step)
            if len(found) > MOST_FRAMES:
                break
    if not found:
        raise ValueError(f"{EXPECTED}, got none")
    if len(found) > MOST_FRAMES:
        raise ValueError(f"expected at most {MOST_FRAMES:,} frames, got more")
    if len(set(found)) < len(found):
        twice = next(number for number in found if found.count(number) > 1)
        raise ValueError(f"expected each frame once, got {twice} twice")
    return tuple(found)
