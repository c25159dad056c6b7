"""Arrays that are wanted again later and stand in no memory meanwhile: in temporary files without a name.

A bake makes each of its textures long before they are written and drawn. Kept in memory, they would be half of what it
takes at its peak.
"""

from __future__ import annotations

import mmap
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", bound=np.generic)
_SMALLEST = 1 << 20  # bytes: less is not worth a file


class Spool:
    """Keeps arrays in temporary files, which are gone when the arrays are, or when the process is killed.

    Parameters
    ----------
    folder : Path, optional
        Where the files are; without one, or where they cannot be made, arrays stay in memory.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._files: WeakSet[mmap.mmap] = WeakSet()

    @property
    def on_disk(self) -> bool:
        """Whether there is a folder for files."""
        return self._folder is not None

    def keep(self, values: NDArray[Kind]) -> NDArray[Kind]:
        """The same values, to be read from a file as they are asked for."""
        if self._folder is None or values.nbytes < _SMALLEST:
            return values
        values = np.ascontiguousarray(values)
        try:
            with TemporaryFile(dir=self._folder) as file:
                file.write(values.view(np.uint8).reshape(-1).data)
                file.flush()
                content = mmap.mmap(file.fileno(), 0)  # shared: what is changed is not lost by `rest`
        except OSError:  # memory does as well: what the disk lacks is told when files are written that stay
            return values
        self._files.add(content)
        return np.frombuffer(content, values.dtype).reshape(values.shape)

    def keep_all(self, images: dict[int, Any]) -> dict[int, Any]:
        """A tile's arrays each, as `keep`."""
        return {tile: self.keep(image) for tile, image in images.items()}

    def rest(self) -> None:
        """Free the memory of what was read since; it is read again from the files where it is asked for again."""
        for content in list(self._files):
            content.madvise(mmap.MADV_DONTNEED)
