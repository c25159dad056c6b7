"""Light through thin parts is part of what skin sends back in even light: what that leaves to the lobes, and to itself.

The gain that form has holds it already, and it is taken off there; and no more comes through than is left of what
arrives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster
from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.terms.curvature import CurvedSkin, bent_shape, multiply_by_gain
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
    times: Float | None = None,
    even: Sequence[Lobe] | None = None,
) -> EvenShare:
    """What the lobes have to leave to light through thin parts, and what is kept of that.

    Parameters
    ----------
    diffused : DiffuseMap
        Blurred irradiance.
    thin : ThinParts
    curved : CurvedSkin, optional
        Where it changes lobes.
    enters, weights, times, even
        As of `kept_through`.
    """
    of_gain = even_share(diffused, thin, curved) if curved else None
    return EvenShare(of_gain, kept_through(diffused, thin, enters, weights, curved, of_gain, times, even))


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
        kept = gathered(np.minimum(along, carried), thin.around)
        image[rows, cols] = gathered(read_weights(thin.weights, in_gain, far), thin.around) - safe_div(kept, total)
        found[raster.tile] = image
    return found


def kept_through(
    diffused: DiffuseMap,
    thin: ThinParts,
    enters: Sequence[Image],
    weights: SkinWeights,
    curved: CurvedSkin | None = None,
    of_gain: Mapping[int, Image] | None = None,
    times: Float | None = None,
    even: Sequence[Lobe] | None = None,
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
    curved : CurvedSkin, optional
        Where it changes lobes.
    of_gain : mapping of int to ndarray of shape (h, w, 3), optional
        By tile: what of its gain they leave (`even_share`).
    times : ndarray of shape (L, N, 3), optional
        As of `transmit`: each light has its share then.
    even : sequence of Lobe, optional
        What lobes make of even light of 1, where they take it otherwise than once.
    """
    found = []
    gain = curved.left(of_gain) if curved else None
    # Only lights that have `diffuse_profile` are taken otherwise
    otherwise = [False] if times is None else [bool((of_light != 1).any()) for of_light in times]
    for (raster, rows, cols, far), light in zip(thin.tiles, enters, strict=True):
        light = np.broadcast_to(light, (*raster.shape, 3))[rows, cols]
        room = {}
        for with_profile in set(otherwise):
            back = _sent_back(diffused.lobes, weights, raster, curved, gain, even if with_profile else None)
            back = np.broadcast_to(back, (*raster.shape, 3))[rows, cols]
            room[with_profile] = np.maximum(1 / np.maximum(light, LEAST) - back, 0) / max(thin.skin.scatter, LEAST)
        kept = np.ones((len(otherwise), len(rows), 3), np.float32)
        for some, there in in_parts(len(rows), far):
            along = along_rays(thin, there)
            if any((gathered(along, thin.around) > of[some]).any() for of in room.values()):  # else nothing is too much
                for k, of_light in enumerate([None] if times is None else times):
                    left = room[otherwise[k]][some]
                    beside = np.maximum(along - carried_already(diffused, thin, there, of_light), 0)
                    brought = gathered(beside, thin.around)
                    kept[k, some] = np.where(brought > left, safe_div(left, brought), 1)
        found.append(kept)
    return found


def _sent_back(
    lobes: Sequence[Lobe],
    weights: SkinWeights,
    raster: AtlasRaster,
    curved: CurvedSkin | None,
    gain: Mapping[int, Image] | None,
    even: Sequence[Lobe] | None,
) -> Image:
    """What lobes send back of even light of 1, (H, W, 3), or (1, 1, 3) where that is the same everywhere.

    Form counts at the texels that each is stored at, from which it is read: where one is thin and the next is not, that
    is neither the one nor the other.

    Parameters
    ----------
    lobes : sequence of Lobe
        Blurred irradiance; only their sizes count.
    weights : SkinWeights
    raster : AtlasRaster
        At whose texels.
    curved, even
        As of `kept_through`.
    gain : mapping of int to ndarray of shape (h, w, 3), optional
        What is left to them (`CurvedSkin.left`).
    """
    if gain is None and even is None:
        return weights.total_image(raster.tile, raster.shape)
    factors = curved.factors() if curved else [None] * len(lobes)
    total = np.zeros((*raster.shape, 3), np.float32)
    for i, (lobe, factor) in enumerate(zip(lobes, factors, strict=True)):
        shape = lobe.rgb[raster.tile].shape[1:3]
        if gain is not None and factor is not None:
            shape = bent_shape(lobe.rgb[raster.tile], gain[raster.tile])
        height, width = np.minimum(shape, raster.shape)
        image = np.ones((1, height, width, 3), np.float32)
        if even is not None:
            image *= magnify_bilinear(even[i].rgb[raster.tile][0], image.shape[1:3])
        if gain is not None and factor is not None:
            multiply_by_gain(gain[raster.tile], factor, image)
        total += weights.image(i, raster.tile, raster.shape) * magnify_bilinear(image[0], raster.shape)
    return total


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
