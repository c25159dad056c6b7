"""OFF: vertices and polygons as text; UVs, normals and colours beside them are left alone."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.polygons import triangulate
from skinbake.io.mesh.raw_mesh import RawMesh, bare_mesh, refuse_missing_vertices

Line = tuple[int, list[bytes]]  # its number and its words
# What else there is means vertices of other than three coordinates. Files of ModelNet have the first count glued to it
_KEYWORD = re.compile(rb"(?:ST)?C?N?OFF(\d*)")


def read_off(path: Path) -> RawMesh:
    """Read an OFF file.

    Raises
    ------
    InputError
        The file is damaged, binary, or not of three dimensions; the message says where.
    """
    lines = [(number, line.split(b"#")[0].split()) for number, line in enumerate(path.read_bytes().splitlines(), 1)]
    lines = [(number, words) for number, words in lines if words]
    keyword = _KEYWORD.fullmatch(lines[0][1][0]) if lines else None
    if not keyword or lines[0][1][1:] == [b"BINARY"]:
        got = b" ".join(lines[0][1])[:40].decode("latin-1") if lines else "an empty file"
        raise InputError(f"{path}: expected a text that begins with OFF (or COFF, NOFF, STOFF), got {got}")
    beside = [*filter(None, keyword.groups()), *lines[0][1][1:]]  # counts may stand there
    lines[:1] = [(lines[0][0], beside)] if beside else []
    vertices, polygons = _numbers(path, lines[0], 0, 2, int) if lines else (0, 0)
    if not 0 <= vertices + polygons < len(lines) or min(vertices, polygons) < 0:
        raise InputError(
            f"{path}: expected {vertices} vertices and {polygons} faces, a line each,"
            f" got {max(len(lines) - 1, 0)} lines; cut off?"
        )
    rows = [_numbers(path, line, 0, 3, float) for line in lines[1 : 1 + vertices]]
    positions = np.array(rows, np.float64).reshape(-1, 3)
    index: list[int] = []
    sizes = []
    for line in lines[1 + vertices : 1 + vertices + polygons]:
        (size,) = _numbers(path, line, 0, 1, int)
        sizes.append(max(size, 0))
        index += _numbers(path, line, 1, sizes[-1], int)
    corner = np.array(index, dtype=np.int64)
    refuse_missing_vertices(path, corner, len(positions))
    return bare_mesh(positions, corner[triangulate(positions[corner], np.array(sizes, dtype=np.int64))])


def _numbers(path: Path, line: Line, first: int, count: int, kind: type) -> list:
    """So many numbers of a line, from one of its words on."""
    number, words = line
    try:
        found = [kind(word) for word in words[first : first + count]]
        if kind is int:
            np.array(found, np.int64)  # which may be too large for it
    except (ValueError, OverflowError):
        found = []
    if len(found) < count:
        got = b" ".join(words)[:80].decode("latin-1")
        whole = "whole numbers" if kind is int else "numbers"
        raise InputError(f"{path}:{number}: expected {first + count} {whole}, got {got}")
    return found
