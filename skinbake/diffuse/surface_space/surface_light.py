"""Light on the skin, ready to be summed: each tile's skin points, what arrives there, and the moments of its blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled, Tiles
from skinbake.diffuse.surface_space.clusters import MomentPyramid, moment_pyramid
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.numerics import Zeros


class LitTile(NamedTuple):
    """Skin and light of one tile.

    Attributes
    ----------
    points : TexelPoints
    radiosity : ndarray of shape (L, H * W, 3), float32
        By flat texel.
    pyramid : MomentPyramid
    """

    points: TexelPoints
    radiosity: NDArray[np.float32]
    pyramid: MomentPyramid


def surface_light(
    source: Tiles, points: Tiled[TexelPoints], zeros: Zeros = np.zeros, same: Tiled[MomentPyramid] | None = None
) -> Tiled[LitTile]:
    """Points, light and moments of each tile; the light, (L, H, W, 3) a tile, is not copied.

    Parameters
    ----------
    source : Tiles
    points : TexelPoints of each tile
    zeros : callable, optional
        Makes the moments' arrays.
    same : Tiled of MomentPyramid, optional
        Of other light on the same points: their moments are taken.
    """
    lit = {}
    for tile, values in source.items():
        flat = values.reshape(len(values), -1, 3)
        pyramid = moment_pyramid(points[tile], flat, zeros, same[tile] if same else None)
        lit[tile] = LitTile(points[tile], flat, pyramid)
    return lit


def sums_texels(variance_mm2: float, spacing: float, mean_texel_mm2: float) -> bool:
    """Whether a lobe is so narrow that most texels would be clusters by themselves: then every texel is a source.

    Parameters
    ----------
    variance_mm2 : float
        Of the lobe.
    spacing : float
        Side of the widest cluster, in sigma of the lobe; 0 keeps every texel.
    mean_texel_mm2 : float
        Skin in a texel.
    """
    return spacing**2 / 12 * variance_mm2 < mean_texel_mm2 / 8  # half of the spread of four texels
