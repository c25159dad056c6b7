"""Lobes that are packed while others are made: what their headers say is known when all are.

Packing is a fifth of a bake's processor time, and a blur leaves processors idle now and then.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from skinbake.interrupt import undone_at_stop
from skinbake.io.exr import Part, pack_parts, rgb_channels
from skinbake.io.irradiance import LIGHT, TOTAL
from skinbake.io.spool import Spool


class _Packed(NamedTuple):
    """A file of one tile of a lobe.

    Attributes
    ----------
    rgb : ndarray of shape (L, h, w, 3)
        The pixels: as long as they are held, no other array is taken for them.
    lights : tuple of str
        Names of the parts besides the total.
    path : Path
    """

    rgb: NDArray[Any]
    lights: tuple[str, ...]
    path: Path


class PackedLobes:
    """Packed pixels that wait for their headers, in temporary files.

    Parameters
    ----------
    folder : Path
        Where the lobes will be, too.
    precision, compression : str
        As of `write_parts`.
    spool : Spool
        Has the pixels.
    """

    def __init__(self, folder: Path, precision: str, compression: str, spool: Spool) -> None:
        self._folder, self._how, self._spool = folder, (precision, compression), spool
        self._packed: dict[int, _Packed] = {}
        self._files = ExitStack()
        self._count = 0

    def pack(self, rgb: NDArray[Any], total: NDArray[Any], lights: tuple[str, ...]) -> None:
        """Pack a tile of a lobe.

        Parameters
        ----------
        rgb : ndarray of shape (L, h, w, 3)
        total : ndarray of shape (h, w, 3)
        lights : tuple of str
            Names of those that get parts of their own: the first of `rgb`.

        Raises
        ------
        InputError, MachineError
            As `write_parts`.
        """
        if id(rgb) in self._packed:
            return
        path = self._folder / f".packed_{self._count}.{os.getpid()}.part.exr"
        self._count += 1
        self._files.callback(_remove, path)
        self._files.enter_context(undone_at_stop(partial(os.unlink, path)))
        pack_parts(path, lobe_parts(rgb, total, lights), None, *self._how)
        self._packed[id(rgb)] = _Packed(rgb, lights, path)
        self._spool.rest_of(rgb, total)

    def take(self, rgb: NDArray[Any], lights: tuple[str, ...]) -> Path | None:
        """The file of these pixels with these parts; None where there is none. It stays until `drop`."""
        found = self._packed.get(id(rgb))
        return found.path if found and found.lights == lights else None

    def drop(self, rgb: NDArray[Any]) -> None:
        """Remove the file of these pixels, if there is one."""
        if found := self._packed.pop(id(rgb), None):
            _remove(found.path)

    def close(self) -> None:
        """Remove all files that nobody has taken."""
        self._packed.clear()
        self._files.close()


def lobe_parts(rgb: NDArray[Any], total: NDArray[Any], lights: tuple[str, ...]) -> list[Part]:
    """The parts of a lobe's file: the total, and one a light.

    Parameters
    ----------
    rgb : ndarray of shape (L, h, w, 3)
    total : ndarray of shape (h, w, 3)
    lights : tuple of str
        Names of those that get parts of their own: the first of `rgb`.
    """
    return [
        Part(TOTAL, rgb_channels(total)),
        *(Part(LIGHT + name, rgb_channels(rgb[i])) for i, name in enumerate(lights)),
    ]


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()
