"""Locks between processes that share a folder. The system drops a lock when its holder dies: none is ever stale.

`filelock` opens, locks and checks the lock file: never through a symbolic link, never one that another process has
removed meanwhile. Ours on top of it: the holder's name in the file, so that who waits can say for whom; the file gone
at the end, so that a finished folder holds results only; file systems without locks, where one works without.
"""

from __future__ import annotations

import errno
import fcntl
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from skinbake.errors import InputError
from skinbake.interrupt import undone_at_stop
from skinbake.io.atomic import explained, temporary_files

LOCK = ".lock"
POLL_S = 0.02  # a process that waits looks this often
_UNKNOWN = {errno.ENOTSUP, errno.ENOLCK, errno.ENOSYS}  # file systems without locks


class Lock:
    """A lock on one file, held by one thread of one process at a time.

    Parameters
    ----------
    path : Path
        The lock file; its folder is made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: tuple[int, int] | None = None
        self._undone = ExitStack()
        self._lock = FileLock(path, poll_interval=POLL_S, on_acquired=self._sign)

    def acquire(self, wait: bool = False) -> bool:
        """Lock the file; False where another one holds it, or with `wait` once that one is gone, however long it takes.

        Raises
        ------
        InputError
            The lock file is a symbolic link, or its folder cannot be written to.
        MachineError
            Disk full.
        """
        self._undone = ExitStack()
        self._undone.enter_context(undone_at_stop(self._remove))
        try:
            return self._acquire(wait)
        finally:
            if self._file is None:
                self._undone.close()

    def _acquire(self, wait: bool) -> bool:
        try:
            with explained(self.path):
                self._lock.acquire(blocking=wait)
        except Timeout:
            return False
        except OSError as error:
            if error.errno == errno.ELOOP:
                raise InputError(
                    f"{self.path}: expected a lock file, got a symbolic link, which is not followed; remove it"
                ) from error
            if error.errno not in _UNKNOWN:
                raise
            self._file = _identity(os.lstat(self.path))
        return True

    def release(self) -> None:
        """Let go of the lock and remove its file, unless somebody put another one in its place."""
        self._remove()
        self._file = None
        self._undone.close()
        self._lock.release()

    def _remove(self) -> None:
        """Remove the lock file, if it is ours."""
        with suppress(OSError):
            if self._file is not None and _identity(os.lstat(self.path)) == self._file:
                self.path.unlink()

    def holder(self) -> str:
        """Holder of the lock, in words; and that it was stopped, where it was."""
        try:
            descriptor = os.open(self.path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            with open(descriptor, errors="replace") as file:
                name = file.read(200)
        except OSError:
            name = ""
        return (name or "another process") + _state(name)

    def _sign(self, descriptor: int) -> None:
        self._file = _identity(os.fstat(descriptor))
        with suppress(OSError):  # a full disk: the lock holds without a name in it
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"process {os.getpid()} on {platform.node()}".encode(), 0)


@contextmanager
def folder_lock(folder: Path | str, say: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold `folder` for one writer, waiting for another one to end; remove what a killed one left half-written.

    Parameters
    ----------
    say : callable, optional
        Told for whom it waits.

    Raises
    ------
    InputError
        The folder cannot be written to, or its lock file is a symbolic link.
    """
    folder = Path(folder)
    with file_lock(folder / LOCK, say=say, name=str(folder)):
        for left in temporary_files(folder):  # nobody else writes here now
            left.unlink(missing_ok=True)
        yield


def remove_leftovers(folder: Path) -> None:
    """Remove what a writer that was killed has left of its lock and its temporary files, if nobody holds the folder."""
    with suppress(OSError):
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_NOFOLLOW)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in temporary_files(folder):
                left.unlink(missing_ok=True)
            (folder / LOCK).unlink()
        finally:
            os.close(descriptor)


@contextmanager
def file_lock(path: Path, say: Callable[[str], None] | None = None, name: str = "") -> Iterator[None]:
    """Hold the lock file `path`, waiting as long as it takes; it is removed at the end.

    Parameters
    ----------
    path : Path
    say : callable, optional
        Told for whom it waits.
    name : str
        What is waited for, where that is not the lock file.

    Raises
    ------
    InputError
        The lock file is a symbolic link, or its folder cannot be written to.
    """
    lock = Lock(path)
    if not lock.acquire():
        if say:
            say(f"{name or path}: waiting for {lock.holder()} to finish with it")
        lock.acquire(wait=True)
    try:
        yield
    finally:
        lock.release()


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def _state(name: str) -> str:
    """`, which is stopped` where the holder is a process of this machine that will not go on by itself."""
    words = name.split()
    if len(words) == 4 and words[1].isdigit() and words[3] == platform.node():
        with suppress(OSError, IndexError):
            if Path(f"/proc/{words[1]}/stat").read_text().rpartition(")")[2].split()[0] in "Tt":
                return f", which is stopped (kill -CONT {words[1]} lets it go on)"
    return ""
