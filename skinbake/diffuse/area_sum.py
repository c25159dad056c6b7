"""Light times area, summed over the skin."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import Tiled, Tiles
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

_BLOCK = 65536  # texels


def area_sum(tiles: Tiles, points: Tiled[TexelPoints]) -> Float:
    """Sum over lights and texels of radiosity times area, (3,); in blocks, so that threads cannot change it.

    `tiles` is (L, h, w, 3) a tile, `points` are those of the same size.
    """
    total = np.zeros(3)
    for tile, rgb in tiles.items():
        here = points[tile]
        blocks = np.zeros((-(-len(here.flat_index) // _BLOCK), 3))
        light = rgb.reshape(len(rgb), -1, 3)
        parallel_for(_area_sums, len(blocks), light, here.flat_index, here.area_mm2, blocks)
        total += blocks.sum(axis=0)
    return total


@kernel
def _area_sums(first, stop, rgb, flat, area, blocks):  # type: ignore[no-untyped-def]
    """Fill the sums of each block of texels, (B, 3)."""
    for block in range(first, stop):
        begin, end = block * _BLOCK, min((block + 1) * _BLOCK, len(flat))
        # Of light after light, in variables of their own: an array's elements would wait for one another in memory
        red, green, blue = 0.0, 0.0, 0.0
        for light in range(len(rgb)):
            for i in range(begin, end):
                at, mm2 = flat[i], np.float64(area[i])
                red += mm2 * rgb[light, at, 0]
                green += mm2 * rgb[light, at, 1]
                blue += mm2 * rgb[light, at, 2]
        blocks[block, 0], blocks[block, 1], blocks[block, 2] = red, green, blue
