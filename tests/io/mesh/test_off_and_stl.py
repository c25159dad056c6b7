"""OFF and STL: what they hold is there, what they cannot say is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.mesh.raw_file import read_raw
from tests.shapes import sphere

NOTCHED = [(0, 0, 0), (100, 0, 0), (100, 100, 0), (50, 20, 0), (0, 100, 0)]
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


def twice_areas(mesh):
    a, b, c = np.moveaxis(mesh.positions[mesh.faces], 1, 0)
    return np.cross(b - a, c - a)[:, 2]


def off(folder, faces, head="OFF\n5 {count} 0", more=""):
    path = folder / "a.off"
    lines = [head.format(count=len(faces)), *(f"{x} {y} {z}{more}" for x, y, z in NOTCHED), *faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("head", "more"),
    [
        ("OFF\n5 {count} 0", ""),
        ("# by hand\nOFF 5 {count} 0 # 0 edges", " # a corner"),
        ("OFF5 {count} 0", ""),
        ("COFF\n5 {count} 0", " 255 0 0 255"),
        ("STCNOFF\n5 {count} 0", " 0 0 1 .5 .5 .5 1 0 1"),
    ],
    ids=lambda text: text.split("\n")[0].strip(),
)
def test_polygons_of_an_off_are_cut_as_those_of_others(tmp_path, head, more):
    """No triangle across a notch; polygons of any size beside one another, colours after them."""
    mesh = read_raw(off(tmp_path, ["5 0 1 2 3 4", "3 0 1 2 255 0 0", "4 0 1 2 4 0.5 0.5 0.5"], head, more))
    areas = twice_areas(mesh)
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(2 * (6000 + 5000 + 10000))
    assert not mesh.has_uv.any()


@pytest.mark.parametrize(
    ("head", "faces", "message"),
    [
        ("4OFF\n5 {count} 0", ["3 0 1 2"], r"a\.off: expected a text that begins with OFF .*, got 4OFF$"),
        ("OFF BINARY\n5 {count} 0", ["3 0 1 2"], r"a\.off: expected a text that begins with OFF .*, got OFF BINARY$"),
        ("OFF\n5 9 0", ["3 0 1 2"], r"a\.off: expected 5 vertices and 9 faces, a line each, got 6 lines; cut off\?$"),
        ("OFF\n5 {count} 0", ["3 0 1 5"], r"a\.off: a triangle names vertex 5, of 5 vertices$"),
        ("OFF\n5 {count} 0", ["3 0 1"], r"a\.off:8: expected 4 whole numbers, got 3 0 1$"),
        ("OFF\n5 {count} 0", ["3 0 1 x"], r"a\.off:8: expected 4 whole numbers, got 3 0 1 x$"),
        ("OFF\n5 {count} 0", ["3 0 1 99999999999999999999"], r"a\.off:8: expected 4 whole numbers, got "),
        ("OFF\n5", ["3 0 1 2"], r"a\.off:2: expected 2 whole numbers, got 5$"),
        ("OFF\n5 -1 0", ["3 0 1 2"], r"a\.off: expected 5 vertices and -1 faces"),
        ("OFF\n2 0 0", [], r"a\.off: expected triangles, got none$"),
        ("# nothing\n", [], r"a\.off: expected a text that begins with OFF .*, got 0 0 0$"),
    ],
)
def test_what_an_off_does_not_hold_is_said(tmp_path, head, faces, message):
    """The file, the line, what was expected and what came."""
    with pytest.raises(InputError, match=message):
        read_raw(off(tmp_path, faces, head))


def binary(mesh, header=b"solid of a program"):
    rows = (struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 7) for corners in mesh.corner_position_mm)
    return header.ljust(80, b"\0") + struct.pack("<I", len(mesh.faces)) + b"".join(rows)


def test_text_and_binary_stl_are_the_same(tmp_path):
    """Triangles in their order, whatever a binary header begins with."""
    ball = sphere(100.0, "latlong", 6)
    (tmp_path / "a.stl").write_bytes(binary(ball))
    facet = "facet normal 0 0 0 outer loop {} endloop endfacet\n"
    corners = ball.corner_position_mm.astype(np.float32)
    lines = [facet.format(" ".join(f"Vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in each)) for each in corners]
    (tmp_path / "b.STL").write_text("SOLID a\n" + "".join(lines[:9]) + "endsolid\nsolid b\n" + "".join(lines[9:]))
    for name in ("a.stl", "b.STL"):
        mesh = read_raw(tmp_path / name)
        np.testing.assert_array_equal(mesh.positions[mesh.faces].astype(np.float32), corners)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            binary(sphere(100.0, "latlong", 6), b"x")[:-20],
            r"expected \d+ triangles in \d+ bytes, got \d+ bytes; cut off",
        ),
        (binary(sphere(100.0, "latlong", 6), b"x") + b"ab", r"expected \d+ triangles in \d+ bytes, got \d+ bytes"),
        (
            binary(sphere(100.0, "latlong", 6))[:-20],
            r"expected 0 facets of three vertices|expected triangles, got none",
        ),
        (("solid a\n" + FACET + FACET[:60]).encode(), "expected 2 facets of three vertices, got 5 vertices and"),
        (("solid a\n" + FACET + FACET[:-18]).encode(), "got 6 vertices and 1 ends; cut off"),
        (("solid a\n" + FACET.replace("1 0 0", "1 x 0")).encode(), "expected numbers after vertex"),
        (("solid a\n" + FACET.replace("1 0 0", "1 nan 0")).encode(), "expected finite vertices"),
        (b"solid\n", "expected triangles, got none"),
        (b"", "expected 0 triangles in 84 bytes, got 0 bytes"),
    ],
)
def test_what_an_stl_does_not_hold_is_said(tmp_path, data, message):
    """Whatever is cut off, or no number."""
    (tmp_path / "a.stl").write_bytes(data)
    with pytest.raises(InputError, match=rf"a\.stl: .*{message}"):
        read_raw(tmp_path / "a.stl")
