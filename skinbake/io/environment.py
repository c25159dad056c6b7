"""Skies: equirectangular radiance maps from HDR files; what is laid out otherwise is told apart and refused."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.image import read_radiance
from skinbake.io.image_file import ImageHeader, read_header
from skinbake.io.image_memory import image_bytes, refuse_beyond_memory
from skinbake.relight.skies import made_sky, sky_names
from skinbake.scene.lights import EnvironmentLight, LightSpec

Image = NDArray[np.float32]
OFF = 2  # texels by which a map may miss 2:1
LAYOUTS = {
    (4, 3): "a cross of six cube faces",
    (3, 4): "a cross of six cube faces",
    (6, 1): "a row of six cube faces",
    (1, 6): "a column of six cube faces",
    (3, 2): "six cube faces in two rows",
    (2, 3): "six cube faces in two columns",
    (1, 1): "a mirror ball, an angular map or a single cube face",
}


def read_environments(lights: Iterable[LightSpec]) -> dict[str, Image]:
    """Equirectangular radiance maps (h, w, 3) by the name of their light, for those that have a path.

    Raises
    ------
    InputError
        A map is missing, cannot be read, is not twice as wide as high, or holds NaN, negative values, or Inf where
        nobody asked to clamp it.
    """
    chosen = [light for light in lights if isinstance(light, EnvironmentLight) and light.path is not None]
    refuse_beyond_memory({Path(str(light.path)): image_bytes(str(light.path), 3) for light in chosen})
    limits = "`clamp:` of the light limits what is infinite"
    return {light.name: _read(Path(str(light.path)), light, limits) for light in chosen}


def read_sky(path: Path | str) -> Image:
    """Equirectangular radiance (h, w, 3) of a file that no look names, or of ours: studio, sunset.

    Raises
    ------
    InputError
        As `read_environments`.
    """
    if str(path) in sky_names():
        return made_sky(str(path))
    refuse_beyond_memory({Path(path): image_bytes(str(path), 3)})
    light = EnvironmentLight(name="sky", type="environment", path=str(path))
    return _read(Path(path), light, "limit what is infinite in the file, as `clamp:` is for lights of a look only")


def _read(path: Path, light: EnvironmentLight, infinite: str) -> Image:
    _refuse_other_layouts(path, read_header(path))
    return read_radiance(path, light.layer, light.color_space, is_sky=True, most=light.clamp, infinite=infinite)


def _refuse_other_layouts(path: Path, header: ImageHeader) -> None:
    width, height = header.width, header.height
    expected = "expected an equirectangular map, twice as wide as high"
    if header.layout:
        raise InputError(f"{path}: {expected}, got {header.layout}; convert it to a lat-long map")
    if abs(width - 2 * height) <= OFF:
        return
    like = next((f", as {what} is" for (w, h), what in LAYOUTS.items() if abs(width * h - height * w) <= max(w, h)), "")
    raise InputError(f"{path}: {expected}, got {width} x {height}{like}; convert it to a lat-long map")
