"""PLY: vertices, faces of any number of corners, triangle strips; UVs on vertices or on faces' corners [Turk1994]."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.colour import srgb_to_linear
from skinbake.io.mesh.polygons import triangulate
from skinbake.io.mesh.raw_mesh import RawMesh, refuse_missing_vertices
from skinbake.numerics import Float

KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
         "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))
COLOURS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
LISTS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)  # name, kind of a list's length or "", kind
    scalars: dict[str, NDArray] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.int64], NDArray]] = field(default_factory=dict)  # lengths, values end to end


def read_ply(path: Path) -> RawMesh:
    """Read a PLY file; where its faces have textures of their own (texnumber), each texture's are a part.

    Raises
    ------
    InputError
        The file is damaged; the message says where.
    """
    elements = _read(path)
    vertex = elements.get("vertex")
    if vertex is None or not all(axis in vertex.scalars for axis in "xyz"):
        raise InputError(f"{path}: expected vertices with x, y and z")
    positions = _columns(vertex, "x", "y", "z")
    uv = next((_columns(vertex, *names) for names in UV_NAMES if all(n in vertex.scalars for n in names)), None)
    normal = _columns(vertex, "nx", "ny", "nz") if all(n in vertex.scalars for n in ("nx", "ny", "nz")) else None

    rgb = _colours(vertex)

    with np.errstate(invalid="ignore"):  # indices written as NaN
        sizes, index, corner_uv = _polygons(path, elements)
        texture = _textures(elements, len(sizes))
    refuse_missing_vertices(path, index, len(positions))
    triangles = triangulate(positions[index], sizes)
    faces = index[triangles]
    found_uv, has_uv = np.zeros((len(faces), 3, 2)), np.zeros(len(faces), np.bool_)
    if corner_uv is not None:
        values, there = corner_uv
        found_uv, has_uv = values[triangles], np.asarray(there[triangles].all(axis=1))
    elif uv is not None:
        found_uv, has_uv = uv[faces], np.ones(len(faces), np.bool_)
    numbers, part = np.unique(np.repeat(texture, sizes)[triangles[:, 0]], return_inverse=True)
    names = tuple((f"texture {number}" if number >= 0 else "no texture",) for number in numbers.tolist())
    return RawMesh(
        positions,
        faces.astype(np.int32),
        found_uv,
        has_uv,
        normal[faces] if normal is not None else np.zeros((len(faces), 3, 3)),
        part.ravel().astype(np.int32),
        names if len(names) > 1 else ((),),
        corner_rgb=rgb[faces] if rgb is not None else None,
    )


def _colours(vertex: _Element) -> Float | None:
    """Linear colours of the vertices, (V, 3), all of it sRGB: integers are fractions of their kind's largest.

    Those of 32 bits, which hold what others have in a byte, are fractions of 255; larger ones are refused by whoever
    asks for colours.
    """
    kinds = {name: kind for name, of_list, kind in vertex.properties if not of_list}
    names = next((names for names in COLOURS if all(name in vertex.scalars for name in names)), None)
    if names is None:
        return None
    kind = np.dtype(kinds[names[0]])
    largest = 1 if kind.kind == "f" else 255 if kind.itemsize == 4 else np.iinfo(kind).max
    with np.errstate(over="ignore", invalid="ignore"):  # refused where they are asked for
        return srgb_to_linear(_columns(vertex, *names) / largest)


def _columns(element: _Element, *names: str) -> Float:
    return np.stack([element.scalars[name].astype(np.float64) for name in names], axis=1)


def _polygons(
    path: Path, elements: dict[str, _Element]
) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[Float, NDArray[np.bool_]] | None]:
    """Sizes and vertices of faces and of the triangles of strips; UVs of their corners and which have any."""
    face = elements.get("face")
    named = next((name for name in LISTS if face is not None and name in face.lists), None)
    sizes, index, corner_uv = np.zeros(0, np.int64), np.zeros(0, np.int64), None
    if face is not None and named is not None:
        sizes, values = face.lists[named]
        index = values.astype(np.int64)
        if "texcoord" in face.lists:
            lengths, texcoord = face.lists["texcoord"]
            there = lengths == 2 * sizes  # programs write an empty list for a face without texture
            if (~there & (lengths > 0)).any():
                row = int(np.argmax(~there & (lengths > 0)))
                raise InputError(
                    f"{path}: face {row}: expected {2 * int(sizes[row])} texcoord numbers, got {int(lengths[row])}"
                )
            corner_there = np.repeat(there, sizes)
            uv = np.zeros((len(index), 2))
            uv[corner_there] = texcoord.astype(np.float64).reshape(-1, 2)
            corner_uv = uv, corner_there
    strips = elements.get("tristrips")
    named = next((name for name in LISTS if strips is not None and name in strips.lists), None)
    if strips is not None and named is not None:
        cut = _strip_triangles(*strips.lists[named])
        sizes, index = np.concatenate([sizes, np.full(len(cut), 3)]), np.concatenate([index, cut.ravel()])
        if corner_uv is not None:
            corner_uv = (
                np.concatenate([corner_uv[0], np.zeros((cut.size, 2))]),
                np.concatenate([corner_uv[1], np.zeros(cut.size, np.bool_)]),
            )
    return sizes, index, corner_uv


def _textures(elements: dict[str, _Element], count: int) -> NDArray[np.int64]:
    """Number of the texture of each face, and of each triangle of strips after them, which have none."""
    texture = np.full(count, -1)
    face = elements.get("face")
    if face is not None and "texnumber" in face.scalars:
        texture[: face.count] = face.scalars["texnumber"].astype(np.int64)[:count]
    return texture


def _strip_triangles(lengths: NDArray[np.int64], values: NDArray) -> NDArray[np.int64]:
    """Triangles of strips, which end at an index of -1 or with their list."""
    values = values.astype(np.int64)
    values = np.insert(values, np.cumsum(lengths), -1)
    a, b, c = values[:-2], values[1:-1], values[2:]
    since = np.arange(len(a)) - np.maximum.accumulate(np.where(a < 0, np.arange(len(a)) + 1, 0))
    faces = np.stack([a, b, c], axis=1)
    odd = since % 2 == 1
    faces[odd] = faces[odd][:, [1, 0, 2]]
    return faces[(a >= 0) & (b >= 0) & (c >= 0) & (a != b) & (b != c) & (c != a)]


def _read(path: Path) -> dict[str, _Element]:
    """Every element of the file with its values."""
    data = path.read_bytes()
    order, elements, start = _header(path, data)
    if not order:
        try:
            numbers = np.array(data[start:].split(), dtype=np.float64)
        except ValueError as error:
            raise InputError(f"{path}: expected numbers after the header: {str(error)[:80]}") from None
        start = 0
        for element in elements:
            start = _ascii(path, element, numbers, start)
    else:
        for element in elements:
            start = _binary(path, element, data, start, order)
    return {element.name: element for element in elements}


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order ("" for text), elements without values, and where these begin."""
    if data[:3] != b"ply":
        raise InputError(f"{path}: expected a PLY, which begins with ply, got {data[:4]!r}")
    order, elements = None, list[_Element]()
    position = 0
    while True:
        end = data.find(b"\n", position)
        if end < 0:
            raise InputError(f"{path}: expected end_header; cut off?")
        line = data[position:end].decode("latin-1")
        words, position = line.split(), end + 1
        try:
            if words[:1] == ["format"]:
                order = ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append((words[4], KINDS[words[2]], KINDS[words[3]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], "", KINDS[words[1]]))
        except (LookupError, ValueError):
            raise InputError(f"{path}: {line.strip()[:80]!r} is not a line of a PLY's header") from None
        if words[:1] == ["end_header"]:
            break
    if order is None:
        raise InputError(f"{path}: expected a line format ascii, binary_little_endian or binary_big_endian")
    for element in elements:
        if element.count < 0 or (element.count and not element.properties):
            raise InputError(f"{path}: element {element.name}: {element.count} of nothing")
    return order, elements, position


def _cut_off(path: Path, element: _Element) -> InputError:
    return InputError(f"{path}: expected {element.count} of element {element.name}, the file ends before; cut off?")


def _ascii(path: Path, element: _Element, numbers: Float, start: int) -> int:
    """Take the values of an element from the words of a text; gives where the next begins."""
    if element.count > len(numbers) - start:
        raise _cut_off(path, element)
    # Where every list is as long as that of the first row, rows are all alike
    lengths, place = [], start
    for _, of_list, _ in element.properties:
        length = 1
        if of_list:
            length = _length(path, element, numbers, place)
            place += 1
        lengths.append(length)
        place += length
    width = place - start
    rows = numbers[start : start + width * element.count]
    if element.count and len(rows) == width * element.count:
        table, column, alike = rows.reshape(element.count, width), 0, True
        for (_, of_list, _), length in zip(element.properties, lengths, strict=True):
            if of_list:
                alike = alike and bool((table[:, column] == length).all())
                column += 1
            column += length
        if alike:
            column = 0
            for (name, of_list, _), length in zip(element.properties, lengths, strict=True):
                if of_list:
                    values = table[:, column + 1 : column + 1 + length].ravel()
                    element.lists[name] = (np.full(element.count, length, np.int64), values)
                    column += 1
                else:
                    element.scalars[name] = table[:, column]
                column += length
            return start + width * element.count

    def take(place: int, of_list: str, kind: str) -> tuple[int, NDArray]:
        length = 1
        if of_list:
            length, place = _length(path, element, numbers, place), place + 1
        if place + length > len(numbers):
            raise _cut_off(path, element)
        return place + length, numbers[place : place + length]

    return _row_by_row(element, start, take)


def _length(path: Path, element: _Element, numbers: Float, place: int) -> int:
    if place >= len(numbers):
        raise _cut_off(path, element)
    length = numbers[place]
    if not (0 <= length <= len(numbers)) or length != int(length):
        raise InputError(f"{path}: element {element.name}: expected the length of a list, got {length:g}")
    return int(length)


def _binary(path: Path, element: _Element, data: bytes, start: int, order: str) -> int:
    """Take the values of an element from bytes; gives where the next begins."""
    if not element.count:
        return start

    def take(place: int, of_list: str, kind: str) -> tuple[int, NDArray]:
        length = 1
        if of_list:
            if place + int(of_list[1]) > len(data):
                raise _cut_off(path, element)
            length = int(np.frombuffer(data, order + of_list, 1, place)[0])
            place += int(of_list[1])
        size = length * int(kind[1])
        if length < 0 or place + size > len(data):
            raise _cut_off(path, element)
        return place + size, np.frombuffer(data, order + kind, length, place)

    # Where every list is as long as that of the first row, rows are all alike
    fields: list[Any] = []
    place = start
    for number, (_, of_list, kind) in enumerate(element.properties):
        place, values = take(place, of_list, kind)
        if of_list:
            fields.append((f"n{number}", order + of_list))
        fields.append((f"p{number}", order + kind, (len(values),)) if of_list else (f"p{number}", order + kind))
    row = np.dtype(fields)
    if start + row.itemsize * element.count <= len(data):
        table = np.frombuffer(data, row, element.count, start)
        alike = all(
            not of_list or bool((table[f"n{k}"] == row[f"p{k}"].shape[0]).all())
            for k, (_, of_list, _) in enumerate(element.properties)
        )
        if alike:
            for k, (name, of_list, _) in enumerate(element.properties):
                if of_list:
                    length = row[f"p{k}"].shape[0]
                    element.lists[name] = (np.full(element.count, length, np.int64), table[f"p{k}"].ravel())
                else:
                    element.scalars[name] = table[f"p{k}"]
            return start + row.itemsize * element.count
    return _row_by_row(element, start, take)


def _row_by_row(element: _Element, start: int, take: Any) -> int:
    """Lists of different lengths: each row begins where the one before it ends."""
    columns: list[list[NDArray]] = [[] for _ in element.properties]
    place = start
    for _ in range(element.count):
        for column, (_, of_list, kind) in zip(columns, element.properties, strict=True):
            place, values = take(place, of_list, kind)
            column.append(values)
    for column, (name, of_list, _) in zip(columns, element.properties, strict=True):
        values = np.concatenate(column) if column else np.zeros(0)
        if of_list:
            element.lists[name] = (np.array([len(v) for v in column], np.int64), values)
        else:
            element.scalars[name] = values
    return place
