"""Colours that a picture names in words which OpenImageIO passes over: a PNG's primaries, a photograph's Adobe RGB."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_BEFORE_PRIMARIES = (b"iCCP", b"sRGB", b"cICP")  # a PNG that has one of them means nothing by its primaries
_UNCALIBRATED = 65535  # EXIF's ColorSpace of all that is not sRGB
# InteroperabilityIndex, a text of four bytes, R03, in either order of bytes: as whole entries of EXIF have it
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
    if attributes.get("Exif:ColorSpace") == _UNCALIBRATED and _is_adobe_rgb(path):
        return {"oiio:ColorSpace": "g22_adobergb_scene"}
    return {}


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


def _is_adobe_rgb(path: Path) -> bool:
    """Whether EXIF says so in the way of cameras: DCF's optional colours, R03."""
    data = path.read_bytes()
    return any(entry in data for entry in _OPTIONAL_COLOURS)
