"""Headers of our own EXR files as bytes, by which a file is told what the library would tell it."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_BEGIN = 8  # bytes of the magic number, the version and its flags
_MANY_PARTS = 0x1000
_OFFSET = struct.Struct("<Q")
_SIZE = struct.Struct("<i")
Attributes = Mapping[str, tuple[bytes, bytes]]


@dataclass(frozen=True)
class Headers:
    """What an EXR begins with.

    Attributes
    ----------
    begin : bytes
        The magic number, the version and its flags.
    parts : sequence of mapping of str to (bytes, bytes)
        Type and value of each attribute of each part.
    end : int
        Bytes of all that, in the file it was read from.
    """

    begin: bytes
    parts: Sequence[Attributes]
    end: int

    @property
    def many(self) -> bool:
        """Whether the file's flags say that it has several parts: blocks then say whose they are."""
        return bool(_SIZE.unpack_from(self.begin, 4)[0] & _MANY_PARTS)

    def encoded(self) -> bytes:
        """As a file begins; attributes in the order of their names, as the library writes them."""
        return self.begin + b"".join(map(_encoded_part, self.parts)) + (b"\0" if self.many else b"")


def read_headers(content: bytes) -> Headers:
    """Headers of an EXR.

    Raises
    ------
    struct.error, ValueError, IndexError
        It is not one, or is cut short.
    """
    parts: list[Attributes] = []
    at = _BEGIN
    many = Headers(content[:_BEGIN], (), _BEGIN).many
    while content[at]:  # an empty header ends those of many parts
        part: dict[str, tuple[bytes, bytes]] = {}
        while content[at]:
            name_end = content.index(0, at)
            kind_end = content.index(0, name_end + 1)
            begin = kind_end + 1 + _SIZE.size
            stop = begin + _SIZE.unpack_from(content, kind_end + 1)[0]
            part[content[at:name_end].decode()] = content[name_end + 1 : kind_end], content[begin:stop]
            at = stop
        at += 1
        parts.append(part)
        if not many:
            return Headers(content[:_BEGIN], parts, at)
    return Headers(content[:_BEGIN], parts, at + 1)


def _encoded_part(part: Attributes) -> bytes:
    written = [
        name.encode() + b"\0" + kind + b"\0" + _SIZE.pack(len(value)) + value
        for name, (kind, value) in sorted(part.items(), key=lambda item: item[0].encode())
    ]
    return b"".join(written) + b"\0"


def encoded(value: str | float | list[float]) -> tuple[bytes, bytes]:
    """Type and value of an attribute as the library writes it."""
    if isinstance(value, str):
        return b"string", value.encode()
    if isinstance(value, list):
        return b"floatvector", struct.pack(f"<{len(value)}f", *value)
    return b"float", struct.pack("<f", value)


def offsets_of(content: bytes, end: int) -> tuple[int, ...]:
    """Where each block of rows lies, of a file whose headers end at `end`: the table goes on to the first one of them.

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
