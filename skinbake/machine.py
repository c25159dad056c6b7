"""What this process has of the machine, and takes of it."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
from contextlib import suppress

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8  # of glibc's mallopt; a threshold of -1 is never reached


def peak_memory_mib() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def reuse_freed() -> None:
    """Have freed memory serve the next array, whichever thread made either, instead of going back to the system.

    The system clears each page that it gives: for the twenty large arrays that a bake makes and lets go, a twelfth of
    all processor time. No more is held at the peak than before, as arrays come in few sizes.
    """
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # another C library
            glibc = ctypes.CDLL("libc.so.6")
            for parameter, value in ((_ARENA_MAX, 1), (_MMAP_MAX, 0), (_TRIM_THRESHOLD, -1)):
                glibc.mallopt(parameter, value)


def physical_memory_bytes() -> int:
    """Memory that this machine has, bytes."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
