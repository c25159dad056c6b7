"""Reading a bake folder as a PreviewScene."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE
from skinbake.errors import InputError
from skinbake.io.exr import Part, channel_of, read_parts
from skinbake.io.irradiance import LIGHT, TOTAL
from skinbake.io.lobes import is_transmission
from skinbake.io.look_maps import read_look_maps
from skinbake.io.manifest import NAME, irradiance_files, read_manifest, spec_of, table_of
from skinbake.io.mesh import read_look_mesh
from skinbake.io.relight import transfer_of
from skinbake.kernels.half import as_half
from skinbake.preview.relit import relit_scene
from skinbake.preview.scene import PreviewLobe, PreviewScene
from skinbake.scene.maps import IMAGES, SkinMaps
from skinbake.scene.spec import SceneSpec


@dataclass(frozen=True)
class BakeFolder:
    """A bake as read: the look it was baked from, and everything the preview draws."""

    path: Path
    spec: SceneSpec
    scene: PreviewScene


def read_bake_folder(path: Path | str, summed: bool = False) -> BakeFolder:
    """Read a bake folder, or the bake.json in it.

    Textures keep the precision they were stored with.

    Parameters
    ----------
    path : path
    summed : bool
        Read only each lobe's sum over the lights: enough for pictures in which each light is as it was baked.

    Raises
    ------
    InputError
        Something is missing or does not fit the manifest; the message says what, and that a new bake mends it.
    """
    folder, manifest, spec = look_of_bake(path)
    if not manifest["lobes"]:
        raise InputError(
            f"{folder}: expected a bake with lights, got one for those that come later: give --environment or --sun"
        )
    files, names = irradiance_files(manifest, folder), lights_of(manifest, spec)
    if names != tuple(light.name for light in spec.lights):
        raise InputError(
            f"{folder / NAME}: expected the lights of its look, {', '.join(light.name for light in spec.lights)}, got "
            f"{', '.join(names)}, as `skinbake diffuse` makes lobes of light that it is given; `skinbake bake` makes "
            "those of its own lights, and of these lobes there are export --sum, --layers and --gltf"
        )
    separate = spec.output.separate_lights and not summed

    irradiance, visibility = {}, {}
    for tile, file in _tiled(files, spec):
        parts = read_parts(folder / file)
        irradiance[tile] = _layers(folder / file, parts, [LIGHT + name for name in names])
        visibility[tile] = np.stack([channel_of(folder / file, parts, LIGHT + name, "visibility") for name in names])

    mesh = read_look_mesh(spec)
    maps, _, _ = read_look_maps(spec, mesh, tuple(irradiance))
    lobes = tuple(_lobe(folder, entry, spec, names if separate else None) for entry in manifest["lobes"])
    try:
        scene = PreviewScene(
            mesh,
            spec.lights,
            lobes,
            irradiance,
            visibility,
            half_maps(maps),
            spec.texturing,
            spec.specular,
            bool(manifest["terms"].get("energy_conservation", False)),
            separate,
            table_of(manifest, folder),
        )
    except ValueError as error:
        raise InputError(f"{folder}: {error}; bake it again") from error
    return BakeFolder(folder, spec, scene)


def read_relit_folder(path: Path | str) -> BakeFolder:
    """Read what a bake's `relight` left, to be drawn with lights that come later.

    Raises
    ------
    InputError
        There is no such bake, or something is missing or damaged.
    """
    folder, manifest, spec = look_of_bake(path)
    if not manifest["relight"]:
        raise InputError(f"{folder}: expected a bake with relight: in its look, got one without")
    transfer = transfer_of(folder)
    mesh = read_look_mesh(spec)
    maps, _, _ = read_look_maps(spec, mesh, tuple(transfer.textures))
    conserving = bool(manifest["terms"].get("energy_conservation", False))
    scene = relit_scene(
        transfer.basis, mesh, transfer.textures, transfer.visibility, half_maps(maps), spec.texturing, spec.specular,
        conserving,
    )  # fmt: skip
    return BakeFolder(folder, spec, scene)


def lights_of(manifest: dict[str, Any], spec: SceneSpec) -> tuple[str, ...]:
    """Names of the lights that a bake holds."""
    return tuple(manifest["lights"] or [light.name for light in spec.lights])


def look_of_bake(path: Path | str) -> tuple[Path, dict[str, Any], SceneSpec]:
    """Folder, manifest and look of a bake, named by its folder or its bake.json.

    Raises
    ------
    InputError
        There is no bake.
    """
    folder = Path(path)
    folder = folder.parent if folder.name == NAME else folder
    if not folder.is_dir():
        raise InputError(
            f"{folder}: expected a bake folder, found none; `skinbake bake CONFIG --out {folder}` makes one"
        )
    manifest = read_manifest(folder)
    return folder, manifest, spec_of(manifest, folder)


def _lobe(folder: Path, entry: dict[str, Any], spec: SceneSpec, names: tuple[str, ...] | None) -> PreviewLobe:
    """Lobe of a manifest's entry, its pixels read: by light, or their sum where `names` is None."""
    files = list(entry["tiles"].values()) if "tiles" in entry else [entry["file"]]
    wanted = [TOTAL] if names is None else [LIGHT + name for name in names]
    rgb = {
        tile: _layers(folder / file, read_parts(folder / file, wanted), wanted) for tile, file in _tiled(files, spec)
    }
    variance = None if is_transmission(entry["method"]) else float(entry["variance_mm2"])
    r, g, b = (float(weight) for weight in entry["weight_rgb"])
    return PreviewLobe(rgb, (r, g, b), variance)


def _tiled(files: list[str], spec: SceneSpec) -> list[tuple[int, str]]:
    """Files by their tile, which the name holds when there are tiles (`lobe_0.1002.exr`)."""
    if not spec.texture.udim:
        return [(FIRST_TILE, files[0])]
    numbers = [Path(file).stem.rpartition(".")[2] for file in files]
    if not all(re.fullmatch(r"[1-9]\d{3}", number) for number in numbers):
        raise InputError(f"{NAME}: expected a tile number in each file name, got {', '.join(files)}; bake it again")
    return [(int(number), file) for number, file in zip(numbers, files, strict=True)]


def _layers(path: Path, parts: dict[str, Part], wanted: list[str]) -> NDArray[np.floating]:
    """Parts of a file as (L, h, w, 3)."""
    layers = [[channel_of(path, parts, part, c) for c in "RGB"] for part in wanted]
    return np.stack([np.stack(channels, axis=-1) for channels in layers])


def half_maps(maps: SkinMaps) -> SkinMaps:
    """Maps as half floats, which hold 8-bit maps well and halve what the graphics card reads."""
    halves: dict[str, Any] = {
        name: {tile: as_half(image) for tile, image in getattr(maps, name).items()} for name in IMAGES
    }
    return replace(maps, **halves)
