"""Floats to half floats, four times as fast as NumPy does it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import for_slices

# Bits of floats without their sign
_INFINITY = 0x7F800000
_TOO_LARGE = 0x47800000  # 65536: from here on half has infinity only
_NORMAL = 0x38800000  # 2^-14: below it half has multiples of 2^-24
_REBIAS = (127 - 15) << 23  # what to take off an exponent
_WHOLE = 2**23  # added to less, it leaves no fraction: the sum is rounded to nearest, ties to even


_SHARE = 2**20  # values that are worth a thread
_AT_ONCE = 2**12  # values
_ROWS = 32  # of an image, the same


def as_half(values: NDArray[Any]) -> NDArray[np.float16]:
    """`values.astype(np.float16)`, C-contiguous: rounded to nearest, ties to even; infinity from 65520 on.

    Parameters
    ----------
    values : ndarray of any shape
        Fast for float32; others are left to NumPy, and halves are as they are.
    """
    if values.dtype != np.float32:
        with np.errstate(over="ignore"):
            return np.asarray(values, dtype=np.float16, order="C")
    flat = np.ascontiguousarray(values).reshape(-1)
    half = np.empty(values.shape, np.float16)
    whole = (flat, flat.view(np.int32), half.reshape(-1).view(np.uint16))
    for_slices(lambda share: _round(*(part[share] for part in whole)), flat.size, _SHARE)
    return half


def as_half_with_sum(images: NDArray[np.float32], half: NDArray[np.float16], total: NDArray[np.float16]) -> None:
    """Images as `as_half`, and so their sum, taken in float32 in their order before it is rounded; read once.

    Parameters
    ----------
    images : ndarray of shape (L, ...), float32, C-contiguous
    half : ndarray of the same shape, float16, C-contiguous
        Written.
    total : ndarray of shape (...), float16, C-contiguous
        Written.
    """
    flat = images.reshape(len(images), -1)
    whole = (flat, flat.view(np.int32), half.view(np.uint16).reshape(flat.shape), total.view(np.uint16).reshape(-1))
    for_slices(lambda share: _round_and_sum(share.start, share.stop, *whole), flat.shape[1], _SHARE)


def largest_bits(half: NDArray[np.float16]) -> NDArray[np.uint16]:
    """Bits of each channel's largest magnitude, (C,), of halves (H, W, C); a NaN is larger than all."""
    rows = half.view(np.uint16).reshape(len(half), half.shape[1] * half.shape[2])
    most = np.zeros((-(-len(rows) // _ROWS), rows.shape[1]), np.uint16)
    for_slices(lambda part: _largest(rows[part], most[part.start // _ROWS]), len(rows), _ROWS)
    bits: NDArray[np.uint16] = most.max(axis=0, initial=0).reshape(-1, half.shape[2]).max(axis=0, initial=0)
    return bits


@kernel
def _largest(rows: NDArray[np.uint16], most: NDArray[np.uint16]) -> None:
    """Largest magnitude of each column of halves, by their bits without the sign; `most` is zero before."""
    for row in range(rows.shape[0]):
        for i in range(rows.shape[1]):
            most[i] = max(most[i], np.uint16(rows[row, i] & np.uint16(0x7FFF)))


@kernel
def _round_and_sum(first, stop, images, bits, half, total):  # type: ignore[no-untyped-def]
    """`as_half_with_sum` of the values `first` to `stop` of each image.

    Parameters
    ----------
    first, stop : int
    images, bits : ndarrays of shape (L, n), float32 and int32
        The same memory.
    half : ndarray of shape (L, n), uint16
        Written.
    total : ndarray of shape (n,), uint16
        Written.
    """
    sums = np.empty(_AT_ONCE, np.float32)
    for begin in range(first, stop, _AT_ONCE):  # in the nearest cache
        end = min(begin + _AT_ONCE, stop)
        line = sums[: end - begin]
        line[:] = images[0, begin:end]
        _round(line, bits[0, begin:end], half[0, begin:end])
        for k in range(1, len(images)):
            for i in range(end - begin):
                line[i] += images[k, begin + i]
            _round(images[k, begin:end], bits[k, begin:end], half[k, begin:end])
        _round(line, line.view(np.int32), total[begin:end])


@kernel
def _round(values: NDArray[np.float32], bits: NDArray[np.int32], half: NDArray[np.uint16]) -> None:
    """Round floats to halves by their bits.

    Parameters
    ----------
    values, bits : ndarrays of shape (n,), float32 and int32
        The same memory.
    half : ndarray of shape (n,), uint16
        Written.
    """
    for i in range(values.size):  # in 32 bits throughout, or it would not be done eight at a time
        magnitude = np.int32(bits[i] & np.int32(0x7FFFFFFF))
        # Adds half a step, less a bit where the last digit kept is even; a carry into the exponent is right, too
        odd = np.int32(np.int32(magnitude >> np.int32(13)) & np.int32(1))
        rounded = np.int32(np.int32(np.int32(magnitude + np.int32(0xFFF - _REBIAS)) + odd) >> np.int32(13))
        # Below half's normal range: a multiple of 2^-24, rounded by adding 2^23
        small = np.float32(min(abs(values[i]), np.float32(1)) * np.float32(2**24))
        subnormal = np.int32(np.int32(np.float32(small + np.float32(_WHOLE))) - np.int32(_WHOLE))
        rounded = rounded if magnitude >= np.int32(_NORMAL) else subnormal
        # Infinity from 65536 on, NaN stays NaN; then the sign
        rounded = rounded if magnitude < np.int32(_TOO_LARGE) else np.int32(0x7C00)
        rounded = rounded if magnitude <= np.int32(_INFINITY) else np.int32(0x7E00)
        half[i] = np.uint16(rounded | np.int32(np.int32(bits[i] >> np.int32(16)) & np.int32(0x8000)))
