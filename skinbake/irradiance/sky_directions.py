"""Directions all around, in which the sky is looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

Image = NDArray[np.float32]
DIRECTIONS = 1024  # each for the part of the sphere that is nearest to it; half of them are above a texel's horizon
_CELLS_BITS = 5  # cells along each axis by which directions are put in order: 2^5


def sky_directions() -> Image:
    """Those that texels are asked about, (D, 3); ones that follow each other are near."""
    towards = all_around(DIRECTIONS).astype(np.float32)
    return towards[_near_together(towards)]


def all_around(count: int) -> Float:
    """Unit vectors spread evenly over the sphere (Fibonacci's spiral), shape (count, 3)."""
    step = np.arange(count)
    y, turn = 1 - (2 * step + 1) / count, step * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=-1)


def _near_together(towards: Image) -> NDArray[np.int64]:
    """Order of unit directions (D, 3) in which those that follow each other are near: by an octree's cells."""
    cell = np.minimum(((towards + 1) * 2 ** (_CELLS_BITS - 1)).astype(np.int64), 2**_CELLS_BITS - 1)
    place = sum((cell[:, axis] >> bit & 1) << (3 * bit + axis) for bit in range(_CELLS_BITS) for axis in range(3))
    return np.argsort(place, kind="stable")
