"""Stored colours to linear Rec.709: by what the configuration says, else by what the file says, else by its kind."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.icc import IccProfile, parse_icc
from skinbake.numerics import Float

Image = NDArray[np.float32]
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # red, green, blue, white: x, y
XYZ_AXES = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
SAME_PRIMARIES = 2e-3  # x or y, by which writers round
TARGET = "lin_rec709_scene"
SRGB = ("srgb", "srgb_rec709_scene", "srgb_tx", "srgb texture")
LINEAR = ("linear", "lin_rec709_scene", "lin_rec709", "lin_srgb", "scene_linear")
DATA = ("raw", "data", "unknown")


def decode(
    path: Path, pixels: NDArray[Any], attributes: Mapping[str, Any], color_space: str, is_data: bool
) -> tuple[Image, bool]:
    """Linear values of stored ones, and whether their primaries were others than Rec.709's.

    Parameters
    ----------
    path : Path
        For messages.
    pixels : ndarray of shape (h, w, 1 or 3)
        As stored, integers or floats.
    attributes : mapping
        Header of the file, under OpenImageIO's names.
    color_space : str
        "auto", "srgb", "linear" (Rec.709, or plain data) or any name of the OpenColorIO configuration.
    is_data : bool
        What "auto" means: data are taken as they are stored.

    Raises
    ------
    InputError
        A colour space that cannot be converted, by its name.
    """
    if color_space == "auto":
        if is_data:
            return _linear(pixels), False
        return _as_the_file_says(path, pixels, attributes)
    return _named(path, pixels, color_space, "color_space")


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Decode sRGB (IEC 61966-2-1); values past 1 follow the curve, values below 0 its mirror."""
    x = np.abs(np.asarray(encoded, dtype=np.float64))
    return np.copysign(np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), encoded)


def known_color_space(name: str) -> str | None:
    """None for a name that `decode` can convert, else a sentence that says what was expected."""
    if name.lower() in ("auto", *SRGB, *LINEAR, *DATA):
        return None
    config = _config()
    if config.getColorSpaceIndex(name) >= 0:
        return None
    known = ["auto", "srgb", "linear", *config.getColorSpaceNames()]
    known += [alias for space in config.getColorSpaceNames() for alias in config.getAliases(space)]
    close = difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {close[0]}?" if close else ""
    return (
        f"expected auto, srgb, linear, or a colour space of the OCIO configuration {_config_name()}, got {name!r}{hint}"
    )


def primaries_matrix(chromaticities: Sequence[float]) -> Float:
    """Linear values of a space (columns) to linear Rec.709, white to white by Bradford's adaptation, shape (3, 3).

    Parameters
    ----------
    chromaticities : sequence of 8 floats
        x and y of red, green, blue and white, as EXR has them. Where the primaries are the axes of XYZ themselves,
        values are taken as CIE XYZ, without adaptation.
    """
    to_xyz, white = _to_xyz(chromaticities)
    rec709, d65 = _to_xyz(REC709)
    adapt = np.eye(3)
    if not np.allclose(chromaticities[:6], XYZ_AXES, atol=SAME_PRIMARIES):
        adapt = np.linalg.solve(BRADFORD, np.diag((BRADFORD @ d65) / (BRADFORD @ white)) @ BRADFORD)
    return np.asarray(np.linalg.solve(rec709, adapt @ to_xyz), np.float64)


def _to_xyz(chromaticities: Sequence[float]) -> tuple[Float, Float]:
    """Matrix to XYZ, and the XYZ of white at Y = 1."""
    xy = np.asarray(chromaticities, np.float64).reshape(4, 2)
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)])
    white = xyz[3] / xyz[3, 1]
    if np.allclose(chromaticities[:6], XYZ_AXES, atol=SAME_PRIMARIES):
        return np.eye(3), white
    axes = xyz[:3].T
    return axes * np.linalg.solve(axes, white), white


def _as_the_file_says(path: Path, pixels: NDArray[Any], attributes: Mapping[str, Any]) -> tuple[Image, bool]:
    profile = attributes.get("ICCProfile")
    if profile is not None:
        if np.asarray(profile).dtype.kind not in "ui":
            raise InputError(f"{path}: its header's ICC profile is damaged; convert the file to sRGB without one")
        found = _profile(path, bytes(np.asarray(profile, np.uint8)), attributes)
        return (_decoded(pixels, srgb=True), False) if found.is_srgb else _through_profile(pixels, found)
    if "tiff:TransferFunction" in attributes:
        raise InputError(
            f"{path}: its TransferFunction is not that of sRGB; convert the file to sRGB, or say the map's color_space"
        )
    is_float = not np.issubdtype(pixels.dtype, np.integer)
    space, said_by = str(attributes.get("oiio:ColorSpace", "")).strip(), "its header's oiio:ColorSpace"
    primaries = attributes.get("chromaticities")
    if primaries is not None and pixels.shape[2] == 3:
        if np.shape(primaries) != (8,) or np.asarray(primaries).dtype.kind != "f":
            raise InputError(
                f"{path}: its header's chromaticities are damaged: expected 8 floats; write the file again"
            )
        primaries = [float(x) for x in primaries]
        linear = _linear(pixels) if is_float else _named(path, pixels, space or "srgb", said_by)[0]
        if not np.allclose(primaries, REC709, atol=SAME_PRIMARIES):
            return _through_primaries(path, linear, primaries)
        return linear, False
    if is_float and space.lower() in ("", *SRGB):
        # maketx --colorconvert leaves the tag of the file it read on the linear floats that it wrote
        return _linear(pixels), False
    return _named(path, pixels, space or "srgb", said_by)


def _profile(path: Path, data: bytes, attributes: Mapping[str, Any]) -> IccProfile:
    name = attributes.get("ICCProfile:profile_description", "without a name")
    try:
        return parse_icc(data)
    except ValueError as error:
        raise InputError(
            f"{path}: its ICC profile ({name}) {error}; convert the file to sRGB, or say the map's color_space"
        ) from error


def _through_profile(pixels: NDArray[Any], profile: IccProfile) -> tuple[Image, bool]:
    tabled = pixels.dtype in (np.uint8, np.uint16)
    if not tabled:
        pixels = _linear(pixels)
    linear = np.empty(pixels.shape, np.float64)
    for k in range(pixels.shape[2]):
        curve = profile.curves[k]
        if tabled:
            linear[..., k] = curve(_levels(pixels.dtype))[pixels[..., k]]
        else:
            linear[..., k] = curve(pixels[..., k].astype(np.float64))
    other = not np.allclose(profile.matrix, np.eye(3), atol=3e-3)
    if pixels.shape[2] == 3 and other:
        linear = linear @ profile.matrix.T
    return linear.astype(np.float32), other


def _through_primaries(path: Path, linear: Image, primaries: Sequence[float]) -> tuple[Image, bool]:
    try:
        with np.errstate(all="ignore"):  # a white without luminance is refused below
            matrix = primaries_matrix(primaries)
    except np.linalg.LinAlgError:
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        raise InputError(
            f"{path}: expected chromaticities that span colours, got {', '.join(f'{x:g}' for x in primaries)}"
        )
    return (linear.astype(np.float64) @ matrix.T).astype(np.float32), True


def _named(path: Path, pixels: NDArray[Any], space: str, said_by: str) -> tuple[Image, bool]:
    lower = space.lower()
    if lower in SRGB:
        return _decoded(pixels, srgb=True), False
    if lower in LINEAR or lower in DATA:
        return _linear(pixels), False
    import OpenImageIO as oiio

    config = _config()
    if config.equivalent(space, "srgb_rec709_scene"):
        return _decoded(pixels, srgb=True), False
    if config.equivalent(space, TARGET) or config.isData(config.resolve(space)):
        return _linear(pixels), False
    wrong = known_color_space(config.resolve(space))
    if wrong:
        raise InputError(f"{path}: {said_by}: {known_color_space(space)}; the map's color_space can say what it is")
    if config.getColorSpaceIndex(TARGET) < 0:
        raise InputError(
            f"{path}: {said_by}: the OCIO configuration {_config_name()} has no {TARGET} to convert {space} to"
        )
    three = np.ascontiguousarray(np.repeat(_linear(pixels), 3 // pixels.shape[2], axis=2))
    found = oiio.ImageBufAlgo.colorconvert(oiio.ImageBuf(three), space, TARGET, False)
    if found.has_error:
        raise InputError(
            f"{path}: {said_by}: {space} cannot be converted to {TARGET} ({found.geterror().splitlines()[0]})"
        )
    values: Image = np.asarray(found.get_pixels(oiio.FLOAT), np.float32)
    return values.reshape(three.shape)[..., : pixels.shape[2]], pixels.shape[2] == 3


def _config() -> Any:
    import OpenImageIO as oiio

    return oiio.ColorConfig.default_colorconfig()


def _config_name() -> str:
    return os.environ.get("OCIO") or "ocio://default"


def _levels(dtype: np.dtype[Any]) -> Float:
    """Fractions that the levels of 8 or 16 bits stand for."""
    return np.arange(np.iinfo(dtype).max + 1) / np.iinfo(dtype).max


def _linear(pixels: NDArray[Any]) -> Image:
    return _decoded(pixels, srgb=False)


def _decoded(pixels: NDArray[Any], srgb: bool) -> Image:
    """Integers by a table, so that 8 and 16 bits cost one lookup a value; floats directly."""
    if pixels.dtype in (np.uint8, np.uint16):
        levels = _levels(pixels.dtype)
        return (srgb_to_linear(levels) if srgb else levels).astype(np.float32)[pixels]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.iinfo(pixels.dtype).max
    with np.errstate(over="ignore"):  # float64 beyond float32 becomes infinite, and is then refused as such
        return (srgb_to_linear(pixels) if srgb else pixels).astype(np.float32)
