"""Header of a Radiance picture (`.hdr`): which way its rows run, and what its colours are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError

_LARGEST = 1 << 16  # bytes of a header
_RESOLUTION = re.compile(rb"^([+-])([XY]) (\d+) ([+-])([XY]) (\d+)$")
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)


@dataclass(frozen=True)
class RadianceHeader:
    """What the header says.

    Attributes
    ----------
    slow, fast : str
        The axis along which rows follow each other and that along which pixels do, as "-Y" (down) or "+X" (to the
        right).
    chromaticities : tuple of 8 floats or None
        Where colours are other than Radiance's usual ones, which everybody takes for Rec.709.
    applied : tuple of floats
        By what the pixels have been multiplied since they were radiance, channel by channel: EXPOSURE and COLORCORR,
        each as often as the header has it.
    """

    slow: str
    fast: str
    chromaticities: tuple[float, ...] | None
    applied: tuple[float, ...] = (1.0, 1.0, 1.0)

    def upright(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Pixels (rows, columns, c) as they were read, turned so that row 0 is on top and column 0 on the left."""
        if self.slow[1] == "X":
            pixels = pixels.swapaxes(0, 1)
        up, left = "+Y" in (self.slow, self.fast), "-X" in (self.slow, self.fast)
        return np.ascontiguousarray(pixels[:: -1 if up else 1, :: -1 if left else 1])


def read_radiance_header(path: Path) -> RadianceHeader:
    """Read it.

    Raises
    ------
    InputError
        There is no resolution line, or a line of numbers holds something else.
    """
    with open(path, "rb") as file:
        lines = file.read(_LARGEST).split(b"\n")
    chromaticities: tuple[float, ...] | None = None
    applied = np.ones(3)
    for i, line in enumerate(lines):
        found = _RESOLUTION.match(line)
        if found and found[2] != found[5] and i > 0 and not lines[i - 1]:
            slow, fast = (found[1] + found[2]).decode(), (found[4] + found[5]).decode()
            return RadianceHeader(slow, fast, chromaticities, tuple(applied.tolist()))
        for name, count in ((b"EXPOSURE=", 1), (b"COLORCORR=", 3)):
            if line.startswith(name):
                applied *= _factors(path, line, len(name), count)
        if line.startswith(b"FORMAT=") and b"xyze" in line:
            chromaticities = XYZ
        elif line.startswith(b"PRIMARIES=") and chromaticities is None:
            numbers = re.findall(rb"[-+.\deE]+", line[10:])
            try:
                chromaticities = tuple(float(number) for number in numbers)
            except ValueError:
                numbers = []
            if len(numbers) != 8:
                raise InputError(f"{path}: expected PRIMARIES of eight numbers, got {line[:80].decode('latin-1')}")
    raise InputError(f"{path}: expected a resolution line such as -Y 512 +X 1024, found none")


def _factors(path: Path, line: bytes, begin: int, count: int) -> NDArray[np.float64]:
    """Positive numbers of a line of the header, from byte `begin` on.

    Parameters
    ----------
    path : Path
        For messages.
    line : bytes
    begin, count : int

    Raises
    ------
    InputError
        There are not `count` of them.
    """
    try:
        found = np.array([float(word) for word in line[begin:].split()])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not (np.isfinite(found) & (found > 0)).all():
        said = line[:80].decode("latin-1")
        raise InputError(f"{path}: expected {count} number(s) above 0 after {line[: begin - 1].decode()}, got {said}")
    return found
