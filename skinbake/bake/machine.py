"""What this process has of the machine, and takes of it."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
from contextlib import suppress


def peak_memory_mib() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def give_back_freed() -> None:
    """Return what was freed to the system. Glibc keeps it for the next array, which is seldom of a size that fits: a
    third of a gigabyte after the lobes of 2048^2.
    """
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def processors() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
