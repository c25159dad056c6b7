"""Arrays of images each of which is wanted once: the memory of those that are done with goes back to the system."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from skinbake.numerics import memory_of

_OWN = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS}  # of a shared mapping, nothing is freed while it lasts


def passing_zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
    """Zeros, parts of which `let_go` takes: an array of `np.zeros` stays in memory as a whole.

    Parameters
    ----------
    shape : tuple of int
    dtype : dtype
    """
    count = int(np.prod(shape, dtype=np.int64))
    content = mmap.mmap(-1, max(count * np.dtype(dtype).itemsize, 1), **_OWN)
    return np.frombuffer(content, dtype, count).reshape(shape)


def let_go(images: NDArray[Any]) -> None:
    """Give whole pages of a part of such an array, one piece of memory, back to the system: it holds anything then."""
    content = memory_of(images)
    if isinstance(content, mmap.mmap):
        begin = images.ctypes.data - np.frombuffer(content, np.uint8).ctypes.data
        first = -(-begin // mmap.PAGESIZE) * mmap.PAGESIZE
        last = (begin + images.nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
        if last > first:
            content.madvise(mmap.MADV_DONTNEED, first, last - first)
