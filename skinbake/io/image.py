"""Single pictures: from files to float32 arrays, linear, row 0 at v = 1, painted wherever they are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.image_file import StoredImage, read_stored
from skinbake.io.image_memory import image_bytes, refuse_beyond_memory
from skinbake.io.image_values import (
    Image,
    clear_texels,
    clipped_to,
    decoded,
    filled,
    not_negative,
    one_channel,
    three_channels,
)


def read_map(path: Path | str, channels: int, assume: str = "auto", color_space: str = "auto") -> Image:
    """One image as (h, w, channels) float32, decoded to linear Rec.709.

    Parameters
    ----------
    path : path of anything OpenImageIO reads
    channels : 1 or 3
        Grey is repeated to three channels; of three that agree, their mean is the one. Alpha is dropped; colours that
        were multiplied by it are divided.
    assume : "auto" or "linear"
        What `color_space: auto` means: "linear" for data; for colours "auto", what the file says, else sRGB for
        integers, linear for floats.
    color_space : str
        What the configuration says, see `decode`.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or a texel is NaN or Inf.
    """
    path = Path(path)
    stored = read_stored(path)
    values, _ = decoded(path, stored, color_space, assume == "linear")
    if channels == 1:
        return one_channel(path, values)
    return three_channels(path, values)


def read_opacity(path: Path | str, or_grey: bool = True) -> Image:
    """What stops light at each texel, 0 ... 1, shape (h, w): the alpha of a picture that has one, else its grey.

    Parameters
    ----------
    path : path
    or_grey : bool
        False: a picture without alpha is opaque.

    Raises
    ------
    InputError
        The file is missing or cannot be read, or leaves its range.
    """
    path = Path(path)
    refuse_beyond_memory({path: image_bytes(path, 3)})
    stored = read_stored(path, divide=False)
    if stored.alpha is not None:
        return clipped_to(path, stored.alpha[..., None], 0.0, 1.0)[..., 0]
    if not or_grey:
        return np.ones(stored.pixels.shape[:2], np.float32)
    grey = decoded(path, stored, "linear", True)[0].mean(axis=2, keepdims=True)
    return clipped_to(path, grey.astype(np.float32), 0.0, 1.0)[..., 0]


def read_radiance(
    path: Path | str,
    layer: str | None = None,
    color_space: str = "auto",
    is_sky: bool = False,
    most: float | None = None,
    infinite: str = "",
) -> Image:
    """Colours of any brightness from a file of somebody else's, (h, w, 3), linear Rec.709, nothing below 0.

    Parameters
    ----------
    path : path
    layer, color_space : str
        As of a map.
    is_sky : bool
        A texture's texels are divided by alpha, and clear ones filled; a sky is what arrives, as it is.
    most : float, optional
        Limit of each channel, infinite ones included.
    infinite : str
        What is said to whoever has infinite values.

    Raises
    ------
    InputError
        As `read_maps`; negative beyond what a filter leaves.
    """
    path = Path(path)
    refuse_beyond_memory({path: image_bytes(path, 3)})
    stored = read_stored(path, layer, divide=not is_sky)
    if is_sky and "hdrgm:Version" in stored.attributes:
        raise InputError(f"{path}: expected radiance, got an Ultra HDR photograph; save it as .hdr or .exr")
    if most is not None:
        stored = StoredImage(_limited(stored.pixels, most), stored.alpha, stored.attributes)
    try:
        values = three_channels(path, decoded(path, stored, color_space, False)[0])
    except InputError as error:
        if infinite and np.isposinf(stored.pixels).any():
            raise InputError(f"{error}; {infinite}") from error
        raise
    values = not_negative(path, values)
    if most is not None:
        np.minimum(values, np.float32(most), out=values)
    return values if is_sky else filled(values, clear_texels(stored))


def _limited(pixels: NDArray[Any], most: float) -> NDArray[Any]:
    """Floats without infinite ones, and at most so large as is asked for, in the file's own type."""
    if np.issubdtype(pixels.dtype, np.integer):
        return pixels
    return np.minimum(pixels, pixels.dtype.type(min(most, float(np.finfo(pixels.dtype).max))))
