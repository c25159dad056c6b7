"""Texture maps: from files to float32 arrays, linear, row 0 at v = 1, painted wherever they are read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE
from skinbake.bilinear import magnify_bilinear
from skinbake.errors import InputError
from skinbake.io.colour import decode
from skinbake.io.image_file import StoredImage, read_stored
from skinbake.io.image_memory import MAP_CHANNELS, image_bytes, refuse_beyond_memory
from skinbake.io.tile_names import MARKS, name_of_tile, names_tiles, tile_files
from skinbake.scene.map_files import (
    DetailMapSpec,
    FileMapSpec,
    HeightMapSpec,
    MapSpec,
    MapsSpec,
    NormalMapSpec,
    RoughnessMapSpec,
    ScaledMapSpec,
)
from skinbake.scene.maps import OF_SKIN, DetailNormals, SkinMaps
from skinbake.scene.skin import LEAST_RADIUS, MOST_HAEMOGLOBIN, MOST_MELANIN, MOST_RADIUS

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Charts = Callable[[int, tuple[int, int]], Mask]  # tile and shape (h, w) to the texels whose centre a chart holds
WHITE = (1.0, 1.0, 1.0)
RINGING = 0.05  # of a range of 1 or less, what a sharpening filter may leave beyond it; clamped, more is refused
HALF_BIT = 2.0**-11  # of a value: how half floats round it
AGREE = 4 / 255  # between channels of a grey picture: JPEG's noise
BLACK = 4 / 255  # as stored, of a texel that nobody painted; JPEG's noise
LUMINANCE_RGB = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of Rec.709
SHORT, INWARD_SHARE = 0.5, 0.02  # shorter ones are no normals, as grey about charts; more are no accident
UNIT, LEAD = 0.1, 2.0  # mean distance of normals' lengths from 1 that can be; how much further the other encoding's is
SIGNED_SHARE = 1e-3  # of texels with values below -RINGING: no filter's ringing


def read_maps(
    spec: MapsSpec, tiles: Sequence[int] = (FIRST_TILE,), charts: Charts | None = None, opaque: bool = False
) -> SkinMaps:
    """Read the maps of a look.

    Parameters
    ----------
    spec : MapsSpec
        Paths as they should be opened; one with `<UDIM>` names a file for each tile.
    tiles : sequence of int
        UDIM tiles that the mesh uses.
    charts : callable, optional
        Where charts lie. Black texels beside them count as unpainted; without it, only those of alpha 0 do. Unpainted
        texels are filled from the painted ones around them, so that no filter draws them over a chart's border.
    opaque : bool
        Whatever lies on a chart is painted, too, where its alpha is 0.

    Raises
    ------
    InputError
        A map is missing, cannot be read, is not finite or leaves its range; the message names file and texel.
    """
    readers: dict[str, Callable[[Any, Path, StoredImage], Image]] = {
        "albedo": _albedo,
        "normal": _normals,
        "roughness": _roughness,
        "specular": _factor,
        "cavity": _factor,
        "f0": partial(_scaled, low=0.0, high=1.0),
        "height": _heights,
        "detail": _normals,
        "scatter": _factor,
        "radius": _radius,
        "melanin": partial(_scaled, low=0.0, high=MOST_MELANIN),
        "haemoglobin": partial(_scaled, low=0.0, high=MOST_HAEMOGLOBIN),
    }

    def read(name: str, of: FileMapSpec, tile: int, path: Path) -> Image:
        stored = read_stored(path, of.layer, getattr(of, "channel", None))
        values = readers[name](of, path, stored)
        unpainted = _clear(stored)
        if charts is not None and name != "detail":
            beside = _black(stored) | unpainted if opaque else _black(stored)
            if beside.any():
                beside &= ~charts(tile, beside.shape)
                unpainted = beside if opaque else unpainted | beside
        values = filled(values, unpainted)
        return _refuse_narrow(path, values, charts and charts(tile, values.shape)) if name == "radius" else values

    files = {name: _files(name, of, tiles) for name, of in spec.files().items()}
    refuse_beyond_memory(
        {path: image_bytes(path, MAP_CHANNELS.get(name, 1)) for name, of in files.items() for path in of.values()}
    )
    with ThreadPoolExecutor(2) as pool:  # a picture is inflated without the interpreter's lock
        jobs = {
            name: {tile: pool.submit(read, name, of, tile, files[name][tile]) for tile in files[name]}
            for name, of in spec.files().items()
        }
        maps: dict[str, Any] = {name: {tile: job.result() for tile, job in of.items()} for name, of in jobs.items()}
    if spec.normal is not None:
        maps |= {"normal_space": spec.normal.space, "normal_strength": spec.normal.strength}
    if spec.height is not None:
        maps["height_mm"] = maps.pop("height")
    if spec.cavity is not None:
        maps["specular"] = _times(maps.get("specular", {}), maps.pop("cavity"))
    if spec.detail is not None:
        detail = maps["detail"][FIRST_TILE]
        maps["detail"] = DetailNormals(detail, spec.detail.repeat, spec.detail.strength)
    return SkinMaps(albedo_rgb=spec.albedo_rgb or WHITE, **maps)


def _times(one: dict[int, Image], other: dict[int, Image]) -> dict[int, Image]:
    """Products of two maps, tile by tile, at the larger size of the two along each axis; 1 where one is missing."""
    product = dict(one)
    for tile, image in other.items():
        if tile not in one:
            product[tile] = image
            continue
        height, width = np.maximum(one[tile].shape, image.shape).tolist()
        first, second = (magnify_bilinear(each[..., None], (height, width))[..., 0] for each in (one[tile], image))
        product[tile] = first * second
    return product


def missing_tiles(spec: MapsSpec, tiles: Sequence[int]) -> list[str]:
    """A sentence for each map that has no file for some of the tiles: what is used instead."""
    instead = {
        "albedo": "maps.albedo_rgb",
        "roughness": "specular.roughness",
        "specular": "a factor of 1",
        "cavity": "a factor of 1",
        "f0": "specular.f0",
        **{name: f"skin.{name}" for name in OF_SKIN},
    }
    found = []
    for name, of in spec.files().items():
        lacking = sorted(set(tiles) - set(tile_files(of.path))) if names_tiles(of.path) else []
        if lacking:
            files = ", ".join(Path(name_of_tile(of.path, tile)).name for tile in lacking)
            found.append(f"maps.{name}: no {files}: {instead.get(name, 'the smooth normal')} is used there")
    return found


def read_map(path: Path | str, channels: int, assume: str = "auto", color_space: str = "auto") -> Image:
    """One image as (h, w, channels) float32, decoded to linear Rec.709.

    Parameters
    ----------
    path : path of anything OpenImageIO reads
    channels : 1 or 3
        Grey is repeated to three channels; of three that agree, their mean is the one. Alpha is dropped; colours that
        were multiplied by it are divided.
    assume : "auto" or "linear"
        What `color_space: auto` means: "linear" for data; for colours "auto", what the file says, else sRGB for
        integers, linear for floats.
    color_space : str
        What the configuration says, see `decode`.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or a texel is NaN or Inf.
    """
    path = Path(path)
    stored = read_stored(path)
    values, _ = _decoded(path, stored, color_space, assume == "linear")
    if channels == 1:
        return _one_channel(path, values)
    return _three_channels(path, values)


def read_opacity(path: Path | str, or_grey: bool = True) -> Image:
    """What stops light at each texel, 0 ... 1, shape (h, w): the alpha of a picture that has one, else its grey.

    Parameters
    ----------
    path : path
    or_grey : bool
        False: a picture without alpha is opaque.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or leaves its range.
    """
    path = Path(path)
    refuse_beyond_memory({path: image_bytes(path, 3)})
    stored = read_stored(path, divide=False)
    if stored.alpha is not None:
        return _within(path, stored.alpha[..., None], 0.0, 1.0)[..., 0]
    if not or_grey:
        return np.ones(stored.pixels.shape[:2], np.float32)
    grey = _decoded(path, stored, "linear", True)[0].mean(axis=2, keepdims=True)
    return _within(path, grey.astype(np.float32), 0.0, 1.0)[..., 0]


def read_radiance(
    path: Path | str,
    layer: str | None = None,
    color_space: str = "auto",
    is_sky: bool = False,
    most: float | None = None,
) -> Image:
    """Colours of any brightness from a file of somebody else's, (h, w, 3), linear Rec.709, nothing below 0.

    Parameters
    ----------
    path : path
    layer, color_space : str
        As of a map.
    is_sky : bool
        A texture's texels are divided by alpha, and clear ones filled; a sky is what arrives, as it is.
    most : float, optional
        Limit of each channel, infinite ones included.

    Raises
    ------
    InputError
        As `read_maps`; negative beyond what a filter leaves.
    """
    path = Path(path)
    refuse_beyond_memory({path: image_bytes(path, 3)})
    stored = read_stored(path, layer, divide=not is_sky)
    if is_sky and "hdrgm:Version" in stored.attributes:
        raise InputError(f"{path}: expected radiance, got an Ultra HDR photograph; save it as .hdr or .exr")
    if most is not None:
        stored = StoredImage(_limited(stored.pixels, most), stored.alpha, stored.attributes)
    try:
        values = _three_channels(path, _decoded(path, stored, color_space, False)[0])
    except InputError as error:
        if is_sky and np.isposinf(stored.pixels).any():
            raise InputError(f"{error}; `clamp:` of the light limits what is infinite") from error
        raise
    values = _not_negative(path, values)
    if most is not None:
        np.minimum(values, np.float32(most), out=values)
    return values if is_sky else filled(values, _clear(stored))


def _limited(pixels: NDArray[Any], most: float) -> NDArray[Any]:
    """Floats without infinite ones, and at most so large as is asked for, in the file's own type."""
    if np.issubdtype(pixels.dtype, np.integer):
        return pixels
    return np.minimum(pixels, pixels.dtype.type(min(most, float(np.finfo(pixels.dtype).max))))


def _albedo(of: MapSpec, path: Path, stored: StoredImage) -> Image:
    values, moved = _decoded(path, stored, of.color_space, False)
    values = _three_channels(path, values)
    if (
        moved
    ):  # from other primaries: colours that Rec.709 has not are brought to its edge, only too bright ones refused
        _within(path, (values @ LUMINANCE_RGB)[..., None], 0.0, 1.0)
        np.clip(values, 0, 1, out=values)
    values = _within(path, values, 0.0, 1.0)
    return 1 - values if of.invert else values


def _factor(of: MapSpec, path: Path, stored: StoredImage) -> Image:
    values = _within(path, _data(of, path, stored), 0.0, 1.0)[..., 0]
    return 1 - values if of.invert else values


def _roughness(of: RoughnessMapSpec, path: Path, stored: StoredImage) -> Image:
    values = _factor(of, path, stored)
    return ggx_as_beckmann(values) if of.kind == "ggx" else values


def _heights(of: HeightMapSpec, path: Path, stored: StoredImage) -> Image:
    values = _data(of, path, stored)[..., 0]
    return np.float32(of.scale_mm) * (1 - values if of.invert else values)


def _scaled(of: ScaledMapSpec, path: Path, stored: StoredImage, low: float, high: float) -> Image:
    """Values of a map whose white is `of.scale`, within their range."""
    values = _data(of, path, stored)
    values = np.float32(of.scale) * (1 - values if of.invert else values)
    return _within(path, values, low, high)[..., 0]


def _radius(of: ScaledMapSpec, path: Path, stored: StoredImage) -> Image:
    try:
        return _scaled(of, path, stored, 0.0, MOST_RADIUS)  # black, where nobody painted, is 0 until it is filled
    except InputError as error:
        raise InputError(f"{error}: expected factors on the profile's width") from error


def _refuse_narrow(path: Path, values: Image, on_chart: Mask | None) -> Image:
    """Factors on the profile's width with those that no skin reads clamped; refuse narrower ones on the skin."""
    narrow = values < LEAST_RADIUS * (1 - HALF_BIT)
    if on_chart is not None:
        narrow &= on_chart
    if narrow.any():
        row, col = np.argwhere(narrow)[0]
        raise InputError(
            f"{path}: expected factors on the profile's width from {LEAST_RADIUS:g} to {MOST_RADIUS:g}, got "
            f"{values[row, col]:.3g} at column {col}, row {row} ({np.count_nonzero(narrow)} in all); what does not "
            "scatter is for maps.scatter"
        )
    return np.maximum(values, np.float32(LEAST_RADIUS))


def _data(of: MapSpec, path: Path, stored: StoredImage) -> Image:
    return _one_channel(path, _decoded(path, stored, of.color_space, True)[0])


def ggx_as_beckmann(roughness: Image) -> Image:
    """Beckmann m of the roughness r that painters and glTF mean, whose GGX lobe has alpha = r^2.

    m = r^2: both lobes are then as high at the centre of a highlight, D = 1 / (pi m^2) [Walter2007]; GGX's tail, which
    Beckmann has not, is lost.
    """
    return roughness * roughness


def _normals(of: NormalMapSpec | DetailMapSpec, path: Path, stored: StoredImage) -> Image:
    values, _ = _decoded(path, stored, of.color_space, True)
    count = values.shape[2]
    if count == 1:
        raise InputError(f"{path}: expected normals in two or three channels, got one; maps.height takes heights")
    two = count == 2 or (values[..., 2].max() <= BLACK and values[..., 2].min() >= -BLACK)
    encoding: str = of.encoding
    if encoding == "auto":
        is_integer = np.issubdtype(stored.pixels.dtype, np.integer)
        encoding = "unsigned" if is_integer else _encoding(path, values[~(_clear(stored) | _black(stored))], two)
    if encoding == "unsigned":
        values *= 2
        values -= 1
    if two:
        x, y = values[..., 0], values[..., 1]
        values = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], axis=-1)
    if of.green == "directx":
        values[..., 1] *= -1
    return values


def _encoding(path: Path, values: Image, two: bool) -> str:
    """Whether floats (n, 2 or 3) are normals as they are, or 0 ... 1: by their lengths as the one and the other."""
    if not len(values):
        return "signed"
    signed = (values < -RINGING).any(axis=1).mean(dtype=np.float64) > SIGNED_SHARE
    ask = (
        f"{path}: expected normals, and a float map does not say how they are stored; say encoding: unsigned or signed"
    )
    if two:
        if signed:
            return "signed"
        raise InputError(ask)
    off = {
        name: float(np.abs(np.linalg.norm(scale * values + shift, axis=1) - 1).mean(dtype=np.float64))
        for name, scale, shift in (("unsigned", 2, -1), ("signed", 1, 0))
    }
    best, other = sorted(off, key=lambda name: off[name])
    if off[best] > UNIT or off[other] < LEAD * off[best] or (signed and best == "unsigned"):
        raise InputError(ask)
    return best


def _decoded(path: Path, stored: StoredImage, color_space: str, is_data: bool) -> tuple[Image, bool]:
    if not np.issubdtype(stored.pixels.dtype, np.integer):
        _refuse_non_finite(path, stored.pixels)
    values, moved = decode(path, stored.pixels, stored.attributes, color_space, is_data)
    if not np.issubdtype(stored.pixels.dtype, np.integer):
        _refuse_non_finite(path, values)
    return values, moved


def _three_channels(path: Path, values: Image) -> Image:
    if values.shape[2] == 2:
        raise InputError(f"{path}: expected colours, or a single channel, got two")
    return np.ascontiguousarray(np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values)


def _one_channel(path: Path, values: Image) -> Image:
    """The one channel (h, w, 1), or the mean of three that are the same picture."""
    if values.shape[2] == 1:
        return values
    apart = np.ptp(values, axis=2)
    if values.shape[2] == 2 or apart.max() > AGREE:
        row, col = np.unravel_index(np.argmax(apart), apart.shape)
        got = ", ".join(f"{value:.3g}" for value in values[row, col])
        raise InputError(
            f"{path}: expected one channel, or three that agree, got {got} at column {col}, row {row}; "
            "say which one with `channel: r`, g, b or a"
        )
    return values.mean(axis=2, keepdims=True, dtype=np.float32)


def _clear(stored: StoredImage) -> Mask:
    """Texels of alpha 0."""
    return stored.alpha <= 0 if stored.alpha is not None else np.zeros(stored.pixels.shape[:2], np.bool_)


def _black(stored: StoredImage) -> Mask:
    """Black texels, which are unpainted where no chart lies."""
    top = np.iinfo(stored.pixels.dtype).max if np.issubdtype(stored.pixels.dtype, np.integer) else 1
    black = np.ones(stored.pixels.shape[:2], np.bool_)
    for k in range(stored.pixels.shape[2]):
        black &= np.abs(stored.pixels[..., k]) <= BLACK * top
    return black


def filled(values: Image, unpainted: Mask) -> Image:
    """Unpainted texels filled from the painted ones around them, level by level of an image pyramid."""
    import OpenImageIO as oiio

    if not unpainted.any() or unpainted.all():
        return values
    painted = ~unpainted
    flat = values.reshape(*values.shape[:2], -1)
    masked = np.dstack([flat * painted[..., None], painted]).astype(np.float32)
    spec = oiio.ImageSpec(masked.shape[1], masked.shape[0], masked.shape[2], oiio.FLOAT)
    spec.channelnames = (*"RGB"[: masked.shape[2] - 1], "A")
    spec.alpha_channel = masked.shape[2] - 1
    image = oiio.ImageBuf(spec)
    image.set_pixels(oiio.ROI(), masked)
    filled = oiio.ImageBufAlgo.fillholes_pushpull(image).get_pixels(oiio.FLOAT)
    assert filled is not None
    out = flat.copy()
    out[unpainted] = filled[unpainted][:, : flat.shape[2]]
    return out.reshape(values.shape)


def inward_normals(maps: SkinMaps) -> list[str]:
    """A sentence where many normals of a tangent-space map point into the skin: they are passed over."""
    found = []
    for tile, image in maps.normal.items() if maps.normal_space == "tangent" else ():
        normals = image[::4, ::4].reshape(-1, 3)
        painted = (np.linalg.norm(normals, axis=1) > SHORT) & (np.abs(normals + 1).max(axis=1) > BLACK)
        inward = painted & (normals[:, 2] <= 0)
        if inward.mean() > INWARD_SHARE:
            found.append(
                f"maps.normal, tile {tile}: {inward.mean():.0%} of its normals point into the skin and are passed over;"
                " is it in object space (space: object), or another picture?"
            )
    return found


def _files(name: str, of: FileMapSpec, tiles: Sequence[int]) -> dict[int, Path]:
    """Existing files by tile."""
    if name == "detail":
        return {FIRST_TILE: Path(of.path)}
    if not names_tiles(of.path):
        if tuple(tiles) != (FIRST_TILE,):
            raise InputError(f"{of.path}: expected {MARKS} in the path, the mesh has tiles {list(tiles)}")
        return tile_files(of.path)
    found = {tile: path for tile, path in tile_files(of.path).items() if tile in tiles}
    if not found:
        raise InputError(f"{of.path}: no such file for any of the tiles {list(tiles)}")
    return found


def _within(path: Path, values: Image, low: float, high: float) -> Image:
    """Clamp in place what rings, refuse what is further out."""
    rings = RINGING * min(1.0, high - low)
    least, most = low - rings, high + rings
    if values.min() < least or values.max() > most:
        bad = (values < least) | (values > most)
        row, col, channel = np.argwhere(bad)[0]
        expected = f"values from {low:g} to {high:g}" if np.isfinite(high) else f"values >= {low:g}"
        raise InputError(
            f"{path}: expected {expected}, got {values[row, col, channel]:g} at column {col}, row {row}"
            f"{_channel(values, channel)} ({np.count_nonzero(bad)} in all)"
        )
    return np.clip(values, low, high, out=values)


def _not_negative(path: Path, values: Image) -> Image:
    """Clamp in place what rings about bright texels, refuse what is further below 0."""
    least = min(-RINGING, -RINGING * float(values.max(initial=0)))
    if values.min(initial=0) < least:
        bad = values < least
        row, col, channel = np.argwhere(bad)[0]
        raise InputError(
            f"{path}: expected values >= 0, got {values[row, col, channel]:g} at column {col}, row {row}"
            f"{_channel(values, channel)} ({np.count_nonzero(bad)} in all)"
        )
    return np.maximum(values, 0, out=values)


def _refuse_non_finite(path: Path, pixels: NDArray[Any]) -> None:
    bad = ~np.isfinite(pixels)
    if bad.any():
        row, col, channel = np.argwhere(bad)[0]
        raise InputError(
            f"{path}: expected finite values, got NaN or Inf in {np.count_nonzero(bad.any(axis=2))} texels,"
            f" the first at column {col}, row {row}{_channel(pixels, channel)}"
        )


def _channel(pixels: NDArray[Any], channel: int) -> str:
    """Name of a channel for a message; nothing where the picture is no colour."""
    return f", channel {'RGBA'[channel]}" if 3 <= pixels.shape[2] <= 4 else ""
