"""Every texture of a bake as a file of its own, in the plainest form of EXR."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.api.baked_skin import BakedSkin
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.irradiance import tile_path

UDIM = "<UDIM>"  # stands for a tile's number, as in other programs


def layer_names(baked: BakedSkin) -> list[str]:
    """Names of the files that `write_layers` writes."""
    return [
        tile_path(Path(f"{name}.exr"), tile, baked.look.texture.udim).name
        for tile in baked.tiles
        for name in [*(name for name, _, _ in _layers(baked)), *(f"weight_{lobe}" for lobe in _weighed(baked))]
    ]


def write_layers(baked: BakedSkin, folder: Path) -> None:
    """Write `irradiance.exr`, `lobe_N.exr` and `transmission.exr`, and each light of them as `lobe_N.LIGHT.exr`.

    Where maps vary the skin, `weight_N.exr` says what lobe N counts at each texel; light through thin parts is the
    last one. Channels are R, G, B, one part a file, linear Rec.709, half floats; a file a tile where there are tiles.

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
        for name, lobe, light in _layers(baked):
            if lobe is None:
                image = baked.irradiance(light, tile)
                about: dict[str, Any] = {"skinbake:quantity": "irradiance"}
            else:
                image = baked.lobe(lobe, light, tile)
                about = {
                    "skinbake:quantity": "lobe: add up weight times lobe, divide by pi",
                    "skinbake:weight_rgb": [float(w) for w in baked.weight_rgb[lobe]],
                    "skinbake:variance_mm2": float(baked.variance_mm2[lobe]),
                }
            path = tile_path(folder / f"{name}.exr", tile, baked.look.texture.udim)
            write_parts(path, [Part("", rgb_channels(image), about)])
        for lobe in _weighed(baked):
            path = tile_path(folder / f"weight_{lobe}.exr", tile, baked.look.texture.udim)
            weight = np.broadcast_to(baked.weight_image(lobe, tile), (*baked.look.texture.size[::-1], 3))
            about = {"skinbake:quantity": "weight of the lobe of the same number, in place of one for all texels"}
            write_parts(path, [Part("", rgb_channels(weight), about)])


def _weighed(baked: BakedSkin) -> range:
    """Lobes whose weights differ over the skin."""
    return range(len(baked.weight_rgb) if baked.table is not None else 0)


def _layers(baked: BakedSkin) -> Iterator[tuple[str, int | None, str | None]]:
    """Name, lobe (None for the irradiance) and light (None for the sum) of each texture."""
    for light in (None, *baked.lights):
        yield _name("irradiance", light), None, light
    for lobe in range(len(baked.weight_rgb)):
        for light in dict.fromkeys((None, *lobe_layers(baked))):
            yield _name(_stem(baked, lobe), light), lobe, light


def lobe_layers(baked: BakedSkin) -> tuple[str | None, ...]:
    """Lights whose lobes are stored apart; (None,) where only their sum is."""
    return baked.lights if baked.look.output.separate_lights else (None,)


def layer_file(baked: BakedSkin, lobe: int, light: str | None, tile: str | None) -> str:
    """Name of a lobe's file.

    Parameters
    ----------
    baked : BakedSkin
    lobe : int
    light : str, optional
        The sum over the lights unless given.
    tile : str, optional
        Its number, or UDIM; none where there are no tiles.
    """
    name = _name(_stem(baked, lobe), light)
    return f"{name}.exr" if tile is None else f"{name}.{tile}.exr"


def weight_file(lobe: int, tile: str | None) -> str:
    """Name of the file of a lobe's weights; `tile` as in `layer_file`."""
    return f"weight_{lobe}.exr" if tile is None else f"weight_{lobe}.{tile}.exr"


def _stem(baked: BakedSkin, lobe: int) -> str:
    return "transmission" if baked.transmits and lobe == len(baked.weight_rgb) - 1 else f"lobe_{lobe}"


def _name(stem: str, light: str | None) -> str:
    return stem if light is None else f"{stem}.{light}"
