"""What each map of a look makes of its picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.errors import InputError
from skinbake.io.image_file import StoredImage
from skinbake.io.image_values import (
    BLACK,
    RINGING,
    Image,
    Mask,
    black_texels,
    clear_texels,
    clipped_to,
    decoded,
    one_channel,
    three_channels,
)
from skinbake.scene.map_files import (
    DetailMapSpec,
    HeightMapSpec,
    MapSpec,
    NormalMapSpec,
    RoughnessMapSpec,
    ScaledMapSpec,
)
from skinbake.scene.skin import LEAST_RADIUS, MOST_HAEMOGLOBIN, MOST_MELANIN, MOST_RADIUS

HALF_BIT = 2.0**-11  # of a value: how half floats round it
LUMINANCE_RGB = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of Rec.709
UNIT, LEAD = 0.1, 2.0  # mean distance of normals' lengths from 1 that can be; how much further the other encoding's is
SIGNED_SHARE = 1e-3  # of texels with values below -RINGING: no filter's ringing


def _albedo(of: MapSpec, path: Path, stored: StoredImage) -> Image:
    values, moved = decoded(path, stored, of.color_space, False)
    values = three_channels(path, values)
    if (
        moved
    ):  # from other primaries: colours that Rec.709 has not are brought to its edge, only too bright ones refused
        clipped_to(path, (values @ LUMINANCE_RGB)[..., None], 0.0, 1.0)
        np.clip(values, 0, 1, out=values)
    values = clipped_to(path, values, 0.0, 1.0)
    return 1 - values if of.invert else values


def _factor(of: MapSpec, path: Path, stored: StoredImage) -> Image:
    values = clipped_to(path, _data(of, path, stored), 0.0, 1.0)[..., 0]
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
    return clipped_to(path, values, low, high)[..., 0]


def _radius(of: ScaledMapSpec, path: Path, stored: StoredImage) -> Image:
    try:
        return _scaled(of, path, stored, 0.0, MOST_RADIUS)  # black, where nobody painted, is 0 until it is filled
    except InputError as error:
        raise InputError(f"{error}: expected factors on the profile's width") from error


def refuse_narrow(path: Path, values: Image, on_chart: Mask | None) -> Image:
    """Factors on the profile's width with those that no skin reads clamped; refuse narrower ones on the skin.

    Parameters
    ----------
    path : Path
        For messages.
    values : ndarray of shape (h, w)
    on_chart : ndarray of bool, optional
        Where skin reads them; everywhere unless given.

    Raises
    ------
    InputError
    """
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
    return one_channel(path, decoded(path, stored, of.color_space, True)[0])


def ggx_as_beckmann(roughness: Image) -> Image:
    """Beckmann m of the roughness r that painters and glTF mean, whose GGX lobe has alpha = r^2.

    m = r^2: both lobes are then as high at the centre of a highlight, D = 1 / (pi m^2) [Walter2007]; GGX's tail, which
    Beckmann has not, is lost.
    """
    return roughness * roughness


def _normals(of: NormalMapSpec | DetailMapSpec, path: Path, stored: StoredImage) -> Image:
    values, _ = decoded(path, stored, of.color_space, True)
    count = values.shape[2]
    if count == 1:
        raise InputError(f"{path}: expected normals in two or three channels, got one; maps.height takes heights")
    two = count == 2 or (values[..., 2].max() <= BLACK and values[..., 2].min() >= -BLACK)
    if two and isinstance(of, NormalMapSpec) and of.space == "object":
        raise InputError(
            f"{path}: expected normals in three channels with space: object, got two; z may point either way there"
        )
    encoding: str = of.encoding
    if encoding == "auto":
        painted = ~(clear_texels(stored) | black_texels(stored))
        integers = {"u": "unsigned", "i": "signed"}
        encoding = integers.get(stored.pixels.dtype.kind) or _encoding(path, values[painted], two)
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


READERS: dict[str, Callable[[Any, Path, StoredImage], Image]] = {  # of maps, by key
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
