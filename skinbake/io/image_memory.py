"""What reading images will take, by their headers, before any pixel is decoded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from skinbake.errors import MachineError
from skinbake.io.image_file import read_header
from skinbake.io.tile_names import tile_files
from skinbake.machine import physical_memory_bytes
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.spec import SceneSpec

MAP_CHANNELS = {"albedo": 3, "normal": 3, "detail": 3}  # all others: 1


def image_bytes(path: Path | str, channels: int) -> int:
    """Memory while an image of so many channels is read."""
    return read_header(path).decoded_bytes(channels)


def memory_of_images(spec: SceneSpec) -> dict[Path, int]:
    """Bytes that each of a look's maps and skies takes, by its path.

    Raises
    ------
    InputError
        A file is no image, or larger than any that can be used.
    """
    found = {}
    for name, of in spec.maps.files().items():
        for path in tile_files(of.path).values():
            found[path] = image_bytes(path, MAP_CHANNELS.get(name, 1))
    for light in spec.lights:
        if isinstance(light, EnvironmentLight) and light.path is not None:
            found[Path(light.path)] = image_bytes(light.path, 3)
    return found


def refuse_beyond_memory(needed: Mapping[Path, int]) -> None:
    """Stop before images are decoded that this machine cannot hold.

    Raises
    ------
    MachineError
        With the largest image and what to do.
    """
    there, total = physical_memory_bytes(), sum(needed.values())
    if total > there:
        path = max(needed, key=lambda path: needed[path])
        header = read_header(path)
        its, all_of_them = (f"{size / 2**30:.0f} GiB" for size in (needed[path], total))
        others = f" ({all_of_them} with the other images)" if len(needed) > 1 else ""
        raise MachineError(
            f"{path}: {header.width} x {header.height} texels need about {its} of memory{others}, "
            f"this machine has {there / 2**30:.0f} GiB: use a smaller image"
        )
