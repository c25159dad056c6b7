"""Pictures for people: every image of a file or a bake by name, and differences in false colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE
from skinbake.compare import read_at
from skinbake.errors import InputError, printable
from skinbake.io.bake_weights import bake_weights
from skinbake.io.exr import channel_of, files_of, read_parts
from skinbake.io.figures import png_figure
from skinbake.io.image import read_map

Image = NDArray[np.floating]


def images_of(path: Path) -> dict[str, Image]:
    """Every image of an EXR, another image file, or a bake folder, as (h, w, channels) by a name.

    Channels come in the order R, G, B, others by name, A.

    Raises
    ------
    InputError
        There is nothing to compare.
    """
    if path.is_dir():
        files = sorted(path.glob("*.exr"))
        parts_of_others = {part for file in files for part in files_of(file)[1:]}
        files = [file for file in files if file not in parts_of_others]
        if not files:
            raise InputError(f"{path}: expected a folder with EXR files, found none")
        return {f"{file.name} {name}".strip(): image for file in files for name, image in images_of(file).items()}
    if path.suffix.lower() == ".exr":
        parts = read_parts(path).items()
        return {
            name: np.stack([p.channels[c] for c in _ordered(p.channels)], axis=-1).astype(np.float32)
            for name, p in parts
        }
    return {"": read_map(path, 3, "linear")}


def _ordered(channels: Iterable[str]) -> list[str]:
    """Names of channels: colours first, as a picture shows them; alpha last."""
    first = {"R": 0, "G": 1, "B": 2, "A": 4}
    return sorted(channels, key=lambda name: (first.get(name, 3), name))


def diffuse_of(folder: Path, manifest: Mapping[str, Any]) -> dict[str, Image]:
    """Sum of a bake's weighted lobes, each read at the largest one's size, by tile ("" where there is one).

    Raises
    ------
    InputError
        The bake has no lights of its own.
    """
    sums: dict[str, Image] = {}
    if not manifest["lobes"]:
        raise InputError(f"{folder}: expected a bake with lights, got one for those that come later")
    sizes = [lobe["size"] for lobe in manifest["lobes"]]
    width, height = max(size[0] for size in sizes), max(size[1] for size in sizes)
    weights = bake_weights(manifest, folder)
    for index, lobe in enumerate(manifest["lobes"]):
        for tile, file in lobe.get("tiles", {"": lobe["file"]}).items():
            parts = read_parts(folder / file)
            channels = [channel_of(folder / file, parts, "irradiance", c) for c in "RGB"]
            rgb = np.stack(channels, axis=-1, dtype=np.float32)
            weight = weights.image(index, int(tile or FIRST_TILE), (height, width))
            part = weight * read_at(rgb, height, width)
            sums[tile] = sums[tile] + part if tile in sums else part
    return sums


def false_colour_sheet(path: Path, pairs: Mapping[str, tuple[Image, Image]]) -> None:
    """Write a PNG: a row a pair, first image, second image, their difference relative to the brightest value.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    with png_figure(path, 110, "tight", figsize=(12, 4 * max(len(pairs), 1))) as figure:
        axes = figure.subplots(len(pairs), 3, squeeze=False)
        for row, (name, (image, reference)) in zip(axes, pairs.items(), strict=True):
            top = max(float(np.nanmax(np.abs(reference), initial=0.0)), float(np.finfo(np.float32).tiny))
            for axis, values, title in zip(row[:2], (image, reference), (name, "reference"), strict=True):
                axis.imshow(np.clip(_rgb(values) / top, 0, 1) ** (1 / 2.2))
                axis.set_title(printable(title), fontsize=8, parse_math=False)
            off = np.abs(image - reference).max(axis=-1) / top
            # Equal images are black: without a largest value, matplotlib would show the middle of its colours
            shown = row[2].imshow(off, cmap="magma", vmin=0, vmax=float(np.nanmax(off, initial=0)) or 1.0)
            row[2].set_title("difference / brightest value", fontsize=8)
            figure.colorbar(shown, ax=row[2])
        for axis in axes.ravel():
            axis.set_axis_off()


def _rgb(values: Image) -> Image:
    """Show colours, which come first, as such, and anything of fewer channels as the grey of its first."""
    return values[..., :3] if values.shape[-1] >= 3 else np.repeat(values[..., :1], 3, axis=-1)
