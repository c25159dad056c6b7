"""Which texels of an image lie on the mesh's charts, by their centres as painting programs take it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.texel_coordinates import corner_texels
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

EDGE = 1e-6  # texels beyond an edge that still count


def on_charts(mesh: SkinMesh, tile: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Texels of an image whose centre a triangle holds, of the image's shape.

    Parameters
    ----------
    mesh : SkinMesh
    tile : int
        UDIM number of the tile that the image covers.
    shape : (height, width)
        Of the image.
    """
    corner_xy = corner_texels(mesh, tile, shape)
    out = np.zeros(shape, np.bool_)
    _hold(corner_xy, out)
    return out


@kernel
def _hold(corner_xy: Float, out: NDArray[np.bool_]) -> None:
    """Set the texels whose centre lies in a triangle: row by row, from its left edge to its right one."""
    height, width = out.shape
    for f in range(len(corner_xy)):
        low = min(corner_xy[f, 0, 1], corner_xy[f, 1, 1], corner_xy[f, 2, 1])
        high = max(corner_xy[f, 0, 1], corner_xy[f, 1, 1], corner_xy[f, 2, 1])
        if not (high >= 0.0 and low <= height):
            continue
        for row in range(
            max(0, int(np.ceil(max(low, 0.0) - 0.5 - EDGE))), min(height, int(min(high, height) + 0.5) + 1)
        ):
            y = row + 0.5
            left, right = np.inf, -np.inf
            for i in range(3):
                ax, ay = corner_xy[f, i, 0], corner_xy[f, i, 1]
                bx, by = corner_xy[f, (i + 1) % 3, 0], corner_xy[f, (i + 1) % 3, 1]
                if min(ay, by) - EDGE <= y <= max(ay, by) + EDGE:
                    t = min(max((y - ay) / (by - ay), 0.0), 1.0) if by != ay else 0.0
                    x = ax + t * (bx - ax)
                    left, right = min(left, x), max(right, x)
                    if by == ay:
                        left, right = min(left, bx), max(right, bx)
            if right < 0.0 or left > width:
                continue
            for col in range(
                max(0, int(np.ceil(max(left, 0.0) - 0.5 - EDGE))), min(width, int(min(right, width) + 0.5 + EDGE))
            ):
                out[row, col] = True
