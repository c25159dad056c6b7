"""Pixels of an EXR in blocks that zlib unpacks, packed by a kernel in a third of the library's processor time."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.io.exr_header import Attributes, read_headers
from skinbake.kernels.deflate import pack_blocks
from skinbake.kernels.threads import parallel_for

_BLOCK = 16  # rows, as the format has it
_STRIP = 32 * _BLOCK  # rows in memory at a time


def fill_with_zip(path: Path, parts: Sequence[Mapping[str, NDArray[Any]]]) -> None:
    """Replace the pixels of an EXR of scan lines under ZIP compression.

    Parameters
    ----------
    path : Path
        As the library wrote it with the same parts and channels, of one row: so every attribute is its own.
    parts : sequence of mapping of str to ndarray
        Channels of each part, float16 or float32: (H, W), or (H, W, C) under the letters of several.
    """
    headers = read_headers(path.read_bytes())
    shapes = [next(iter(channels.values())).shape[:2] for channels in parts]
    sized = [_sized(part, *shape) for part, shape in zip(headers.parts, shapes, strict=True)]
    begin = replace(headers, parts=sized).encoded()
    tables = [np.zeros(-(-height // _BLOCK), "<u8") for height, _ in shapes]
    with open(path, "wb") as file:
        file.write(begin)
        file.write(b"".join(map(bytes, tables)))  # their room
        for number, (channels, table) in enumerate(zip(parts, tables, strict=True)):
            for block, content in enumerate(_blocks(channels)):
                table[block] = file.tell()
                place = (number, _BLOCK * block) if headers.many else (_BLOCK * block,)
                file.write(struct.pack(f"<{len(place) + 1}i", *place, len(content)))
                file.write(content)
        file.seek(len(begin))
        file.write(b"".join(map(bytes, tables)))


def _sized(part: Attributes, height: int, width: int) -> Attributes:
    """A part's attributes with another size of its image."""
    window = b"box2i", struct.pack("<4i", 0, 0, width - 1, height - 1)
    count = {"chunkCount": (b"int", struct.pack("<i", -(-height // _BLOCK)))} if "chunkCount" in part else {}
    return {**part, "dataWindow": window, "displayWindow": window, **count}


def _blocks(channels: Mapping[str, NDArray[Any]]) -> Iterator[memoryview]:
    """Blocks of an image from the top, as they stand in the file."""
    planes = dict(sorted(item for names, values in channels.items() for item in _planes(names, values)))
    height = len(next(iter(planes.values())))
    starts = np.cumsum([0, *(plane[0].size for plane in planes.values())])
    for top in range(0, height, _STRIP):
        rows = np.empty((min(_STRIP, height - top), starts[-1]), np.uint16)
        for start, plane in zip(starts, planes.values(), strict=False):
            rows[:, start : start + plane[0].size].reshape(len(rows), *plane.shape[1:])[:] = plane[top : top + _STRIP]
        count = -(-len(rows) // _BLOCK)
        packed = np.empty((count, _BLOCK * rows.shape[1] // 2 + 1), np.uint32)
        sizes = np.zeros(count, np.int64)
        parallel_for(pack_blocks, count, rows.reshape(-1), _BLOCK * rows.shape[1], packed, sizes)
        for block, size in enumerate(sizes):
            # What would not be shorter stands as it is
            raw = rows[_BLOCK * block : _BLOCK * (block + 1)]
            yield packed[block].view(np.uint8)[:size].data if size else raw.reshape(-1).view(np.uint8).data


def _planes(names: str, values: NDArray[Any]) -> Iterator[tuple[str, NDArray[np.uint16]]]:
    """Each channel as (H, W, words of 16 bits a sample), by its name."""
    words = np.ascontiguousarray(values).view("<u2")
    if values.ndim == 2:
        yield names, words.reshape(*values.shape, -1)
        return
    for c, name in enumerate(names):
        yield name, words.reshape(*values.shape, -1)[..., c, :]
