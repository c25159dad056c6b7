"""Pictures that OpenImageIO reads otherwise than their files say, without a word: refused by what they are."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError

# What the values of a TIFF are, by its tag PhotometricInterpretation: such as are read right, and names of others
_WHITE_IS_ZERO, _READ_RIGHT = 0, (1, 2, 3, 4, 5, 6)  # grey, RGB, palette, mask, CMYK, YCbCr
_OTHERS = {0: "grey of more than 8 bits whose white is 0", 8: "CIELAB", 9: "ICC Lab", 10: "ITU Lab",
           32803: "a camera's raw mosaic", 32844: "LogL", 32845: "LogLuv", 34892: "a camera's raw colours"}  # fmt: skip
_REDUCED = 1  # bit of a page's kind
_BITFIELDS, _BGR_MASKS = 3, (0xFF0000, 0xFF00, 0xFF)
_PSD_HEADER = 26  # bytes
_NO_COMPOSITE = re.compile(rb"8BIM\x04\x21.{6}\x00\x00\x00\x01\x00", re.DOTALL)  # resource 1057: no real merged data


def refuse_misread(path: Path, kind: str, attributes: Mapping[str, Any], pixels: NDArray[Any]) -> None:
    """Refuse what would come out in other colours, or as another picture, than any program shows.

    Parameters
    ----------
    path : Path
        Of an image that was read.
    kind : str
        OpenImageIO's name of its format.
    attributes : mapping
        Its header.
    pixels : ndarray
        As stored.

    Raises
    ------
    InputError
        By the name of what the file holds, with what to do.
    """
    got = ""
    if kind == "tiff":
        got = _tiff(attributes, pixels.dtype)
    elif kind == "bmp":
        got = _bmp(path)
    elif kind == "psd":
        got = _psd(path)
    if got:
        raise InputError(f"{path}: expected a plain picture, got {got}; save it as RGB, or as PNG")


def _tiff(attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> str:
    """What a TIFF holds that is not read right, or nothing."""
    if attributes.get("tiff:subfiletype", 0) & _REDUCED:
        return "a thumbnail before the picture"
    meant = attributes.get("tiff:PhotometricInterpretation", _READ_RIGHT[0])
    right = meant in _READ_RIGHT or (meant == _WHITE_IS_ZERO and dtype == np.uint8)
    return "" if right else _OTHERS.get(meant, f"PhotometricInterpretation {meant}")


def _bmp(path: Path) -> str:
    """What a BMP holds that is not read right, or nothing: the order of channels is ignored where they take 32 bits."""
    with path.open("rb") as file:
        head = file.read(66)
    if len(head) < 66:
        return ""
    bits, packing = struct.unpack_from("<HI", head, 28)
    masks = struct.unpack_from("<3I", head, 54)
    shuffled = bits == 32 and packing == _BITFIELDS and masks != _BGR_MASKS
    return "32 bits whose channels lie in another order" if shuffled else ""


def _psd(path: Path) -> str:
    """What a PSD holds that is not read right, or nothing: without a picture of all layers there is a white one."""
    with path.open("rb") as file:
        file.seek(_PSD_HEADER)
        for _ in range(2):  # colours of a palette, then resources
            section = file.read(int.from_bytes(file.read(4), "big"))
    return "layers alone (saved without Maximize Compatibility)" if _NO_COMPOSITE.search(section) else ""
