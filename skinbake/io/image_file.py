"""Image files as they are stored: which channels there are, their values and alpha, before anything is decoded."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.misread import refuse_misread
from skinbake.io.radiance_header import read_radiance_header
from skinbake.io.said_colours import said_colours

LARGEST_SIDE = 32768  # texels, as of texture.size
XYZ = {"X": "R", "Y": "G", "Z": "B"}  # of vectors: an image of Y alone is grey
# Kinds of files that hold colours multiplied by alpha unless they say otherwise. Of others OpenImageIO does not say it
MULTIPLIED = ("openexr", "tiff", "targa", "rla", "iff")
TGA_MULTIPLIED = 4  # type of alpha of a TGA; others but 3, colours beside it, say that it means nothing
FOURTH_BYTE = ("bmp", "targa")  # kinds of files that may hold one though they have no alpha: it is 0 then
LONG = {"RED": "R", "GREEN": "G", "BLUE": "B", "ALPHA": "A"}


@dataclass(frozen=True)
class ImageHeader:
    """What a file says before its pixels.

    Attributes
    ----------
    width, height : int
    channels : tuple of str
        Of all layers.
    value_bytes : int
        Of one stored value.
    layout : str
        What the file says of an environment's layout where it is not a lat-long map, else empty.
    """

    width: int
    height: int
    channels: tuple[str, ...]
    value_bytes: int
    layout: str = ""

    def decoded_bytes(self, channels: int) -> int:
        """Memory while an image of so many channels is read: as stored, as float32, and whether each is finite."""
        stored = min(len(self.channels), channels + 1) * self.value_bytes
        return self.width * self.height * (stored + 4 * channels + (channels if self.value_bytes > 1 else 0))


@dataclass(frozen=True)
class StoredImage:
    """One layer of a file.

    Attributes
    ----------
    pixels : ndarray of shape (h, w, n)
        In the file's own type; R, G, B (X, Y, Z of vectors), the first two of them, or one channel, divided by alpha
        where the file has them multiplied by it.
    alpha : ndarray of shape (h, w), float32, or None
        0 ... 1.
    attributes : mapping
        The header, under OpenImageIO's names.
    """

    pixels: NDArray[Any]
    alpha: NDArray[np.float32] | None
    attributes: Mapping[str, Any] = field(default_factory=dict)


def read_header(path: Path | str) -> ImageHeader:
    """Size of an image without its pixels.

    Raises
    ------
    InputError
        The file is missing, is no image, or is larger than any map that can be used.
    """
    with _opened(Path(path)) as source:
        header = _header(Path(path), source.spec())
        if source.format_name() == "hdr" and read_radiance_header(Path(path)).slow[1] == "X":
            return replace(header, width=header.height, height=header.width)
        return header


def read_stored(
    path: Path | str, layer: str | None = None, channel: str | None = None, divide: bool = True
) -> StoredImage:
    """Read one layer of an image.

    Parameters
    ----------
    path : path of anything OpenImageIO reads
    layer : str, optional
        Of an EXR: the name of a part, or what stands before ".R" in its channels' names, or the end of that.
    channel : "r", "g", "b" or "a", optional
        Only this one, as it is stored: other channels, alpha among them, are then data of their own.
    divide : bool
        Divide colours by alpha where the file has them multiplied.

    Raises
    ------
    InputError
        The file is missing, damaged or too large, or has no such layer or channel; the message lists what it has.
    """
    path = Path(path)
    with _opened(path) as source:
        part, names = _layer(path, source, layer, channel)
        source.seek_subimage(part, 0)
        spec = source.spec()
        _header(path, spec)
        attributes = {attribute.name: attribute.value for attribute in spec.extra_attribs}
        kind = source.format_name()
        if kind == "pnm":
            attributes.pop("oiio:ColorSpace", None)  # OpenImageIO's word, not the file's
        if "hdrgm:Version" in attributes and kind == "jpeg":
            return _base_rendition(path, channel)
        if spec.deep or spec.depth != 1:
            raise InputError(f"{path}: expected a flat image, got a deep or volume one")
        window = (spec.x, spec.y, spec.width, spec.height)
        if window != (spec.full_x, spec.full_y, spec.full_width, spec.full_height):
            raise InputError(f"{path}: expected a data window equal to the display window, got {window}")
        chosen = _channel(path, names, channel) if channel else _colours(path, names)
        if kind == "openexr" and any(str(spec.channelformat(i)) == "uint" for i in chosen):
            raise InputError(f"{path}: expected half or float values, got whole numbers (UINT), as identifiers are")
        wanted = list(chosen)
        if channel is None and "A" in names and names["A"] not in wanted:
            wanted.append(names["A"])
        low, high = min(wanted), max(wanted) + 1
        # oiio.UNKNOWN keeps the file's type, so that 8 and 16 bit decode through a table
        found = source.read_image(part, 0, low, high, _unknown())
        if found is None or source.has_error:
            raise InputError(f"{path}: the image is cut or damaged ({_reason(source.geterror())})")
        if kind == "hdr":
            said = read_radiance_header(path)
            found = said.upright(found)
            if said.applied != (1.0, 1.0, 1.0):  # the file's pixels are radiance times that
                found = (found / np.array(said.applied)).astype(np.float32)
            if said.chromaticities:
                attributes |= {"chromaticities": said.chromaticities}
        refuse_misread(path, kind, attributes, found)
        attributes |= said_colours(path, kind, attributes)
    pixels = found if chosen == tuple(range(low, high)) else np.ascontiguousarray(found[..., [i - low for i in chosen]])
    alpha = None
    if len(wanted) > len(chosen):
        alpha = _fraction(found[..., wanted[-1] - low])
        multiplied = kind in MULTIPLIED and not attributes.get("oiio:UnassociatedAlpha")
        undefined = kind == "targa" and multiplied and attributes.get("targa:alpha_type") != TGA_MULTIPLIED
        if undefined or (kind in FOURTH_BYTE and not alpha.any()):
            alpha = None
        # In our own files A is the charts' coverage
        elif divide and multiplied and "skinbake:version" not in attributes:
            pixels = _divided(pixels, alpha)
    return StoredImage(pixels, alpha, attributes)


def _header(path: Path, spec: Any) -> ImageHeader:
    if max(spec.width, spec.height) > LARGEST_SIDE:
        raise InputError(
            f"{path}: expected an image of at most {LARGEST_SIDE} x {LARGEST_SIDE}, got {spec.width} x {spec.height}"
        )
    said = [str(spec.get_string_attribute(name)) for name in ("textureformat", "envmap", "openexr:envmap")]
    cube = any("cube" in text.lower() for text in said) or spec.get_int_attribute("oiio:subimages", 1) == 6
    layout = "a cube map" if cube else ""
    return ImageHeader(spec.width, spec.height, tuple(spec.channelnames), spec.channel_bytes(), layout)


class _Layer(NamedTuple):
    """Number of its part, its name ("" of a single one), whether names of channels begin with it, and their places."""

    part: int
    name: str
    prefixed: bool
    channels: dict[str, int]


def _layers(source: Any) -> list[_Layer]:
    found = []
    parts = source.spec().get_int_attribute("oiio:subimages", 1) if source.format_name() == "openexr" else 1
    for part in range(parts):
        if not source.seek_subimage(part, 0):
            break  # damaged: whoever reads the pixels says so
        spec = source.spec()
        name = str(spec.get_string_attribute("name"))
        by_layer: dict[str, dict[str, int]] = {}
        for i, channel in enumerate(spec.channelnames):
            before, _, last = channel.rpartition(".")
            by_layer.setdefault(before, {})[last] = i
        for before, channels in by_layer.items():
            full = before if before == name else ".".join(filter(None, (name, before)))
            found.append(_Layer(part, full, before != "", channels))
    return found


def _layer(path: Path, source: Any, layer: str | None, channel: str | None) -> tuple[int, dict[str, int]]:
    """Number of the part, and its channels' places by their plain, upper-case names."""
    layers = _layers(source)
    if layer is not None:
        named = [found for found in layers if found.name == layer][:1]
        named = named or [found for found in layers if found.name.endswith(f".{layer}")]
        if len(named) == 1:
            return named[0].part, _plain(named[0].channels)
        there = ", ".join(found.name for found in named or layers if found.name) or "none"
        expected = f"the whole name of a layer {layer!r}" if named else f"a layer {layer!r}"
        raise InputError(f"{path}: expected {expected}, the file has {there}")
    first = min(layers, key=lambda found: (found.part, found.prefixed))
    names = _plain(first.channels)
    wanted = next((each for each in ("RGB", "Y", (channel or "?").upper()) if set(each) <= set(names)), None)
    alike = [
        found
        for found in layers
        if found.prefixed <= first.prefixed and set(wanted or "") <= set(_plain(found.channels))
    ]
    if len(layers) > 1 and (wanted is None or len(alike) > 1):
        there = ", ".join(f"{found.name}.{last}".strip(".") for found in layers for last in found.channels)
        expected = f"one layer of {', '.join(wanted)}" if wanted else "channels R, G, B"
        raise InputError(f"{path}: expected {expected}, the file has {there}; `layer:` chooses among its layers")
    return first.part, names


def _plain(channels: Mapping[str, int]) -> dict[str, int]:
    plain = {name: LONG.get(name.upper(), name.upper()) for name in channels}
    return {plain[name]: channels[name] for name in sorted(plain, key=lambda name: name == plain[name])}


def _colours(path: Path, names: Mapping[str, int]) -> tuple[int, ...]:
    """Places of what the layer shows: three channels, two, or one."""
    for axes in ("RGB", "XYZ", "RG", "XY"):
        if set(axes) <= set(names):
            return tuple(names[axis] for axis in axes)
    others = [i for name, i in names.items() if name != "A"]
    if len(others) == 1:
        return tuple(others)
    raise InputError(f"{path}: expected channels R, G, B, or a single one, the file has {', '.join(names)}")


def _channel(path: Path, names: Mapping[str, int], channel: str) -> tuple[int, ...]:
    """Place of one channel; a grey image has its one as red."""
    wanted = channel.upper()
    if wanted in names:
        return (names[wanted],)
    by_axis = {XYZ[name]: i for name, i in names.items() if name in XYZ and set(XYZ) <= set(names)}
    grey = [i for name, i in names.items() if name != "A"]
    if wanted in by_axis:
        return (by_axis[wanted],)
    if wanted == "R" and len(grey) == 1:
        return (grey[0],)
    raise InputError(f"{path}: expected a channel {wanted}, the file has {', '.join(names)}")


def _base_rendition(path: Path, channel: str | None) -> StoredImage:
    """The standard picture of an Ultra HDR photograph, as stored; its gain map shows light, not the skin's colour."""
    from PIL import Image

    try:
        with warnings.catch_warnings(), Image.open(path) as picture:
            warnings.simplefilter("ignore")  # of its size, which is checked
            picture.seek(0)
            pixels = np.asarray(picture.convert("L" if picture.mode == "L" else "RGB"))
            profile = picture.info.get("icc_profile")
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: the image is cut or damaged ({error})") from error
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    if channel:
        names = dict(zip("RGB", range(pixels.shape[2]), strict=False))
        pixels = np.ascontiguousarray(pixels[..., _channel(path, names, channel)])
    attributes = {"hdrgm:Version": "1.0"}
    return StoredImage(pixels, None, attributes | ({"ICCProfile": np.frombuffer(profile, np.uint8)} if profile else {}))


def _fraction(alpha: NDArray[Any]) -> NDArray[np.float32]:
    top = np.iinfo(alpha.dtype).max if np.issubdtype(alpha.dtype, np.integer) else 1
    return (alpha / np.float32(top)).astype(np.float32)


def _divided(pixels: NDArray[Any], alpha: NDArray[np.float32]) -> NDArray[Any]:
    """Colours that were multiplied by alpha, without it, in the type they have; as they are where alpha is 0 or 1."""
    part = (alpha > 0) & (alpha != 1)
    if not part.any():
        return pixels
    out = pixels.copy()
    values = pixels[part].astype(np.float64) / alpha[part][:, None]
    if np.issubdtype(pixels.dtype, np.integer):
        values = np.minimum(np.rint(values), np.iinfo(pixels.dtype).max)
    with np.errstate(over="ignore"):
        out[part] = values
    return out


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
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
        yield source
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: the image is cut or damaged ({error.reason})") from error
    finally:
        source.close()


def _unknown() -> Any:
    import OpenImageIO as oiio

    return oiio.UNKNOWN


def _reason(text: str) -> str:
    return (text.splitlines() or ["unknown format"])[0][:200]
