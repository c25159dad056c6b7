"""Linear light to display values: exposure, a view transform that keeps the hue of skin, exact sRGB [IEC61966]."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinbake.numerics import Float, largest_channel

KNEE = 0.6  # below it the picture is linear
DESATURATION = 0.2  # how soon what is far too bright turns white
BLOCK = 4096  # colours that are encoded at a time: all that is between stays in the cache


def srgb_encode(linear: ArrayLike) -> Float:
    """Linear 0 ... 1 to sRGB 0 ... 1, IEC 61966-2-1; clamped."""
    x = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-4), 1 / 2.4) - 0.055)


def roll_off(linear: ArrayLike) -> Float:
    """Linear colours with their highlights compressed into 0 ... 1, shape (..., 3).

    The largest channel alone is bent, by a curve of slope 1 at the knee that tends to 1, and the others keep their
    ratio to it: bending each channel by itself would turn bright skin yellow. What is far brighter than the display
    fades to white.
    """
    rgb = np.maximum(np.asarray(linear, dtype=np.float64), 0.0)
    peak = largest_channel(rgb)[..., None]
    over = np.maximum(peak - KNEE, 0.0)
    bent = np.where(peak > KNEE, 1 - (1 - KNEE) ** 2 / (over + 1 - KNEE), peak)
    scaled = rgb * np.divide(bent, peak, out=np.ones_like(peak), where=peak > 0)
    white = 1 - 1 / (DESATURATION * (peak - bent) + 1)
    return scaled + (bent - scaled) * white


def tonemap(linear: ArrayLike, exposure: float = 0.0) -> NDArray[np.uint8]:
    """8-bit sRGB of linear Rec.709, shape (..., 3).

    Parameters
    ----------
    linear : array_like of shape (..., 3)
    exposure : float
        In stops, after all sums.

    Raises
    ------
    ValueError
        If a value is not finite.
    """
    linear = np.asarray(linear)
    if not np.isfinite(linear).all():
        raise ValueError("tonemap: expected finite values")
    encoded = np.empty(linear.shape, np.uint8)
    colors, bytes_ = linear.reshape(-1, 3), encoded.reshape(-1, 3)
    for start in range(0, len(colors), BLOCK):
        block = colors[start : start + BLOCK].astype(np.float64) * 2.0**exposure
        bytes_[start : start + BLOCK] = np.rint(255 * srgb_encode(roll_off(block)))
    return encoded
