"""Floats as 8-bit pictures that a page carries, and what that costs."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.io.webp import webp_bytes, webp_pixels


@dataclass(frozen=True)
class CodedImage:
    """A picture of 8 bits a channel that stands for floats.

    Attributes
    ----------
    record : dict
        As the page reads it: `data` (WebP, base64), `width`, `height`, `channels`, `coding`, `low`, `high`.
    rms, norm : float
        Root mean squares of what the coding changes, and of the values.
    """

    record: dict[str, Any]
    rms: float
    norm: float


def coded(image: NDArray[np.floating], coding: str, lossless: bool = False) -> CodedImage:
    """Code an image in 8 bits a channel, its range a channel kept beside it.

    Parameters
    ----------
    image : ndarray of shape (h, w) or (h, w, 3)
    coding : "sqrt" or "linear"
        Light is coded by its square root, which spares the dark; it has no negative values.
    lossless : bool
        Normals and roughness: what WebP loses there would show in highlights.
    """
    values = np.asarray(image, np.float32)
    channels = 1 if values.ndim == 2 else 3
    rgb = np.repeat(values[..., None], 3, axis=2) if channels == 1 else values
    low = np.zeros(3, np.float32) if coding == "sqrt" else rgb.min(axis=(0, 1))
    high = rgb.max(axis=(0, 1))
    share = np.clip((rgb - low) / np.where(high > low, high - low, np.float32(1)), 0, 1)
    data = webp_bytes(np.rint(255 * (np.sqrt(share) if coding == "sqrt" else share)).astype(np.uint8), lossless)
    back = webp_pixels(data).astype(np.float32) / 255
    error = (low + (high - low) * (back**2 if coding == "sqrt" else back)) - rgb
    norm = float(np.sqrt(np.mean(rgb**2, dtype=np.float64)))
    record = {
        "data": base64.b64encode(data).decode("ascii"),
        "width": rgb.shape[1],
        "height": rgb.shape[0],
        "channels": channels,
        "coding": coding,
        "low": [float(x) for x in low],
        "high": [float(x) for x in high],
    }
    return CodedImage(record, float(np.sqrt(np.mean(error**2, dtype=np.float64))), norm)


def halves(image: NDArray[np.floating]) -> dict[str, Any]:
    """Record of an image (h, w, 4) that is kept as half floats: for small ones whose digits count."""
    data = np.ascontiguousarray(image, "<f2").tobytes()
    height, width, channels = image.shape
    text = base64.b64encode(data).decode("ascii")
    return {"data": text, "width": width, "height": height, "channels": channels, "coding": "half"}
