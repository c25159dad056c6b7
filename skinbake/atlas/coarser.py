"""Atlas of fewer texels, for what is smooth on the skin."""

from __future__ import annotations

import numpy as np

from skinbake.atlas.metric import face_mm_per_texel
from skinbake.atlas.raster import Atlas
from skinbake.atlas.rasterize import rasterize
from skinbake.scene.mesh import SkinMesh

LEAST_GUTTER = 2  # texels: bilinear reading meets one


def coarser_size(mesh: SkinMesh, size: tuple[int, int], texel_mm: float) -> tuple[int, int]:
    """Width and height of a texture whose texels are about so wide, a whole number of the full one's.

    Parameters
    ----------
    mesh : SkinMesh
    size : (width, height)
        Of the full texture, the largest that comes back.
    texel_mm : float
    """
    full_mm = float(np.median(face_mm_per_texel(mesh, size).max(axis=1)))
    coarse = max(1, min(round(texel_mm / max(full_mm, 1e-6)), min(size)))
    return max(1, -(-size[0] // coarse)), max(1, -(-size[1] // coarse))


def limited_size(size: tuple[int, int], longest: int) -> tuple[int, int]:
    """Width and height in the same proportion, the longer one no longer than so many texels."""
    longer = min(longest, max(size))
    return max(1, round(size[0] * longer / max(size))), max(1, round(size[1] * longer / max(size)))


def coarser_atlas(mesh: SkinMesh, size: tuple[int, int], gutter: int, udim: bool, small: tuple[int, int]) -> Atlas:
    """Raster of a smaller size, with a gutter as wide on the skin.

    Parameters
    ----------
    mesh : SkinMesh
    size : (width, height)
        Of the full texture.
    gutter : int
        In its texels.
    udim : bool
    small : (width, height)
    """
    return rasterize(mesh, small, max(LEAST_GUTTER, gutter * small[0] // size[0]), udim)
