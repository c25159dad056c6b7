"""Texture maps: the only file that knows how colours are stored. Out come float32 arrays, linear, row 0 at v = 1."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE
from skinbake.errors import InputError
from skinbake.scene.lights import EnvironmentLight, LightSpec
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import MapSpec, MapsSpec, NormalMapSpec

Image = NDArray[np.float32]
UDIM_MARK = "<UDIM>"
RINGING = 0.05  # what a sharpening filter may leave below 0 or above 1; clamped, while more is refused


def read_maps(spec: MapsSpec, tiles: Sequence[int] = (FIRST_TILE,)) -> SkinMaps:
    """Read the maps of a look.

    Parameters
    ----------
    spec : MapsSpec
        Paths as they should be opened; one with `<UDIM>` names a file for each tile.
    tiles : sequence of int
        UDIM tiles that the mesh uses.

    Raises
    ------
    InputError
        A map is missing, cannot be read, is not finite or leaves its range; the message names file and texel.
    """
    readers: dict[str, Callable[[Any, Path], Image]] = {
        "albedo": _read_albedo, "normal": _read_normal, "roughness": _read_factor, "specular": _read_factor
    }  # fmt: skip
    with ThreadPoolExecutor(2) as pool:  # a picture is inflated without the interpreter's lock
        jobs = {
            name: {tile: pool.submit(read, of, path) for tile, path in _files(of, tiles)}
            for name, read in readers.items()
            if (of := getattr(spec, name)) is not None
        }
        maps: dict[str, Any] = {name: {tile: job.result() for tile, job in of.items()} for name, of in jobs.items()}
    if spec.normal is not None:
        maps |= {"normal_space": spec.normal.space, "normal_strength": spec.normal.strength}
    return SkinMaps(albedo_rgb=spec.albedo_rgb, **maps)


def _read_albedo(of: MapSpec, path: Path) -> Image:
    return _within(path, read_map(path, 3, "auto", of.color_space), 0.0, 1.0)


def _read_normal(of: NormalMapSpec, path: Path) -> Image:
    return _as_normals(read_map(path, 3, "linear", of.color_space), of.green)


def _read_factor(of: MapSpec, path: Path) -> Image:
    return _within(path, read_map(path, 1, "linear", of.color_space), 0.0, 1.0)[..., 0]


def read_environments(lights: Iterable[LightSpec]) -> dict[str, Image]:
    """Equirectangular radiance maps (h, w, 3) by the name of their light, for those that have a path."""
    found = {}
    for light in lights:
        if isinstance(light, EnvironmentLight) and light.path is not None:
            found[light.name] = _within(Path(light.path), read_map(light.path, 3), 0.0, np.inf)
    return found


def read_map(path: Path | str, channels: int, assume: str = "auto", color_space: str = "auto") -> Image:
    """One image as (h, w, channels) float32, decoded to linear.

    Parameters
    ----------
    path : path of anything OpenImageIO reads
    channels : 1 or 3
        Grey is repeated to three channels; three are averaged to one; alpha is dropped, never multiplied in.
    assume : "auto" or "linear"
        What `color_space: auto` means: "linear" for data; for colours "auto", sRGB for integers, linear for floats,
        unless the file says otherwise.
    color_space : "auto", "srgb" or "linear"
        What the configuration says.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or a texel is NaN or Inf.
    """
    path = Path(path)
    pixels, file_space = _pixels(path)
    if not np.issubdtype(pixels.dtype, np.integer):
        _refuse_non_finite(path, pixels)
    if color_space == "auto":
        color_space = assume
    if color_space == "auto":
        is_integer = np.issubdtype(pixels.dtype, np.integer)
        said_linear, said_srgb = "lin" in file_space, "srgb" in file_space
        color_space = "srgb" if said_srgb or (is_integer and not said_linear) else "linear"
    with np.errstate(over="ignore"):  # float64 beyond float32 becomes infinite, and is then refused as such
        values = _decode(pixels, color_space)
    if not np.issubdtype(pixels.dtype, np.integer):
        _refuse_non_finite(path, values)

    colours = values[..., : 3 if values.shape[2] >= 3 else 1]
    if channels == 1 and colours.shape[2] == 3:
        return colours.mean(axis=2, keepdims=True, dtype=np.float32)
    return np.ascontiguousarray(np.repeat(colours, 3, axis=2) if colours.shape[2] < channels else colours)


def read_opacity(path: Path | str) -> Image:
    """What stops light at each texel, 0 ... 1, shape (h, w): the alpha of a picture that has one, else its grey.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or leaves its range.
    """
    pixels, _ = _pixels(Path(path))
    values = _decode(pixels, "linear")
    _refuse_non_finite(Path(path), values)
    grey = values[..., -1:] if values.shape[2] in (2, 4) else values[..., :3].mean(axis=2, keepdims=True)
    return _within(Path(path), grey.astype(np.float32), 0.0, 1.0)[..., 0]


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Decode sRGB (IEC 61966-2-1); values past 1 follow the curve, values below 0 its mirror."""
    x = np.abs(np.asarray(encoded, dtype=np.float64))
    return np.copysign(np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), encoded)


def _files(spec: MapSpec, tiles: Sequence[int]) -> list[tuple[int, Path]]:
    """Existing files by tile."""
    if UDIM_MARK not in spec.path:
        if tuple(tiles) != (FIRST_TILE,):
            raise InputError(f"{spec.path}: expected {UDIM_MARK} in the path, the mesh has tiles {list(tiles)}")
        return [(FIRST_TILE, Path(spec.path))]
    named = [(tile, Path(spec.path.replace(UDIM_MARK, str(tile)))) for tile in tiles]
    found = [(tile, path) for tile, path in named if path.is_file()]
    if not found:
        raise InputError(f"{spec.path}: no such file for any of the tiles {list(tiles)}")
    return found


def _pixels(path: Path) -> tuple[NDArray[Any], str]:
    """Pixels (h, w, c) in the file's own type, and the colour space it claims."""
    import OpenImageIO as oiio  # only when a map is read

    if not path.is_file():
        raise InputError(f"{path}: expected an image, {'got a folder' if path.is_dir() else 'no such file'}")
    hint = oiio.ImageSpec()
    hint.attribute("oiio:UnassociatedAlpha", 1)
    try:
        source = oiio.ImageInput.open(str(path), hint)
        if source is None:
            raise InputError(f"{path}: not an image that can be read ({_reason(oiio.geterror())})")
    except UnicodeDecodeError as error:  # OpenImageIO quotes the damaged bytes in its message
        raise InputError(f"{path}: not an image that can be read ({error.reason})") from error
    try:
        spec = source.spec()
        if spec.deep or spec.depth != 1:
            raise InputError(f"{path}: expected a flat image, got a deep or volume one")
        window = (spec.x, spec.y, spec.width, spec.height)
        if window != (spec.full_x, spec.full_y, spec.full_width, spec.full_height):
            raise InputError(f"{path}: expected a data window equal to the display window, got {window}")
        # oiio.UNKNOWN keeps the file's type, so that 8 and 16 bit decode through a table
        pixels = source.read_image(0, 0, 0, spec.nchannels, oiio.UNKNOWN)
        if pixels is None or source.has_error:
            raise InputError(f"{path}: the image is cut or damaged ({_reason(source.geterror())})")
        return pixels, str(spec.get_string_attribute("oiio:ColorSpace")).lower()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: the image is cut or damaged ({error.reason})") from error
    finally:
        source.close()


def _decode(pixels: NDArray[Any], color_space: str) -> Image:
    """Integers by a table, so that 8 and 16 bits cost one lookup a value; floats directly."""
    srgb = color_space == "srgb"
    if pixels.dtype in (np.uint8, np.uint16):
        levels = np.arange(np.iinfo(pixels.dtype).max + 1) / np.iinfo(pixels.dtype).max
        return (srgb_to_linear(levels) if srgb else levels).astype(np.float32)[pixels]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.iinfo(pixels.dtype).max
    return (srgb_to_linear(pixels) if srgb else pixels).astype(np.float32)


def _as_normals(values: Image, green: str) -> Image:
    """0 ... 1 to -1 ... 1, in place, unless the file is signed already; green up."""
    if values.min() >= 0:
        values *= 2
        values -= 1
    if green == "directx":
        values[..., 1] *= -1
    return values


def _within(path: Path, values: Image, low: float, high: float) -> Image:
    """Clamp in place what rings, refuse what is further out."""
    least, most = low - RINGING, high + RINGING
    if values.min() < least or values.max() > most:
        bad = (values < least) | (values > most)
        row, col, channel = np.argwhere(bad)[0]
        expected = f"values from {low:g} to {high:g}" if np.isfinite(high) else f"values >= {low:g}"
        raise InputError(
            f"{path}: expected {expected}, got {values[row, col, channel]:g} at column {col}, row {row}"
            f" ({np.count_nonzero(bad)} in all)"
        )
    return np.clip(values, low, high, out=values)


def _refuse_non_finite(path: Path, pixels: NDArray[Any]) -> None:
    bad = ~np.isfinite(pixels).all(axis=2)
    if bad.any():
        row, col = np.argwhere(bad)[0]
        raise InputError(
            f"{path}: expected finite values, got NaN or Inf in {np.count_nonzero(bad)} texels,"
            f" the first at column {col}, row {row}"
        )


def _reason(text: str) -> str:
    return (text.splitlines() or ["unknown format"])[0][:200]
