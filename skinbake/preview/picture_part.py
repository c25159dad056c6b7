"""Parts of a picture that is too large to be drawn at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from skinbake.errors import MachineError
from skinbake.machine import physical_memory_bytes
from skinbake.numerics import Float

MOST_POINTS_A_SIDE = 4096  # of a part: 268 MB of colours as floats
BYTES_A_PIXEL = 60  # of the picture, its background, what is tone-mapped and written
MEMORY_SHARE = 0.6


@dataclass(frozen=True)
class PicturePart:
    """A rectangle of a picture's points; x grows right and y up, from the lower left corner.

    Attributes
    ----------
    whole : (int, int)
        Points of the whole picture, (width, height).
    at : (int, int)
        Lower left corner of the part.
    size : (int, int)
        (width, height) of the part; what lies beyond the whole is drawn and left out.
    """

    whole: tuple[int, int]
    at: tuple[int, int]
    size: tuple[int, int]

    def projection(self, of_whole: Float) -> Float:
        """Projection matrix of the part, given that of the whole, shape (4, 4); the same where the part is all."""
        crop = np.eye(4)
        for axis in range(2):
            crop[axis, axis] = self.whole[axis] / self.size[axis]
            crop[axis, 3] = (self.whole[axis] - 2 * self.at[axis] - self.size[axis]) / self.size[axis]
        return of_whole if (crop == np.eye(4)).all() else crop @ of_whole


def parts_of(size: tuple[int, int], supersample: int, largest: int) -> Iterator[PicturePart]:
    """Parts that cover a picture, all of one size; one alone where it is small.

    Parameters
    ----------
    size : (int, int)
        (width, height) in pixels.
    supersample : int
        Points a pixel along each side; a part has whole pixels.
    largest : int
        Points a side that OpenGL allows.
    """
    whole = (size[0] * supersample, size[1] * supersample)
    most = max(min(MOST_POINTS_A_SIDE, largest) // supersample, 1) * supersample
    part = (min(whole[0], most), min(whole[1], most))
    for y in range(0, whole[1], part[1]):
        for x in range(0, whole[0], part[0]):
            yield PicturePart(whole, (x, y), part)


def refuse_picture_too_large(size: tuple[int, int], pictures: int = 1) -> None:
    """Refuse a picture that this machine's memory does not hold.

    Parameters
    ----------
    size : (int, int)
        (width, height) in pixels.
    pictures : int
        Side by side.

    Raises
    ------
    MachineError
        With the size that it would hold.
    """
    needed, there = size[0] * size[1] * pictures * BYTES_A_PIXEL, MEMORY_SHARE * physical_memory_bytes()
    if needed > there:
        factor = (there / needed) ** 0.5
        raise MachineError(
            f"a picture of {size[0]} x {size[1]} needs about {needed / 2**30:.1f} GiB; "
            f"this machine has room for one of {int(size[0] * factor)} x {int(size[1] * factor)}"
        )
