"""Locks between processes that share a folder. The system drops a lock when its holder dies: none is ever stale."""

from __future__ import annotations

import errno
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skinbake.io.atomic import explained

LOCK = ".lock"
_UNKNOWN = {errno.ENOTSUP, errno.ENOLCK, errno.ENOSYS}  # file systems without locks


@contextmanager
def folder_lock(folder: Path | str, say: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold `folder` for one writer, waiting for another one to end; remove what a killed one left half-written.

    Raises
    ------
    InputError
        The folder cannot be written to.
    """
    folder = Path(folder)
    with file_lock(folder / LOCK, say=say, name=str(folder)):
        for left in folder.glob(".*.part*"):  # nobody else writes here now
            left.unlink(missing_ok=True)
        yield


@contextmanager
def file_lock(path: Path, say: Callable[[str], None] | None = None, name: str = "") -> Iterator[None]:
    """Hold the lock file `path`, waiting as long as it takes; it is removed at the end.

    Parameters
    ----------
    path : Path
    say : callable, optional
        Told what is waited for.
    name : str
        Name of the thing locked, in place of the path.
    """
    descriptor = try_lock(path)
    if descriptor is None:
        if say:
            say(f"{name or path}: waiting for {holder(path)} to finish with it")
        descriptor = try_lock(path, wait=True)
    try:
        yield
    finally:
        release(path, descriptor)


def try_lock(path: Path, wait: bool = False) -> int | None:
    """Lock `path` and give what `release` wants, or None where another holds it; with `wait`, wait for it."""
    import fcntl

    while True:
        with explained(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if error.errno in _UNKNOWN:
                return descriptor
            os.close(descriptor)
            if error.errno in (errno.EAGAIN, errno.EACCES):
                return None
            raise
        # The holder before us removed the file it had locked: whoever comes now locks another one
        if _is_open(path, descriptor):
            os.ftruncate(descriptor, 0)
            with suppress(OSError):  # a full disk: the lock holds without a name in it
                os.write(descriptor, f"process {os.getpid()} on {platform.node()}".encode())
            return descriptor
        os.close(descriptor)


def release(path: Path, descriptor: int | None) -> None:
    """Release a lock; None is none."""
    if descriptor is None:
        return
    with suppress(OSError):
        if _is_open(path, descriptor):
            path.unlink()
    os.close(descriptor)


def holder(path: Path) -> str:
    """Holder of a lock, in words."""
    with suppress(OSError):
        return path.read_text(errors="replace") or "another process"
    return "another process"


def _is_open(path: Path, descriptor: int) -> bool:
    """Whether the file at `path` is the one that is open as `descriptor`."""
    try:
        there, ours = path.stat(), os.fstat(descriptor)
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)
