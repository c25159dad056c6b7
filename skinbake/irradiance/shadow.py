"""Share of a light that reaches each texel."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.irradiance.emitter import aim
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.surface import TexelSurface
from skinbake.numerics import Float

Image = NDArray[np.float32]
EDGE_GRID = 4  # rays along each side of a texel that a shadow's edge crosses
CHUNK = 1 << 20  # rays in memory at a time


def visibility(surface: TexelSurface, occluder: Occluder, source: Float, facing: NDArray[np.bool_]) -> Image:
    """Unshadowed share of a light of one direction, shape (H, W); 0 where the skin faces away.

    One ray a texel, coarse; then `EDGE_GRID`^2 rays in every texel that differs from one of its eight neighbours. An
    edge is thus resolved to a sixteenth of a texel, and only a feature narrower than a texel can be missed.
    """
    height, width = facing.shape
    lit = np.zeros((height, width), np.float32)
    flat = lit.reshape(-1)
    origin = surface.origin.reshape(-1, 3)
    texels = np.flatnonzero(facing)
    for start in range(0, len(texels), CHUNK):
        part = texels[start : start + CHUNK]
        flat[part] = _clear(occluder, source, origin[part])

    edges = np.flatnonzero(_differs(lit, facing))
    refined = np.empty(len(edges), np.float32)
    step = CHUNK // EDGE_GRID**2
    for start in range(0, len(edges), step):
        part = edges[start : start + step]
        inside = surface.origins_inside(part, EDGE_GRID)
        clear = _clear(occluder, source, inside.reshape(-1, 3))
        refined[start : start + step] = clear.reshape(len(part), -1).mean(axis=1, dtype=np.float64)
    flat[edges] = refined
    return lit


def _clear(occluder: Occluder, source: Float, origin: Image) -> NDArray[np.bool_]:
    direction, reach = np.empty_like(origin), np.empty(len(origin), np.float32)
    aim(source, origin, direction, reach)
    return ~occluder.occluded(origin, direction, reach)


@njit(cache=True, parallel=True)
def _differs(lit: Image, facing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    height, width = facing.shape
    out = np.zeros((height, width), dtype=np.bool_)
    for row in prange(height):
        for col in range(width):
            if not facing[row, col]:
                continue
            for r in range(max(row - 1, 0), min(row + 2, height)):
                for c in range(max(col - 1, 0), min(col + 2, width)):
                    if facing[r, c] and lit[r, c] != lit[row, col]:
                        out[row, col] = True
    return out
