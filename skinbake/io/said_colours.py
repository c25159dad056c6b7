"""Colours that a picture names in words which OpenImageIO passes over.

A PNG's and a TIFF's primaries, a TIFF's curve, a BMP's ICC profile, a photograph's Adobe RGB.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.io.colour import REC709, srgb_to_linear

_BEFORE_PRIMARIES = (b"iCCP", b"sRGB", b"cICP")  # a PNG that has one of them means nothing by its primaries
_BMP_HEADER, _BMP_5 = 14, 124  # bytes
_UNCALIBRATED = 65535  # EXIF's ColorSpace of all that is not sRGB
# InteroperabilityIndex, a text of four bytes, R03, in either order of bytes: as whole entries of EXIF have it
_TRANSFER_FUNCTION, _WHITE, _PRIMARIES = 301, 318, 319  # tags of a TIFF
_BIG = 43  # second word of a TIFF of more than 4 GiB
_RATIONAL = 5
_NUMBERS = {3: "u2", 4: "u4", _RATIONAL: "u4", 11: "f4", 12: "f8"}  # types of a tag
_MOST_TAGS, _MOST_NUMBERS = 1000, 3 << 16
_SAME_CURVE = 0.01  # of full light, by which tables of sRGB differ
_OPTIONAL_COLOURS = [struct.pack(order + "HHI4s", 1, 2, 4, b"R03") for order in "<>"]


def said_colours(path: Path, kind: str, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """What is to be added to a header, under OpenImageIO's names; nothing where there is an ICC profile.

    Parameters
    ----------
    path : Path
        Of an image that was read.
    kind : str
        OpenImageIO's name of its format.
    attributes : mapping
        Its header.
    """
    if "ICCProfile" in attributes:
        return {}
    if kind == "png":
        primaries = _primaries_of_png(path)
        return {"chromaticities": primaries} if primaries else {}
    if kind == "tiff":
        return _colours_of_tiff(path)
    if kind == "bmp":
        return _profile_of_bmp(path)
    if attributes.get("Exif:ColorSpace") == _UNCALIBRATED and _is_adobe_rgb(path):
        return {"oiio:ColorSpace": "g22_adobergb_scene"}
    return {}


def _profile_of_bmp(path: Path) -> dict[str, Any]:
    """The ICC profile of one whose header has its fifth version."""
    with path.open("rb") as file:
        head = file.read(_BMP_HEADER + _BMP_5)
        size, kind, place, length = struct.unpack("<I52x4s52xII4x", head[_BMP_HEADER:].ljust(_BMP_5, b"\0"))
        if size != _BMP_5 or kind != b"DEBM":  # embedded, from the last letter to the first
            return {}
        file.seek(_BMP_HEADER + place)
        return {"ICCProfile": np.frombuffer(file.read(length), np.uint8)}


def _primaries_of_png(path: Path) -> tuple[float, ...] | None:
    """x and y of red, green, blue and white of the chunk cHRM."""
    primaries = None
    with path.open("rb") as file:
        file.seek(8)
        while len(head := file.read(8)) == 8:
            length, name = struct.unpack(">I4s", head)
            if name in _BEFORE_PRIMARIES:
                return None
            if name == b"IDAT":
                break
            data = file.read(length + 4)
            if name == b"cHRM" and length == 32 and len(data) == 36:
                x = [value / 1e5 for value in struct.unpack(">8I", data[:32])]
                primaries = (*x[2:], *x[:2])
    return primaries


def _colours_of_tiff(path: Path) -> dict[str, Any]:
    """Primaries and white of its tags, and whether its TransferFunction is another curve than sRGB's.

    A white alone is that of Rec.709's primaries, and primaries alone are seen in Rec.709's white.
    """
    tags = _tags_of_tiff(path)
    said: dict[str, Any] = {}
    if tags[_WHITE] or tags[_PRIMARIES]:
        said["chromaticities"] = (*(tags[_PRIMARIES] or REC709[:6]), *(tags[_WHITE] or REC709[6:]))
    if curve := tags[_TRANSFER_FUNCTION]:
        channels = 1 if len(curve) % 3 else 3  # a table of a power of two each
        tables = np.reshape(curve, (channels, -1)) / 65535
        if np.abs(tables - srgb_to_linear(np.linspace(0, 1, tables.shape[1]))).max() > _SAME_CURVE:
            said["tiff:TransferFunction"] = "not sRGB"
    return said


def _tags_of_tiff(path: Path) -> dict[int, tuple[float, ...]]:
    """Numbers of a TIFF's tags; empty where it has not got them, or they are cut."""
    found: dict[int, tuple[float, ...]] = dict.fromkeys((_TRANSFER_FUNCTION, _WHITE, _PRIMARIES), ())
    with path.open("rb") as file:

        def read(form: str) -> tuple[Any, ...]:
            return struct.unpack(order + form, file.read(struct.calcsize(order + form)))

        try:
            order = "<" if file.read(2) == b"II" else ">"
            big = read("H")[0] == _BIG
            offset, room = ("Q", 8) if big else ("I", 4)
            file.seek(read(f"4x{offset}" if big else offset)[0])
            (entries,) = read("Q" if big else "H")
            for at in range(file.tell(), file.tell() + min(entries, _MOST_TAGS) * (4 + 2 * room), 4 + 2 * room):
                file.seek(at)
                tag, kind, count = read(f"HH{offset}")
                if tag in found and kind in _NUMBERS and count <= _MOST_NUMBERS:
                    numbers, each = np.dtype(order + _NUMBERS[kind]), 2 if kind == _RATIONAL else 1
                    if numbers.itemsize * each * count > room:
                        file.seek(read(offset)[0])
                    values = np.frombuffer(file.read(numbers.itemsize * each * count), numbers).astype(float)
                    if len(values) == each * count:
                        with np.errstate(all="ignore"):  # a rational of 0 / 0 is told where it is used
                            found[tag] = tuple((values[::2] / values[1::2] if each == 2 else values).tolist())
        except (OSError, ValueError, OverflowError, struct.error):
            pass
    return found


def _is_adobe_rgb(path: Path) -> bool:
    """Whether EXIF says so in the way of cameras: DCF's optional colours, R03."""
    data = path.read_bytes()
    return any(entry in data for entry in _OPTIONAL_COLOURS)
