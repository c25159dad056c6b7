"""ICC profiles of RGB and grey images that are made of curves and a matrix, as those of cameras and screens are."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float

Curve = Callable[[Float], Float]
# Linear Rec.709 to XYZ as a profile has it, adapted to D50 by Bradford (ICC sRGB profile, IEC 61966-2-1)
REC709_TO_PCS = np.array(
    [[0.4360747, 0.3850649, 0.1430804], [0.2225045, 0.7168786, 0.0606169], [0.0139322, 0.0971045, 0.7141733]]
)


@dataclass(frozen=True)
class IccProfile:
    """How stored values become linear Rec.709.

    Attributes
    ----------
    curves : tuple of 3 callables
        Stored value (0 ... 1) of red, green and blue to linear.
    matrix : ndarray of shape (3, 3)
        Linear values of the profile (columns) to linear Rec.709.
    """

    curves: tuple[Curve, Curve, Curve]
    matrix: Float

    @property
    def is_srgb(self) -> bool:
        """Whether it is sRGB, as far as its own rounding goes."""
        x = np.linspace(0, 1, 256)
        exact = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
        return bool(
            np.abs(self.matrix - np.eye(3)).max() < 3e-3
            and all(np.abs(curve(x) - exact).max() < 1e-3 for curve in self.curves)
        )


def parse_icc(data: bytes) -> IccProfile:
    """Read a profile.

    Raises
    ------
    ValueError
        It is damaged, of another kind of colour than RGB or grey, or made of tables instead of curves and a matrix; the
        message says which.
    """
    if len(data) < 132 or data[36:40] != b"acsp":
        raise ValueError("is damaged")
    space = data[16:20].decode("ascii", "replace").strip()
    if space not in ("RGB", "GRAY"):
        raise ValueError(f"describes {space} colours")
    (count,) = struct.unpack_from(">I", data, 128)
    tags = {}
    for i in range(min(count, 200)):
        if 144 + 12 * i > len(data):
            raise ValueError("is damaged")
        name, offset, size = struct.unpack_from(">4sII", data, 132 + 12 * i)
        tags[name] = data[offset : offset + size]
    wanted = [b"kTRC"] if space == "GRAY" else [b"rTRC", b"gTRC", b"bTRC", b"rXYZ", b"gXYZ", b"bXYZ"]
    if not set(wanted) <= set(tags) or data[20:24] != b"XYZ ":
        raise ValueError("is made of tables, not of curves and a matrix")
    try:
        if space == "GRAY":
            curve = _curve(tags[b"kTRC"])
            return IccProfile((curve, curve, curve), np.eye(3))
        red, green, blue = (_curve(tags[name]) for name in wanted[:3])
        to_pcs = np.stack([_numbers(tags[name][8:20]) for name in wanted[3:]], axis=1)
    except (struct.error, IndexError) as error:
        raise ValueError("is damaged") from error
    return IccProfile((red, green, blue), np.linalg.solve(REC709_TO_PCS, to_pcs))


def _numbers(data: bytes) -> Float:
    """s15Fixed16 numbers."""
    return np.frombuffer(data[: len(data) // 4 * 4], ">i4").astype(np.float64) / 65536


def _curve(tag: bytes) -> Curve:
    kind = tag[:4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        table = np.frombuffer(tag[12 : 12 + 2 * count], ">u2").astype(np.float64)
        if len(table) != count:
            raise ValueError("is damaged")
        if count == 0:
            return lambda x: x
        if count == 1:
            return lambda x: np.copysign(np.abs(x) ** (table[0] / 256), x)
        return lambda x: np.interp(x, np.linspace(0, 1, count), table / 65535)
    if kind == b"para":
        (form,) = struct.unpack_from(">H", tag, 8)
        if form > 4:
            raise ValueError("has a curve of an unknown form")
        p = _numbers(tag[12 : 12 + 4 * (1, 3, 4, 5, 7)[form]])
        return _parametric(form, p)
    raise ValueError("has a curve of an unknown form")


def _parametric(form: int, p: Float) -> Curve:
    """Y = (a X + b)^g + e from X = d on, c X + f below it; the forms of ICC.1 section 10.18 leave parts of it out."""
    g = p[0]
    a, b, c, d, e, f = 1.0, 0.0, 0.0, -np.inf, 0.0, 0.0
    if form:
        a, b = p[1], p[2]
    if form in (1, 2):
        d = -b / a
    if form == 2:
        e = f = p[3]
    if form >= 3:
        c, d = p[3], p[4]
    if form == 4:
        e, f = p[5], p[6]
    return lambda x: np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f)
