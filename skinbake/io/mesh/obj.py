"""Wavefront OBJ: the whole file as arrays of bytes, so that no line of it is a Python object."""

from __future__ import annotations

import codecs
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.colour import srgb_to_linear
from skinbake.io.mesh.polygons import triangulate
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.numerics import Float

Bytes = NDArray[np.uint8]
Index = NDArray[np.int64]
ABSENT = 2**62  # index of a UV or normal that a corner does not name
ENCODINGS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
NEWLINE, HASH, SLASH, WHITE = 10, ord("#"), ord("/"), 32  # all bytes up to WHITE separate words
_CONTINUED = re.compile(rb"^[ \t]*(?:v|vt|vn|f)[ \t](?:[^\n]*\\\n)+", re.MULTILINE)
_NAMED = {b"o": "o", b"g": "g", b"usemtl": "usemtl"}
COLOURED = 6  # numbers of a vertex with a colour
_KINDS = (("v", "vertex"), ("vt", "UV"), ("vn", "normal"))


@dataclass(frozen=True)
class _Lines:
    """Where the lines of a file begin (after indents) and end (before comments), and which kind each is."""

    path: Path
    text: bytes
    buffer: Bytes  # tags and comments of data lines are blank
    start: Index
    end: Index
    kind: Bytes  # 1 v, 2 vt, 3 vn, 4 f, 5 names, 0 anything else


def read_obj(path: Path) -> RawMesh:
    """Read an OBJ file.

    Raises
    ------
    InputError
        A line that is no vertex, UV, normal or face though it begins as one, or a face that names something that the
        file does not hold; the message names the line.
    """
    lines = _lines_of(path, _plain(path.read_bytes()))
    vertices = _vectors(lines, 1, 3, _vertex_numbers(lines), np.nan)
    positions, rgb = np.ascontiguousarray(vertices[:, :3]), vertices[:, 3:]
    uv = _vectors(lines, 2, 1, 2)
    normal = _vectors(lines, 3, 3, 3)
    sizes, corners = _corners(lines)
    face_lines = np.flatnonzero(lines.kind == 4)
    line_of_corner = np.repeat(face_lines, sizes)
    place, texel, direction = (
        _resolved(lines, corners[:, k], k, len(rows), line_of_corner) for k, rows in enumerate((positions, uv, normal))
    )
    triangles = triangulate(positions[place], sizes)
    polygon = np.repeat(np.arange(len(sizes)), sizes)[triangles[:, 0]]
    part, names = _parts(lines, face_lines)

    corner_uv, named = _gathered(uv, texel, triangles)
    corner_normal, _ = _gathered(normal, direction, triangles)
    has_uv = np.asarray(named.all(axis=1))
    if not has_uv.all():
        corner_uv[~has_uv] = 0.0
    faces = place[triangles].astype(np.int32)
    with np.errstate(over="ignore", invalid="ignore"):  # refused where they are asked for
        corner_rgb = srgb_to_linear(rgb)[faces] if rgb.size else None
    return RawMesh(positions, faces, corner_uv, has_uv, corner_normal, part[polygon], names, corner_rgb=corner_rgb)


def _vertex_numbers(lines: _Lines) -> int:
    """How many numbers of a vertex are wanted: 6 where a colour follows the position of the first one, else 3.

    Of seven nobody knows whether they are x y z w r g b or x y z r g b a.
    """
    first = np.flatnonzero(lines.kind == 1)[:1]
    words = [bytes(lines.buffer[lines.start[k] : lines.end[k]]).split() for k in first.tolist()]
    return COLOURED if words and len(words[0]) == COLOURED else 3


def _plain(data: bytes) -> bytes:
    """Lines that end in a newline, in an encoding that keeps ASCII."""
    for mark, encoding in ENCODINGS:
        if data.startswith(mark):
            data = data.decode(encoding, "replace").encode()
            break
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    # A backslash ends a name in Shift-JIS and GBK, too: it continues only lines of numbers. Line numbers stay right
    if b"\\\n" in data:
        data = _CONTINUED.sub(lambda found: found[0].replace(b"\\\n", b"\v"), data)
    return data + b"\n   "


def _lines_of(path: Path, text: bytes) -> _Lines:
    buffer = np.frombuffer(text, np.uint8).copy()
    end = np.flatnonzero(buffer == NEWLINE)
    start = np.concatenate([[0], end[:-1] + 1])
    indented = np.flatnonzero((buffer[start] <= WHITE) & (buffer[start] != NEWLINE))
    if len(indented):
        dark = np.flatnonzero((buffer > WHITE) | (buffer == NEWLINE))
        start[indented] = dark[np.searchsorted(dark, start[indented])]
    first, second, third = buffer[start], buffer[start + 1], buffer[start + 2]
    ends_second, ends_third = second <= WHITE, third <= WHITE
    kind = np.zeros(len(start), np.uint8)
    v = first == ord("v")
    kind[v & ends_second] = 1
    kind[v & (second == ord("t")) & ends_third] = 2
    kind[v & (second == ord("n")) & ends_third] = 3
    kind[(first == ord("f")) & ends_second] = 4
    kind[((first == ord("o")) | (first == ord("g"))) & ends_second] = 5
    kind[(first == ord("u")) & (second == ord("s"))] = 5
    comments = np.flatnonzero(buffer == HASH)
    if len(comments):
        line = np.searchsorted(end, comments)
        # The first of a line comes last
        of_data = (kind[line] > 0) & (kind[line] < 5)
        for place, number in zip(comments[of_data][::-1].tolist(), line[of_data][::-1].tolist(), strict=True):
            buffer[place : end[number]] = WHITE
    tagged = (kind > 0) & (kind < 5)
    buffer[start[tagged]] = WHITE
    buffer[(start + 1)[tagged & (kind > 1) & (kind < 4)]] = WHITE
    return _Lines(path, text, buffer, start, end, kind)


def _chunk(lines: _Lines, kind: int) -> bytes:
    """All lines of a kind, without their tags, each with its newline."""
    of_kind = np.flatnonzero(lines.kind == kind)
    if not len(of_kind):
        return b""
    begins = np.flatnonzero(np.diff(of_kind, prepend=-2) != 1)
    ends = np.append(begins[1:], len(of_kind)) - 1
    data = lines.buffer.data
    starts, stops = lines.start[of_kind[begins]], lines.end[of_kind[ends]] + 1
    return b"".join(data[a:b] for a, b in zip(starts.tolist(), stops.tolist(), strict=True))


def _words(chunk: bytes) -> tuple[Bytes, NDArray[np.bool_], Index]:
    """The chunk as bytes, where its words begin, and the number of words in each of its lines."""
    buffer = np.frombuffer(chunk, np.uint8)
    dark = buffer > WHITE
    begins = dark.copy()
    begins[1:] &= ~dark[:-1]
    count = np.cumsum(begins, dtype=np.int64)[buffer == NEWLINE]
    return buffer, begins, np.diff(count, prepend=0)


def _vectors(lines: _Lines, kind: int, least: int, wanted: int, absent: float = 0.0) -> Float:
    """The first `wanted` numbers of each line of a kind, shape (N, wanted); a line may leave out those past `least`."""
    chunk = _chunk(lines, kind)
    if not chunk:
        return np.zeros((0, wanted))
    _, _, count = _words(chunk)
    numbers = _numbers(chunk, np.float64)
    if numbers is None or len(numbers) != count.sum() or (len(count) and count.min() < least):
        _refuse_vector(lines, kind, least)
    columns = int(count[0])
    if (count == columns).all() and columns >= wanted:
        rows = numbers.reshape(-1, columns)[:, :wanted]
        return np.ascontiguousarray(rows)
    first = np.cumsum(count) - count
    rows = np.full((len(count), wanted), absent)
    for column in range(wanted):
        there = count > column
        rows[there, column] = numbers[first[there] + column]
    return rows


def _numbers(text: bytes, kind: type) -> NDArray | None:
    """Every number of a text of numbers and white space, or None where something else stands in it."""
    if not text.strip():
        return np.zeros(0, dtype=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _refuse_vector(lines: _Lines, kind: int, least: int) -> NoReturn:
    tag, name = _KINDS[kind - 1]
    for number in np.flatnonzero(lines.kind == kind).tolist():
        line = bytes(lines.buffer[lines.start[number] : lines.end[number]])
        words, numbers = int(_words(line + b"\n")[2].sum()), _numbers(line, np.float64)
        if words < least or numbers is None or len(numbers) != words:
            got = b" ".join(line.split()).decode("utf-8", "replace")[:80]
            raise InputError(
                f"{lines.path}:{_line_number(lines, number)}: {tag}: expected a {name} of {least} or more numbers,"
                f" got {got or 'nothing'}"
            )
    raise InputError(f"{lines.path}: {tag}: expected numbers")


def _corners(lines: _Lines) -> tuple[Index, Index]:
    """Number of corners of each face line, and as they stand vertex, UV and normal of each corner, shape (C, 3)."""
    chunk = _chunk(lines, 4)
    if not chunk:
        return np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
    buffer, begins, sizes = _words(chunk)
    dark = buffer > WHITE
    stops = np.flatnonzero(dark[:-1] & ~dark[1:]) + 1
    slashes = np.cumsum(buffer == SLASH)
    per_corner = 1 + slashes[stops] - slashes[np.flatnonzero(begins)]
    if b"//" in chunk:
        chunk = chunk.replace(b"//", b"/%d/" % ABSENT)
    if re.search(rb"/\s", chunk):
        chunk = re.sub(rb"/(?=\s)", b"/%d" % ABSENT, chunk)
    numbers = _numbers(chunk.replace(b"/", b" "), np.int64)
    if numbers is None or len(numbers) != per_corner.sum() or (len(per_corner) and per_corner.max() > 3):
        _refuse_face(lines)
    corners = np.full((len(per_corner), 3), ABSENT, np.int64)
    if len(per_corner) and (per_corner == per_corner[0]).all():
        columns = int(per_corner[0])
        corners[:, :columns] = numbers.reshape(-1, columns)
    else:
        first = np.cumsum(per_corner) - per_corner
        for column in range(3):
            there = per_corner > column
            corners[there, column] = numbers[first[there] + column]
    return sizes, corners


def _refuse_face(lines: _Lines) -> NoReturn:
    for number in np.flatnonzero(lines.kind == 4).tolist():
        for word in bytes(lines.buffer[lines.start[number] : lines.end[number]]).split():
            if not re.fullmatch(rb"[-+]?\d+(/([-+]?\d+)?(/([-+]?\d+)?)?)?", word):
                raise InputError(
                    f"{lines.path}:{_line_number(lines, number)}: f: expected corners such as 1, 1/2, 1//3 or 1/2/3,"
                    f" got {word.decode('utf-8', 'replace')[:80]}"
                )
    raise InputError(f"{lines.path}: f: expected corners such as 1, 1/2, 1//3 or 1/2/3")


def _resolved(lines: _Lines, index: Index, column: int, total: int, line_of_corner: Index) -> Index:
    """Indices from 0 on, where the file counts from 1, or with -1 back from the last one above the face's line."""
    absent = index == ABSENT
    if column and (total == 0 or absent.all()):
        return np.full(len(index), ABSENT, np.int64)
    found = index - 1
    relative = index < 0
    if relative.any():
        above = np.cumsum(lines.kind == column + 1)
        found[relative] = above[line_of_corner[relative]] + index[relative]
    wrong = (found < 0) | (found >= total)
    if column:
        wrong &= ~absent
    if wrong.any():
        corner = int(np.argmax(wrong))
        name = _KINDS[column][1]
        line = int(line_of_corner[corner])
        before = int(np.count_nonzero(lines.kind[:line] == column + 1))
        back = f", or from -{before} to -1" if before else ""
        raise InputError(
            f"{lines.path}:{_line_number(lines, line)}: f: expected a {name} from 1 to {total}{back},"
            f" got {'none' if absent[corner] else int(index[corner])}"
        )
    if column:
        found[absent] = ABSENT
    return found


def _gathered(rows: Float, index: Index, triangles: Index) -> tuple[Float, NDArray[np.bool_]]:
    """Rows of triangles' corners, zero where a corner names none, and which name one."""
    chosen = index[triangles]
    named = chosen != ABSENT
    if named.all():
        return rows[chosen], named
    gathered = np.zeros((*triangles.shape, rows.shape[1]))
    gathered[named] = rows[chosen[named]]
    return gathered, named


def _parts(lines: _Lines, face_lines: Index) -> tuple[NDArray[np.int32], tuple[tuple[str, ...], ...]]:
    """The part of each face line, and each part's object, groups and material."""
    state: dict[str, tuple[str, ...]] = {}
    numbers: dict[tuple[str, ...], int] = {}
    begins, parts = [0], [numbers.setdefault((), 0)]
    for line_number in np.flatnonzero(lines.kind == 5).tolist():
        line = lines.text[lines.start[line_number] : lines.end[line_number]]
        tag, _, rest = line.partition(b" ") if b"\t" not in line else line.replace(b"\t", b" ").partition(b" ")
        if tag in _NAMED:
            name = _text(rest).strip()
            # One face may be of several groups; names of objects and materials may hold spaces
            state[_NAMED[tag]] = tuple(name.split()) if tag == b"g" else (name,) if name else ()
            names = tuple(dict.fromkeys(n for key in ("o", "g", "usemtl") for n in state.get(key, ())))
            begins.append(line_number)
            parts.append(numbers.setdefault(names, len(numbers)))
    part = np.array(parts, np.int32)[np.searchsorted(begins, face_lines, side="right") - 1]
    used, number = np.unique(part, return_inverse=True)
    every = list(numbers)
    return number.astype(np.int32), tuple(every[k] for k in used.tolist())


def _text(name: bytes) -> str:
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("latin-1")


def _line_number(lines: _Lines, line: int) -> int:
    """As an editor counts; lines that a backslash continues were joined."""
    return line + 1 + lines.text.count(b"\v", 0, int(lines.start[line]))
