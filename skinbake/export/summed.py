"""The light that leaves the skin, all lobes added up, as one texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.api.baked_skin import BakedSkin
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.irradiance import tile_path
from skinbake.io.png import write_png
from skinbake.preview.tonemap import tonemap

NAMES = ("sum.exr", "sum.png")


def sum_names(baked: BakedSkin) -> list[str]:
    """Names of the files that `write_sum` writes."""
    return [tile_path(Path(name), tile, baked.look.texture.udim).name for tile in baked.tiles for name in NAMES]


def write_sum(baked: BakedSkin, folder: Path) -> None:
    """Write `sum.exr`, radiant exitance M as half floats (L = M / pi), and `sum.png`, L as the preview tone-maps it.

    Parameters
    ----------
    baked : BakedSkin
    folder : Path

    Raises
    ------
    InputError
        A file of the bake is missing or damaged, or the folder cannot be written to.
    MachineError
        Disk full.
    """
    for tile in baked.tiles:
        m = baked.radiant_exitance(tile=tile)
        exr, png = (tile_path(folder / name, tile, baked.look.texture.udim) for name in NAMES)
        write_parts(exr, [Part("", rgb_channels(m), {"skinbake:quantity": "radiant exitance M; L = M / pi"})])
        write_png(png, tonemap(m / np.float32(np.pi), baked.look.preview.exposure))
