"""The precision that images are stored in: one rule for the files, and for who must know what a file will hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Zeros

# A channel that is fainter everywhere would lose digits to half's subnormals (6e-5) within 8 stops of its top
HALF_FAINT = 1.0 / 64


def half_holds(top: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Whether channels of these largest magnitudes are stored as halves: neither past 65504 nor all but black.

    A channel that is 0 everywhere is, too; one with a NaN is not.
    """
    with np.errstate(over="ignore"):
        half = top.astype(np.float16)
    return (top == 0) | ((half >= HALF_FAINT) & (half < np.inf))


def half_keeps(values: NDArray[Any], half: NDArray[np.float16]) -> bool:
    """Whether every channel of an image keeps its three digits in half, shadows included.

    An image is stored in one precision: many programs, the OpenEXR module among them, refuse colours of two.

    Parameters
    ----------
    values : ndarray of shape (H, W, C)
    half : ndarray of shape (H, W, C), float16
        The same, rounded (`as_half`).
    """
    from skinbake.kernels.half import largest_bits

    top = largest_bits(half).view(np.float16)
    faint = (top == 0) & values.any(axis=(0, 1)) if (top == 0).any() else False  # too faint for half
    return bool(half_holds(top).all() and not np.any(faint))


def as_stored(values: NDArray[Any], precision: str) -> NDArray[Any]:
    """Values of shape (..., H, W, C) as a file gives them back: each image rounded as the writer would.

    Parameters
    ----------
    values : ndarray
    precision : "half" or "float"

    Returns
    -------
    ndarray of the same shape
        float16 where every image is stored as such, else float32; halves as they are.
    """
    from skinbake.kernels.half import as_half

    if precision != "half" or values.dtype == np.float16:
        return values
    half = as_half(values)
    holds = np.array([half_keeps(values[i], half[i]) for i in np.ndindex(values.shape[:-3])])
    if holds.all():
        return half
    holds = holds.reshape(*values.shape[:-3], 1, 1, 1)
    return np.where(holds, half.astype(np.float32), values).astype(np.float32)


def as_stored_with_sum(
    images: NDArray[np.float32], precision: str, empty: Zeros = np.empty
) -> tuple[NDArray[Any], NDArray[Any]]:
    """`as_stored` of images, and of their sum, which is taken before they are rounded; read once where half holds all.

    Parameters
    ----------
    images : ndarray of shape (L, H, W, C), float32
    precision : "half" or "float"
    empty : callable, optional
        Makes the arrays, all of which is written.
    """
    from skinbake.kernels.half import as_half_with_sum

    if precision == "half" and images.dtype == np.float32 and images.flags.c_contiguous:
        half, total = empty(images.shape, np.float16), empty(images.shape[1:], np.float16)
        as_half_with_sum(images, half, total)
        # A channel of the sum is 0 only where it is 0 in all of them
        whole = (*zip(images, half, strict=True), (images[0], total))
        if all(half_keeps(*each) for each in whole):
            return half, total
    return as_stored(images, precision), as_stored(images.sum(axis=0, dtype=np.float32), precision)
