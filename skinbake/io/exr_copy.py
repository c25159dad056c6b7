"""The same pixels under another header: what was packed once is not packed again.

Lobes that are too narrow to be blurred are all the light itself, and packing is a seventh of a bake. The bytes are
those that `write_parts` would write.
"""

from __future__ import annotations

import mmap
import shutil
import struct
from collections.abc import Mapping
from pathlib import Path

from skinbake.io.atomic import atomic_write

_BEGIN = 8  # bytes of the magic number, the version and its flags
_MANY_PARTS = 0x1000
_AT_ONCE = 1 << 22  # bytes that are copied at a time
_OFFSET = struct.Struct("<Q")
_SIZE = struct.Struct("<i")


def copy_parts(source: Path, path: Path, attributes: Mapping[str, str | float | list[float]]) -> bool:
    """Write a copy of our own EXR, with other values of some header attributes in every part.

    Parameters
    ----------
    source : Path
        As `write_parts` left it.
    path : Path
    attributes : mapping
        Text, a number or several; those that `source` has not are added.

    Returns
    -------
    bool
        False where the file is laid out otherwise than `write_parts` does, and nothing was written.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    with open(source, "rb") as packed, mmap.mmap(packed.fileno(), 0, access=mmap.ACCESS_READ) as content:
        try:
            parts, end = _headers(content)
            changed = b"".join(_header(part | {name: _encoded(value) for name, value in attributes.items()})
                               for part in parts) + (b"\0" if _has_many(content) else b"")  # fmt: skip
            offsets = _offsets(content, end)
        except (struct.error, LookupError, ValueError):
            return False
        moved = len(changed) - (end - _BEGIN)
        with atomic_write(path) as temporary, open(temporary, "wb") as file:
            file.write(content[:_BEGIN])
            file.write(changed)
            file.write(struct.pack(f"<{len(offsets)}Q", *(offset + moved for offset in offsets)))
            packed.seek(end + _OFFSET.size * len(offsets))
            shutil.copyfileobj(packed, file, _AT_ONCE)
    return True


def _has_many(content: mmap.mmap) -> bool:
    """Whether the file's flags say that it has several parts."""
    return bool(_SIZE.unpack_from(content, 4)[0] & _MANY_PARTS)


def _headers(content: mmap.mmap) -> tuple[list[dict[str, tuple[bytes, bytes]]], int]:
    """Type and value of each attribute of each part, and where the headers end."""
    parts: list[dict[str, tuple[bytes, bytes]]] = []
    at = _BEGIN
    while content[at]:  # an empty header ends those of many parts
        part: dict[str, tuple[bytes, bytes]] = {}
        while content[at]:
            name_end = _zero_from(content, at)
            kind_end = _zero_from(content, name_end + 1)
            begin = kind_end + 1 + _SIZE.size
            stop = begin + _SIZE.unpack_from(content, kind_end + 1)[0]
            part[content[at:name_end].decode()] = content[name_end + 1 : kind_end], content[begin:stop]
            at = stop
        at += 1
        parts.append(part)
        if not _has_many(content):
            return parts, at
    return parts, at + 1


def _zero_from(content: mmap.mmap, begin: int) -> int:
    """Where the next zero byte is.

    Raises
    ------
    ValueError
        There is none.
    """
    found = content.find(b"\0", begin)
    if found < 0:
        raise ValueError("expected the end of a name")
    return found


def _header(part: Mapping[str, tuple[bytes, bytes]]) -> bytes:
    """A part's header; the library writes attributes in the order of their names."""
    written = [
        name.encode() + b"\0" + kind + b"\0" + _SIZE.pack(len(value)) + value
        for name, (kind, value) in sorted(part.items(), key=lambda item: item[0].encode())
    ]
    return b"".join(written) + b"\0"


def _encoded(value: str | float | list[float]) -> tuple[bytes, bytes]:
    """Type and value of an attribute as the library writes it."""
    if isinstance(value, str):
        return b"string", value.encode()
    if isinstance(value, list):
        return b"floatvector", struct.pack(f"<{len(value)}f", *value)
    return b"float", struct.pack("<f", value)


def _offsets(content: mmap.mmap, end: int) -> tuple[int, ...]:
    """Where each block of rows lies: the table goes on to the first one of them.

    Raises
    ------
    ValueError
        It does not, or a block lies outside the file.
    """
    count, rest = divmod(_OFFSET.unpack_from(content, end)[0] - end, _OFFSET.size)
    if rest or count <= 0:
        raise ValueError("expected the first block behind the table")
    offsets: tuple[int, ...] = struct.unpack_from(f"<{count}Q", content, end)
    if min(offsets) != offsets[0] or max(offsets) >= len(content):
        raise ValueError("expected blocks within the file")
    return offsets
