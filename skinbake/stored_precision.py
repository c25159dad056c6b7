"""The precision that images are stored in: one rule for the files, and for who must know what a file will hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# A channel that is fainter everywhere would lose digits to half's subnormals (6e-5) within 8 stops of its top
HALF_FAINT = 1.0 / 64


def half_holds(top: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Whether channels of these largest magnitudes are stored as halves: neither past 65504 nor all but black.

    A channel that is 0 everywhere is, too; one with a NaN is not.
    """
    with np.errstate(over="ignore"):
        half = top.astype(np.float16)
    return (top == 0) | ((half >= HALF_FAINT) & (half < np.inf))


def channels_half_holds(values: NDArray[Any], half: NDArray[np.float16]) -> NDArray[np.bool_]:
    """Whether each channel of (H, W, C) keeps its three digits in half, shadows included; shape (C,).

    Parameters
    ----------
    values : ndarray of shape (H, W, C)
    half : ndarray of shape (H, W, C), float16
        The same, rounded (`as_half`).
    """
    # Integers compare fast, and in the order of the magnitudes; the sign is the top bit
    rows = half.view(np.uint16).reshape(len(half), -1)
    most = rows.max(axis=0, initial=0)
    if (most & 0x8000).any():
        most = np.maximum(most & 0x7FFF, rows.view(np.int16).max(axis=0, initial=0).astype(np.uint16))
    top = most.reshape(half.shape[1:]).max(axis=0, initial=0).view(np.float16)
    holds = half_holds(top)
    for channel in np.flatnonzero(top == 0):
        holds[channel] = not values[..., channel].any()  # or it was too faint for half
    return holds


def as_stored(values: NDArray[Any], precision: str) -> NDArray[Any]:
    """Values of shape (..., H, W, C) as a file gives them back: each channel rounded as the writer would.

    Parameters
    ----------
    values : ndarray
    precision : "half" or "float"

    Returns
    -------
    ndarray of the same shape
        float16 where every channel is stored as such, else float32; halves as they are.
    """
    from skinbake.kernels.half import as_half

    if precision != "half" or values.dtype == np.float16:
        return values
    half = as_half(values)
    holds = np.array([channels_half_holds(values[i], half[i]) for i in np.ndindex(values.shape[:-3])])
    if holds.all():
        return half
    out = half.astype(np.float32)
    for *index, channel in np.argwhere(~holds.reshape(*values.shape[:-3], -1)):
        out[*index, ..., channel] = values[*index, ..., channel]
    return out
