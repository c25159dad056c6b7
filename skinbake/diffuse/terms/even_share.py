"""Light through thin parts is part of what skin sends back in even light: what that leaves to the lobes, and to itself.

The gain that form has holds it already, and it is taken off there; and no more comes through than is left of what
arrives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.terms.curvature import CurvedSkin
from skinbake.diffuse.terms.far_side import in_parts
from skinbake.diffuse.terms.flesh_rays import gathered, through_along
from skinbake.diffuse.terms.thin_parts import ThinParts, read_weights
from skinbake.diffuse.terms.transmission import along_rays, carried_already
from skinbake.numerics import Float, safe_div

Image = NDArray[np.float32]
LEAST = 1e-6  # albedo, and share of the light that scatters


class EvenShare(NamedTuple):
    """How even light is parted between the lobes and light through thin parts.

    Attributes
    ----------
    of_gain : dict of int to ndarray of shape (h, w, 3), or None
        By tile: what transmitted light adds of the gain that form has, where form is counted.
    kept : list of ndarray of shape (L or 1, n, 3)
        Of each tile: share of transmitted light with which no more leaves than arrives.
    """

    of_gain: dict[int, Image] | None
    kept: list[Image]


def part_even_light(
    diffused: DiffuseMap,
    thin: ThinParts,
    curved: CurvedSkin | None,
    enters: Sequence[Image],
    weights: SkinWeights,
    scatter: float,
    times: Float | None = None,
) -> EvenShare:
    """What the lobes have to leave to light through thin parts, and what is kept of that.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance.
    thin : ThinParts
    curved : CurvedSkin, optional
        Where it changes lobes.
    enters, weights, scatter, times
        As of `kept_through`.
    """
    of_gain = even_share(diffused, thin, curved) if curved else None
    gain = curved.left(of_gain) if curved else None
    return EvenShare(of_gain, kept_through(diffused, thin, enters, weights, scatter, gain, times))


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


def kept_through(
    diffused: DiffuseMap,
    thin: ThinParts,
    enters: Sequence[Image],
    weights: SkinWeights,
    scatter: float,
    gain: Mapping[int, Image] | None = None,
    times: Float | None = None,
) -> list[Image]:
    """Share of transmitted light with which no more leaves in even light than arrives, (L or 1, n, 3) a tile.

    Paint may be lighter than the medium that lets light through, and what comes through small bodies that hardly
    absorb is known less well than how little they keep.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance.
    thin : ThinParts
    enters : sequence of ndarray of shape (h, w, 3) or (1, 1, 3)
        Of its tiles: what is blurred of even light of 1, its incidence and the albedo.
    weights : SkinWeights
        Of the lobes.
    scatter : float
        Weight of transmitted light.
    gain : mapping of int to ndarray of shape (h, w, 3), optional
        By tile: what is left to the lobes of what they send back over what a plane does (`CurvedSkin.left`).
    times : ndarray of shape (L, N, 3), optional
        As of `transmit`: each light has its share then.
    """
    found = []
    for (raster, rows, cols, far), light in zip(thin.tiles, enters, strict=True):
        back = weights.total_image(raster.tile, raster.shape)
        if gain is not None:
            back = back * magnify_bilinear(gain[raster.tile], raster.shape)
        light, back = (np.broadcast_to(each, (*raster.shape, 3))[rows, cols] for each in (light, back))
        room = np.maximum(1 / np.maximum(light, LEAST) - back, 0) / max(scatter, LEAST)
        kept = np.ones((1 if times is None else len(times), len(rows), 3), np.float32)
        for some, there in in_parts(len(rows), far):
            along = along_rays(thin, there)
            if (gathered(along) > room[some]).any():  # else nothing is too much
                for k, of_light in enumerate([None] if times is None else times):
                    brought = gathered(np.maximum(along - carried_already(diffused, thin, there, of_light), 0))
                    kept[k, some] = np.where(brought > room[some], safe_div(room[some], brought), 1)
        found.append(kept)
    return found


def hold_back(through: Lobe, thin: ThinParts, kept: Sequence[Image]) -> None:
    """Leave of transmitted light what is kept, in place.

    Parameters
    ----------
    through : Lobe
    thin : ThinParts
    kept : sequence of ndarray of shape (L or 1, n, 3)
        As `kept_through` gives it.
    """
    for (raster, rows, cols, _), share in zip(thin.tiles, kept, strict=True):
        through.rgb[raster.tile][:, rows, cols] *= share
