"""Albedo of skin by what it is made of, place by place: a freckle or a blush is one map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.bilinear import magnify_bilinear
from skinbake.profile.from_skin import profile_of
from skinbake.profile.weight_table import WeightTable, even_nodes
from skinbake.scene.maps import SkinMaps
from skinbake.scene.skin import PhysiologySkin

PIGMENTS = ("melanin", "haemoglobin")
NODES = 33, 17  # between which colours are linear in the roots of the fractions: off by at most 2e-3
Image = NDArray[np.float32]


def albedo_of_skin(skin: PhysiologySkin, maps: SkinMaps, tiles: Sequence[int]) -> dict[int, Image]:
    """Linear Rec.709 albedo by tile, (h, w, 3): what the profile's skin of each place gives back in all, theory.md 3.9.

    Parameters
    ----------
    skin : PhysiologySkin
        Its own fractions stand where there is no map.
    maps : SkinMaps
        Of melanin and haemoglobin, of any sizes.
    tiles : sequence of int

    References
    ----------
    [Donner2006]
    """
    table = _colours(skin, maps)
    albedo = {}
    for tile in tiles:
        images = {name: getattr(maps, name)[tile] for name in PIGMENTS if tile in getattr(maps, name)}
        shape = np.max([image.shape for image in images.values()] or [(1, 1)], axis=0)
        height, width = int(shape[0]), int(shape[1])
        values = {
            name: magnify_bilinear(np.asarray(image, np.float32)[..., None], (height, width)).reshape(-1)
            for name, image in images.items()
        }
        rgb = np.broadcast_to(table.of_lobe(0, values), (height * width, 3))
        albedo[tile] = np.clip(rgb, 0, 1).astype(np.float32).reshape(height, width, 3)
    return albedo


def _colours(skin: PhysiologySkin, maps: SkinMaps) -> WeightTable:
    """Total reflectance over the maps' own range, as the weights of one Gaussian."""
    nodes = []
    for name, count in zip(PIGMENTS, NODES, strict=True):
        found = [float(getattr(skin, name))]
        for image in getattr(maps, name).values():
            found += [float(image.min()), float(image.max())]
        nodes.append(even_nodes(min(found), max(found), count))
    rgb = np.array([[_total(skin, a, b) for b in nodes[1]] for a in nodes[0]])[:, :, None]
    zero = np.zeros((*rgb.shape[:2], 3))
    constants = {name: float(getattr(skin, name)) for name in PIGMENTS}
    return WeightTable(PIGMENTS, (nodes[0], nodes[1]), rgb, zero, zero, constants)


def _total(skin: PhysiologySkin, melanin: float, haemoglobin: float) -> NDArray[np.float64]:
    """Total reflectance of a skin of other fractions, (3,)."""
    return profile_of(skin.model_copy(update={"melanin": melanin, "haemoglobin": haemoglobin})).total_reflectance
