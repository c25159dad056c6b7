"""Texels that are asked about the sky first: one in so many along each side."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import AtlasRaster

LATTICE_MM = 4.0  # between the first texels traced: ambient light varies over what shades it, not over texels


def lattice(raster: AtlasRaster) -> int:
    """Texels, a power of two up to 32, that span `LATTICE_MM` on average, so that finer textures ask for no more
    rays.
    """
    texels, area = raster.coverage.sum(dtype=np.float64), raster.area_mm2.sum(dtype=np.float64)
    if texels == 0 or area == 0:
        return 1
    return int(2 ** np.clip(np.floor(np.log2(LATTICE_MM / np.sqrt(area / texels))), 0, 5))
