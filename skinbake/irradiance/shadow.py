"""Unshadowed share of a light of one direction at each texel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.punctual_light import DIRECTIONAL, aim
from skinbake.irradiance.surface import TexelSurface
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

Image = NDArray[np.float32]
EDGE_GRID = 4  # rays along each side of a texel that a shadow's edge crosses
CHUNK = 1 << 20  # rays in memory at a time


def visibility(surface: TexelSurface, occluder: Occluder, source: Float, facing: NDArray[np.bool_]) -> Image:
    """Unshadowed share of a directional, point or spot light, shape (H, W); 0 where the skin faces away.

    Coarse to fine: one ray in every second texel of every second row; then in the texels between, unless all of the
    first ones within two texels agree; then `EDGE_GRID`^2 rays in every texel that differs from one of its eight
    neighbours. An edge is thus resolved to a sixteenth of a texel, and only a feature narrower than two texels, with
    none of its edges seen anywhere near, can be missed. Texels behind cards of hair have all of these rays, for strands
    are narrower than texels.

    Parameters
    ----------
    surface : TexelSurface
    occluder : Occluder
    source : ndarray of shape (10,)
        As `emitter` makes it.
    facing : ndarray of shape (H, W)
        Texels that face the light.
    """
    height, width = facing.shape
    lit = np.zeros((height, width), np.float32)
    flat = lit.reshape(-1)

    def trace(texels: NDArray[np.int64]) -> None:
        for start in range(0, len(texels), CHUNK):
            part = texels[start : start + CHUNK]
            flat[part] = _clear(occluder, source, surface.origins(part))

    rows, cols = np.nonzero(facing[::2, ::2])
    trace(2 * rows * width + 2 * cols)
    unknown, differs = np.zeros((2, height, width), np.bool_)
    parallel_for(_fill_between, height, facing, lit, unknown)
    trace(np.flatnonzero(unknown))

    parallel_for(_differs, height, lit, facing, differs)
    if occluder.has_cards:
        texels = np.flatnonzero(facing)
        for start in range(0, len(texels), CHUNK):
            part = texels[start : start + CHUNK]
            differs.reshape(-1)[part] |= occluder.behind_cards(*_rays(source, surface.origins(part)))
    edges = np.flatnonzero(differs)
    refined = np.empty(len(edges), np.float32)
    step = CHUNK // EDGE_GRID**2
    for start in range(0, len(edges), step):
        part = edges[start : start + step]
        inside = surface.origins_inside(part, EDGE_GRID)
        clear = _clear(occluder, source, inside.reshape(-1, 3))
        refined[start : start + step] = clear.reshape(len(part), -1).mean(axis=1, dtype=np.float64)
    flat[edges] = refined
    return lit


def _clear(occluder: Occluder, source: Float, origin: Image) -> NDArray[Any]:
    """Share of the light that reaches each origin (n, 3), shape (n,)."""
    return occluder.unhindered(*_rays(source, origin))


def _rays(source: Float, origin: Image) -> tuple[Image, Image, NDArray[np.float32]]:
    """Origins (n, 3), directions to the light (n, 3) or (1, 3), and distances (n,) of rays, as `Occluder` has them."""
    if source[0] == DIRECTIONAL:
        return origin, source[None, 1:4].astype(np.float32), np.full(len(origin), np.inf, np.float32)
    direction, reach = np.empty_like(origin), np.empty(len(origin), np.float32)
    parallel_for(aim, len(origin), source, origin, direction, reach)
    return origin, direction, reach


@kernel
def _fill_between(first: int, stop: int, facing: NDArray[np.bool_], lit: Image, unknown: NDArray[np.bool_]) -> None:
    """Fill texels between traced ones that agree, in `lit` (H, W); mark those where they do not in `unknown` (H, W).

    Parameters
    ----------
    first, stop : int
        Rows.
    facing, lit, unknown : ndarrays of shape (H, W)
    """
    height, width = facing.shape
    for row in range(first, stop):
        for col in range(width):
            if not facing[row, col] or (row % 2 == 0 and col % 2 == 0):
                continue
            low, high, known = np.float32(1.0), np.float32(0.0), True
            # Traced texels within two rows and columns: those of even address
            for r in range(row - 2 + row % 2, row + 3, 2):
                for c in range(col - 2 + col % 2, col + 3, 2):
                    if r < 0 or c < 0 or r >= height or c >= width or not facing[r, c]:
                        known = False
                    else:
                        low, high = min(low, lit[r, c]), max(high, lit[r, c])
            if known and low == high:
                lit[row, col] = low
            else:
                unknown[row, col] = True


@kernel
def _differs(first: int, stop: int, lit: Image, facing: NDArray[np.bool_], out: NDArray[np.bool_]) -> None:
    """Mark texels whose share differs from that of one of their eight neighbours.

    Parameters
    ----------
    first, stop : int
        Rows.
    lit, facing, out : ndarrays of shape (H, W)
    """
    height, width = facing.shape
    for row in range(first, stop):
        for col in range(width):
            if not facing[row, col]:
                continue
            for r in range(max(row - 1, 0), min(row + 2, height)):
                for c in range(max(col - 1, 0), min(col + 2, width)):
                    if facing[r, c] and lit[r, c] != lit[row, col]:
                        out[row, col] = True
