"""Arrays that are wanted again later and stand in no memory meanwhile: in temporary files without a name.

A bake makes each of its textures long before they are written and drawn. Kept in memory, they would be half of what it
takes at its peak.
"""

from __future__ import annotations

import mmap
import os
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, TypeVar
from weakref import WeakSet, finalize, ref

import numpy as np
from numpy.typing import DTypeLike, NDArray

from skinbake.kernels.threads import for_slices
from skinbake.machine import MappedMemory, make_pages
from skinbake.numerics import memory_of

Kind = TypeVar("Kind", bound=np.generic)
_SMALLEST = 1 << 20  # bytes: less is not worth a file
MOST_READ = 512 << 20  # bytes of files that are in memory at a time, about
MOST_IDLE = 512 << 20  # bytes of files that no array is in any more, and that serve the next ones
_ROOMY = 2.5  # times what an array takes: a larger file is not given to it
_AT_ONCE = 1 << 26  # bytes that are copied at a time; whole pages
_MAPPED = 1 << 24  # bytes that a thread makes pages of at a time; whole pages
_LOOK_S, _FAR_S = 0.01, 0.04  # between looks at how much there is, near the limit and below half of it


class Spool:
    """Keeps arrays in temporary files, which are gone when the arrays are, or when the process is killed.

    However large they are, and whatever reads them, `most_read` bytes of them are in this process's memory at a time:
    a thread watches, and lets all go where it is more. What is read still is then read again from the system's own
    copy of the file, which it frees by itself where memory is short.

    The file of an array that is gone serves the next one of about its size: a system that makes and clears new pages of
    a file takes several times as long as clearing those that are there, and a bake makes 4 GiB of such arrays at
    2048 x 2048, one after the other.

    Parameters
    ----------
    folder : Path, optional
        Where the files are; without one, or where they cannot be made, arrays stay in memory.
    most_read : int, optional
        Bytes; `MOST_READ` by default.
    """

    def __init__(self, folder: Path | None = None, most_read: int | None = None) -> None:
        self._folder, self._most_read = folder, MOST_READ if most_read is None else most_read
        self._files: WeakSet[mmap.mmap] = WeakSet()
        self._idle: list[mmap.mmap] = []
        self._lock = threading.Lock()
        self._watched = False

    @property
    def on_disk(self) -> bool:
        """Whether there is a folder for files."""
        return self._folder is not None

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """An array of zeros to be filled, in a file from the beginning: whoever makes a large array saves a copy.

        Parameters
        ----------
        shape : tuple of int
        dtype : dtype
        """
        return self._made(shape, np.dtype(dtype), np.zeros)

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """As `zeros`, with anything in it: for who fills all of it.

        Parameters
        ----------
        shape : tuple of int
        dtype : dtype
        """
        return self._made(shape, np.dtype(dtype), np.empty)

    def _made(self, shape: tuple[int, ...], dtype: np.dtype[Any], otherwise: Callable[..., Any]) -> NDArray[Any]:
        """An array in a file, cleared where `otherwise` is `np.zeros`; by `otherwise` where it is in none."""
        size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
        content = self._file(size, otherwise is np.zeros) if size >= _SMALLEST else None
        made: NDArray[Any] = otherwise(shape, dtype) if content is None else content.view(dtype).reshape(shape)
        return made

    def keep(self, values: NDArray[Kind]) -> NDArray[Kind]:
        """The same values, to be read from a file as they are asked for; the same array where it is one already."""
        if self._folder is None or values.nbytes < _SMALLEST or isinstance(memory_of(values), mmap.mmap):
            return values
        values = np.ascontiguousarray(values)
        kept = self._file(values.nbytes, clear=False)
        if kept is None:
            return values
        content = memory_of(kept)
        assert isinstance(content, mmap.mmap)
        for begin in range(0, values.nbytes, _AT_ONCE):  # four times as fast as `write`
            part = slice(begin, min(begin + _AT_ONCE, values.nbytes))
            kept[part] = values.view(np.uint8).reshape(-1)[part]
            content.madvise(mmap.MADV_DONTNEED, begin, part.stop - begin)
        return kept.view(values.dtype).reshape(values.shape)

    def keep_all(self, images: dict[int, Any]) -> dict[int, Any]:
        """A tile's arrays each, as `keep`."""
        return {tile: self.keep(image) for tile, image in images.items()}

    def rest(self) -> None:
        """Free the memory of what was read since; it is read again from the files where it is asked for again."""
        for content in self._contents():
            content.madvise(mmap.MADV_DONTNEED)

    def rest_of(self, *arrays: NDArray[Any]) -> None:
        """As `rest`, of some arrays alone: others may be in use."""
        for each in arrays:
            content = memory_of(each)
            if isinstance(content, mmap.mmap):
                content.madvise(mmap.MADV_DONTNEED)

    def _file(self, size: int, clear: bool) -> NDArray[np.uint8] | None:
        """Bytes of a file, zeros if `clear`; None where there can be none.

        Memory does as well: what the disk lacks is told when files are written that stay.
        """
        if self._folder is None:
            return None
        content = self._taken(size)
        new = content is None
        if content is None:
            content = self._new(self._folder, size)
        if content is None:
            return None
        whole = np.frombuffer(content, np.uint8)
        _map(content, whole.ctypes.data, size, size > self._most_read // 2)
        finalize(whole, _give_back, ref(self), content).atexit = False
        if clear and not new:
            whole[:size].fill(0)
        return whole[:size]

    def _taken(self, size: int) -> mmap.mmap | None:
        """The smallest idle file that is large enough, and not much larger."""
        with self._lock:
            fits = [each for each in self._idle if size <= len(each) <= _ROOMY * size]
            if not fits:
                return None
            content = min(fits, key=len)
            self._idle.remove(content)
            return content

    def _new(self, folder: Path, size: int) -> mmap.mmap | None:
        """A new file of zeros; None where it cannot be made, also without the idle ones."""
        for last in (False, True):
            try:
                with TemporaryFile(dir=folder) as file:
                    _reserve(file, size)  # or a full disk would end the process at a write
                    content = mmap.mmap(file.fileno(), size)  # shared: what is changed is not lost by `rest`
            except OSError:
                if last or not self._idle:
                    return None
                self._idle.clear()
                continue
            self._add(content)
            return content
        return None

    def give_back(self, content: mmap.mmap) -> None:
        """Keep a file that no array is in any more, unless enough of them wait. Takes no lock: called at any time."""
        content.madvise(mmap.MADV_DONTNEED)
        if sum(map(len, tuple(self._idle))) + len(content) <= MOST_IDLE:
            self._idle.append(content)

    def _contents(self) -> list[mmap.mmap]:
        with self._lock:
            return list(self._files)

    def _add(self, content: mmap.mmap) -> None:
        with self._lock:
            self._files.add(content)
            watch = not self._watched and sum(map(len, self._files)) > self._most_read
            self._watched |= watch
        if watch:
            threading.Thread(target=_watch, args=(ref(self), self._most_read), name="spool", daemon=True).start()


def _give_back(to: ref[Spool], content: mmap.mmap) -> None:
    """Have a spool keep a file for its next array, if there still is one."""
    spool = to()
    if spool is not None:
        spool.give_back(content)


def _reserve(file: IO[bytes], size: int) -> None:
    """Make a new file as large as it will be, with room for it on the disk.

    Raises
    ------
    OSError
        There is no room.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    for begin in range(0, size, _AT_ONCE):
        file.write(bytes(min(_AT_ONCE, size - begin)))
    file.flush()


def _map(content: mmap.mmap, address: int, size: int, large: bool) -> None:
    """Have the system make and map pages of a file at once: two threads that miss them take thrice the time.

    Parameters
    ----------
    content : mmap
    address : int
        Where its first byte is.
    size : int
        Bytes that are wanted, from the first one.
    large : bool
        Whether it is too much to stay in memory until it is used: its pages are made all the same.
    """

    def some(part: slice) -> None:
        if make_pages(address + part.start, part.stop - part.start) and large:
            content.madvise(mmap.MADV_DONTNEED, part.start, part.stop - part.start)

    for_slices(some, size, _MAPPED)


def _watch(of: ref[Spool], most_read: int) -> None:
    """Have a spool rest whenever more than so many bytes were read since it last did, for as long as it is there."""
    pause = threading.Event()
    with MappedMemory() as mapped:
        least = mapped.bytes()
        while (spool := of()) is not None:
            now = mapped.bytes()
            least = min(least, now)
            if now - least > most_read:
                spool.rest()
                # What stays is other than ours, but for what is read again already: so it is believed by and by
                least = min(mapped.bytes(), least + most_read // 16)
            del spool
            pause.wait(_LOOK_S if 2 * (now - least) > most_read else _FAR_S)  # a look takes .1 ms of a processor
