"""irradiance.exr: the total, and each light with its visibility as a part of its own."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.exr import Part, read_attributes, read_parts, rgb_channels, write_part_files, write_parts
from skinbake.io.image import read_radiance
from skinbake.io.image_values import RINGING
from skinbake.irradiance import IrradianceMap
from skinbake.scene.decision import TOTAL_LIGHT, Decision

LIGHT = "light."
TOTAL = "irradiance"
LAYOUTS = {"multipart": write_parts, "single": write_part_files}  # `output.layout`


def tile_path(path: Path, tile: int, udim: bool) -> Path:
    """Path of a tile's file: `irradiance.exr`, or `irradiance.1002.exr` where there are tiles.

    Parameters
    ----------
    path : Path
        Without a tile.
    tile : int
    udim : bool
        Whether there are tiles.
    """
    return path.with_suffix(f".{tile}{path.suffix}") if udim else path


def write_irradiance(
    path: Path,
    irradiance: IrradianceMap,
    keys: Mapping[str, str],
    attributes: Mapping[str, Any],
    precision: str,
    compression: str,
    layout: str = "multipart",
) -> None:
    """Write one tile: the total, then each light.

    Parameters
    ----------
    path : Path
    irradiance : IrradianceMap
    keys : mapping of light name to str
        Stage key, for the header of its part.
    attributes : mapping
        For every part's header.
    precision, compression : str
        As `write_parts`.
    layout : "multipart" or "single"
        A file, or a file a part.

    Raises
    ------
    InputError, MachineError
        As `write_parts`.
    """
    parts = [Part(TOTAL, rgb_channels(irradiance.total) | {"A": irradiance.coverage})]
    for i, name in enumerate(irradiance.lights):
        channels = rgb_channels(irradiance.rgb[i]) | {"visibility": irradiance.visibility[i]}
        told = {"skinbake:plan": plan_text(irradiance.plan[name])} if name in irradiance.plan else {}
        parts.append(Part(LIGHT + name, channels, {"skinbake:key": keys[name]} | told))
    LAYOUTS[layout](path, parts, attributes, precision, compression)


def plan_text(lines: tuple[Decision, ...]) -> str:
    """A light's plan as JSON."""
    return json.dumps([line.record() for line in lines])


def plan_of_text(text: str) -> tuple[Decision, ...]:
    """A light's plan from the JSON of `plan_text`."""
    return tuple(Decision.from_record(line) for line in json.loads(text))


def part_keys(path: Path) -> dict[str, str]:
    """Stage key of each part of a file: of each light, and of all; empty where there is no such file."""
    try:
        return {name: str(header.get("skinbake:key", "")) for name, header in read_attributes(path).items()}
    except InputError:
        return {}


def read_irradiance(path: Path, tile: int, size: tuple[int, int] | None = None) -> IrradianceMap:
    """Read our own file, or any EXR with R, G, B: one light called "total" where there are no parts.

    Files of others are read as maps are: colours as the file says, divided by alpha, unpainted texels filled.

    Parameters
    ----------
    size : (width, height), optional
        Size of the look's texture.

    Raises
    ------
    InputError
        No RGB, another size, or a value that is negative or not finite (named by its texel).
    """
    if not is_ours(path):
        rgb = read_radiance(path)
        if size is None or rgb.shape[1::-1] == tuple(size):
            one = np.ones(rgb.shape[:2], np.float32)
            return IrradianceMap(tile, (TOTAL_LIGHT,), rgb[None], one[None], one)
        raise InputError(f"{path}: expected texture.size {size[0]} x {size[1]}, got {rgb.shape[1]} x {rgb.shape[0]}")
    parts = read_parts(path)
    lights = [name for name, part in parts.items() if name.startswith(LIGHT) and {"R", "G", "B"} <= set(part.channels)]
    total = parts.get(TOTAL) or next(iter(parts.values()))
    if not {"R", "G", "B"} <= set(total.channels):
        raise InputError(f"{path}: expected channels R, G, B, got {', '.join(total.channels)}")
    chosen = [parts[name] for name in lights] or [total]
    height, width = chosen[0].channels["R"].shape
    if size is not None and (width, height) != tuple(size):
        raise InputError(f"{path}: expected texture.size {size[0]} x {size[1]}, got {width} x {height}")
    rgb = _stacked([[part.channels[channel] for channel in "RGB"] for part in chosen])
    if not _is_light(rgb):
        rgb = np.asarray(rgb, np.float32)
        rgb = np.where((rgb < 0) & (rgb >= -RINGING * np.nanmax(rgb, initial=0)), np.float32(0), rgb)
        bad = ~(rgb >= 0) | ~np.isfinite(rgb)  # NaN compares false
        if bad.any():
            light, row, column, channel = np.argwhere(bad)[0]
            part = chosen[light].name or "image"
            raise InputError(
                f"{path}: part {part}, channel {'RGB'[channel]}: expected finite values >= 0, "
                f"got {rgb[light, row, column, channel]} at column {column}, row {row}"
            )
    one = np.ones((height, width), np.float16)
    return IrradianceMap(
        tile,
        tuple(name.removeprefix(LIGHT) for name in lights) or (TOTAL_LIGHT,),
        rgb,
        _stacked([[part.channels.get("visibility", one)] for part in chosen])[..., 0],
        np.asarray(total.channels.get("A", one), np.float32),
        {
            name.removeprefix(LIGHT): _plan(path, parts[name])
            for name in lights
            if "skinbake:plan" in parts[name].attributes
        },
    )


def _stacked(images: Sequence[Sequence[NDArray[Any]]]) -> NDArray[np.floating]:
    """Channels (h, w) of each of L images as (L, h, w, C): halves where all of them are, else float32."""
    kind = np.float16 if all(channel.dtype == np.float16 for image in images for channel in image) else np.float32
    found = np.empty((len(images), *images[0][0].shape, len(images[0])), kind)
    for i, image in enumerate(images):
        for c, channel in enumerate(image):
            found[i, ..., c] = channel
    return found


def _is_light(rgb: NDArray[np.floating]) -> bool:
    """Whether all values are finite and have no sign: by their bits, which are in the order of the values."""
    bits = np.uint16 if rgb.dtype == np.float16 else np.uint32
    return bool(rgb.view(bits).max(initial=0) <= np.asarray(np.finfo(rgb.dtype).max).view(bits))


def _plan(path: Path, part: Part) -> tuple[Decision, ...]:
    """A light's plan from the header of its part.

    Raises
    ------
    InputError
        It is damaged.
    """
    try:
        return plan_of_text(str(part.attributes["skinbake:plan"]))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: part {part.name}, skinbake:plan: expected a plan, got: {error}") from error


def is_ours(path: Path) -> bool:
    """Whether a file is one of ours, with the light in parts, or anybody's picture.

    Raises
    ------
    InputError
        It is missing or is not an EXR.
    """
    headers = read_attributes(path)
    return TOTAL in headers or any(
        "skinbake:version" in header or name.startswith(LIGHT) for name, header in headers.items()
    )
