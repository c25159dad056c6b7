"""What looks share, as plain arrays for the cache, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from skinbake.atlas import Atlas, AtlasRaster
from skinbake.io.cache import Entry
from skinbake.io.irradiance import plan_of_text, plan_text
from skinbake.irradiance import IrradianceMap


def atlas_entry(atlas: Atlas) -> Entry:
    """Every array of every tile, by `tile.field`."""
    names = [field.name for field in fields(AtlasRaster) if field.name != "tile"]
    return {f"{raster.tile}.{name}": getattr(raster, name) for raster in atlas for name in names}


def atlas_of_entry(entry: Entry) -> Atlas:
    """The atlas again."""
    tiles: dict[int, dict[str, Any]] = {}
    for name, array in entry.items():
        tile, _, field = name.partition(".")
        tiles.setdefault(int(tile), {})[field] = array
    return tuple(AtlasRaster(tile=tile, **arrays) for tile, arrays in sorted(tiles.items()))


def light_entries(maps: Sequence[IrradianceMap]) -> dict[str, Entry]:
    """Each light's irradiance and visibility."""
    entries: dict[str, Entry] = {name: {} for name in maps[0].lights}
    for tile in maps:
        for i, name in enumerate(tile.lights):
            entries[name][f"{tile.tile}.rgb"] = tile.rgb[i]
            entries[name][f"{tile.tile}.visibility"] = tile.visibility[i]
            if name in tile.plan:
                entries[name]["plan"] = np.frombuffer(plan_text(tile.plan[name]).encode(), np.uint8)
    return entries


def merged_lights(
    names: tuple[str, ...], found: Mapping[str, Entry], kept: Sequence[IrradianceMap], atlas: Atlas
) -> tuple[IrradianceMap, ...]:
    """Lights in the order of `names`: from `found` where it has them, else from what was `kept` of the files."""
    tiles = []
    plan = {name: lines for tile in kept[:1] for name, lines in tile.plan.items() if name in names}
    for name, entry in found.items():
        plan.pop(name, None)
        if "plan" in entry:
            plan[name] = plan_of_text(entry["plan"].tobytes().decode())
    for k, raster in enumerate(atlas):
        rgb, visibility = [], []
        for name in names:
            if name in found:
                rgb.append(found[name][f"{raster.tile}.rgb"])
                visibility.append(found[name][f"{raster.tile}.visibility"])
            else:
                j = kept[k].lights.index(name)
                rgb.append(kept[k].rgb[j])
                visibility.append(kept[k].visibility[j])
        tiles.append(IrradianceMap(raster.tile, names, np.stack(rgb), np.stack(visibility), raster.coverage, plan))
    return tuple(tiles)
