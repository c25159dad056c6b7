"""Light through thin parts is part of what skin of their form sends back in even light: it is taken off the lobes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.diffuse_map import DiffuseMap
from skinbake.diffuse.terms.curvature import CurvedSkin
from skinbake.diffuse.terms.flesh_rays import gathered, through_along
from skinbake.diffuse.terms.thin_parts import ThinParts, read_weights
from skinbake.diffuse.terms.transmission import along_rays, carried_already
from skinbake.numerics import safe_div

Image = NDArray[np.float32]


def even_share(diffused: DiffuseMap, thin: ThinParts, curved: CurvedSkin) -> dict[int, Image]:
    """What `transmit` adds of the gain that form has in even light, as a share of what a plane sends back, (h, w, 3).

    The gain has light from the other side as diffusion theory knows it, which is too dark. That is taken out whole, so
    that what stays with the lobes is of their own side, and all of them send back what walks through a slab say.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance.
    thin : ThinParts
    curved : CurvedSkin
        Whose gain it is.

    Returns
    -------
    dict of int to ndarray
        By tile.
    """
    total, found = thin.gaussians.weight_rgb.sum(axis=0), {}
    in_gain = through_along(thin.weights.thickness_mm, curved.through_slabs(thin.weights.thickness_mm))
    for raster, rows, cols, far in thin.tiles:
        image = np.zeros((*raster.shape, 3), np.float32)
        along, carried = along_rays(thin, far), carried_already(diffused, thin, far)
        # Of the gain, lobes that carry light through the flesh keep that: what is added is the rest
        kept = gathered(np.minimum(along, carried))
        image[rows, cols] = gathered(read_weights(thin.weights, in_gain, far)) - safe_div(kept, total)
        found[raster.tile] = image
    return found
