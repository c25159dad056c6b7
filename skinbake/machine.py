"""What this process has of the machine, and takes of it."""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

from skinbake.errors import MachineError

_LIMITS = {"v": (resource.RLIMIT_AS, "VmSize:"), "d": (resource.RLIMIT_DATA, "VmData:")}  # by ulimit's option
_POPULATE_WRITE = 23  # of Linux's madvise
_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8  # of glibc's mallopt; a threshold of -1 is never reached


def peak_memory_mib() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


class MappedMemory:
    """Memory of this process that holds files: libraries, and what it reads of temporary ones. A context manager."""

    def __enter__(self) -> MappedMemory:
        self._status = -1
        with suppress(OSError):
            self._status = os.open("/proc/self/statm", os.O_RDONLY)
        return self

    def __exit__(self, *_: object) -> None:
        if self._status >= 0:
            os.close(self._status)

    def bytes(self) -> int:
        """How much there is now; 0 where the system does not tell."""
        if self._status < 0:
            return 0
        return int(os.pread(self._status, 256, 0).split()[2]) * resource.getpagesize()


def reuse_freed() -> None:
    """Have freed memory serve the next array, whichever thread made either, instead of going back to the system.

    The system clears each page that it gives: for the twenty large arrays that a bake makes and lets go, a twelfth of
    all processor time. No more is held at the peak than before, as arrays come in few sizes.

    NumPy, where it is not loaded yet, asks for no huge pages: most of an atlas is empty, and a virtual machine takes
    1 to 1.5 s to clear a gigabyte of huge pages, and 0.4 s of small ones.
    """
    os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # another C library
            glibc = ctypes.CDLL("libc.so.6")
            for parameter, value in ((_ARENA_MAX, 1), (_MMAP_MAX, 0), (_TRIM_THRESHOLD, -1)):
                glibc.mallopt(parameter, value)


def return_freed() -> None:
    """Give freed memory back to the system after all: where a stage has ended that takes more than those to come."""
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def make_pages(address: int, count: int) -> bool:
    """Have the system make and map the pages of mapped memory at once, to be written to, without Python's lock.

    Parameters
    ----------
    address : int
        Of the first one's beginning.
    count : int
        Bytes.

    Returns
    -------
    bool
        Whether it did: Linux from 5.14 on knows how.
    """
    if not sys.platform.startswith("linux"):
        return False
    return _c_library().madvise(ctypes.c_void_p(address), ctypes.c_size_t(count), _POPULATE_WRITE) == 0


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None)


def free_disk_bytes(folder: Path) -> int:
    """Bytes that are free on the disk where a folder is, or will be."""
    folder = folder.absolute()
    return shutil.disk_usage(next(each for each in (folder, *folder.parents) if each.exists())).free


def physical_memory_bytes() -> int:
    """Memory that this machine has, bytes."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def require_memory(needed_bytes: int, what: str, data_share: float = 1.0) -> None:
    """Stop before a library that cannot tell runs out of what this process may take: Embree, for one, would crash.

    Parameters
    ----------
    needed_bytes : int
        At least.
    what : str
        That needs it.
    data_share : float
        How much of it is data, for a limit on data alone: libraries are not.

    Raises
    ------
    MachineError
        A limit (`ulimit -v` or `-d`) leaves less.
    """
    for option, (limit, field) in _LIMITS.items():
        most, _ = resource.getrlimit(limit)
        if most == resource.RLIM_INFINITY:
            continue
        needed = needed_bytes * (data_share if option == "d" else 1)
        left = max(most - _used_bytes(field), 0)
        if left < needed:
            raise MachineError(
                f"{what} needs {needed / 2**20:.0f} MiB, and the limit of this process (ulimit -{option} "
                f"{most // 2**10}) leaves {left / 2**20:.0f}: raise it"
            )


def _used_bytes(field: str) -> int:
    """What this process has taken, of one kind; 0 where the system does not tell."""
    with suppress(OSError, StopIteration, ValueError), open("/proc/self/status") as status:
        return int(next(line for line in status if line.startswith(field)).split()[1]) * 2**10
    return 0
