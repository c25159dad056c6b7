"""What the values of a picture must be: decoded, finite, of so many channels, in their range, painted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.colour import decode
from skinbake.io.image_file import StoredImage

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
RINGING = 0.05  # of a range of 1 or less, what a sharpening filter may leave beyond it; clamped, more is refused
AGREE = 4 / 255  # between channels of a grey picture: JPEG's noise
BLACK = 4 / 255  # as stored, of a texel that nobody painted; JPEG's noise


def decoded(path: Path, stored: StoredImage, color_space: str, is_data: bool) -> tuple[Image, bool]:
    """A picture in linear Rec.709, and whether it came from other primaries; see `decode`.

    Parameters
    ----------
    path : Path
        For messages.
    stored : StoredImage
    color_space : str
    is_data : bool

    Raises
    ------
    InputError
        A texel is NaN or Inf, before or after.
    """
    if not np.issubdtype(stored.pixels.dtype, np.integer):
        _refuse_non_finite(path, stored.pixels)
    values, moved = decode(path, stored.pixels, stored.attributes, color_space, is_data)
    if not np.issubdtype(stored.pixels.dtype, np.integer):
        _refuse_non_finite(path, values)
    return values, moved


def three_channels(path: Path, values: Image) -> Image:
    """Colours, (h, w, 3): grey is repeated.

    Raises
    ------
    InputError
        There are two channels.
    """
    if values.shape[2] == 2:
        raise InputError(f"{path}: expected colours, or a single channel, got two")
    return np.ascontiguousarray(np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values)


def one_channel(path: Path, values: Image) -> Image:
    """The one channel (h, w, 1), or the mean of three that are the same picture.

    Raises
    ------
    InputError
        They differ, or there are two.
    """
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


def clear_texels(stored: StoredImage) -> Mask:
    """Texels of alpha 0."""
    return stored.alpha <= 0 if stored.alpha is not None else np.zeros(stored.pixels.shape[:2], np.bool_)


def black_texels(stored: StoredImage) -> Mask:
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


def clipped_to(path: Path, values: Image, low: float, high: float) -> Image:
    """Clamp in place what rings, refuse what is further out.

    Parameters
    ----------
    path : Path
        For messages.
    values : ndarray of shape (h, w, channels)
    low, high : float

    Raises
    ------
    InputError
    """
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


def not_negative(path: Path, values: Image) -> Image:
    """Clamp in place what rings about bright texels, refuse what is further below 0.

    Raises
    ------
    InputError
    """
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
