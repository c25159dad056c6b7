"""What of a skin its maps vary, between which values; and the skin of their mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from skinbake.scene.maps import OF_SKIN, SkinMaps
from skinbake.scene.skin import SkinSpec


class Range(NamedTuple):
    """Least, greatest and mean value of a map."""

    low: float
    high: float
    mean: float


def ranges_of(maps: SkinMaps, skin: SkinSpec, tiles: Sequence[int]) -> dict[str, Range]:
    """Ranges of the maps that vary a skin, by quantity; those that the look has no map of are left out.

    Parameters
    ----------
    maps : SkinMaps
    skin : SkinSpec
        What stands for a map on tiles that it lacks.
    tiles : sequence of int
        Of the mesh.
    """
    found = {}
    for name in OF_SKIN:
        images = getattr(maps, name)
        if not images:
            continue
        low = [float(image.min()) for image in images.values()]
        high = [float(image.max()) for image in images.values()]
        mean = [float(image.mean(dtype=np.float64)) for image in images.values()]
        if any(tile not in images for tile in tiles):
            for values in (low, high, mean):
                values.append(float(getattr(skin, name)))
        found[name] = Range(min(low), max(high), min(max(float(np.mean(mean)), min(low)), max(high)))
    return found


def mean_skin(skin: SkinSpec, over: Mapping[str, Range]) -> SkinSpec:
    """The skin whose keys are the mean values of its maps; itself where it has none."""
    return skin.model_copy(update={name: each.mean for name, each in over.items()}) if over else skin
