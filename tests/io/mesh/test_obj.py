"""OBJ as people have it: whatever tools write around the numbers, the triangles are the same."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.mesh import read_mesh, write_obj
from skinbake.io.mesh.obj import read_obj
from tests.shapes import sphere

HEAD = sphere(100.0, "latlong", 8)


@pytest.fixture
def text(tmp_path):
    write_obj(tmp_path / "plain.obj", HEAD)
    return (tmp_path / "plain.obj").read_bytes()


def lines(text, tag):
    return [line for line in text.split(b"\n") if line.startswith(tag + b" ")]


WRITTEN = {
    "tabs": lambda t: t.replace(b" ", b"\t"),
    "indents": lambda t: b"\n".join(b" \t " + line for line in t.split(b"\n")),
    "comments after faces": lambda t: b"\n".join(line + b" # of the head, f 1 2 3" for line in t.split(b"\n")),
    "CR LF": lambda t: t.replace(b"\n", b"\r\n"),
    "CR": lambda t: t.replace(b"\n", b"\r"),
    "no newline at the end": lambda t: t.rstrip(),
    "UTF-8 mark": lambda t: b"\xef\xbb\xbf" + t,
    "UTF-16": lambda t: t.decode().encode("utf-16"),
    "trailing spaces": lambda t: t.replace(b"\n", b"  \n"),
    "continued lines": lambda t: b"\n".join(
        line.replace(b" ", b" \\\n", 2) if line.startswith(b"f") else line for line in t.split(b"\n")
    ),
    "Latin-1": lambda t: "g Gesicht für Müller\n# ©\x85 NEL\n".encode("latin-1") + t,
    "GBK": lambda t: "g 头\nusemtl 皮肤\n# 头\\\n".encode("gbk") + t,
    "Shift-JIS, a name that ends in a backslash": lambda t: "o ソ\ng 表\n".encode("shift-jis") + t,
    "vertex colours": lambda t: t.replace(b"\nv ", b"\n#MRGB ffffff\nv ").replace(b"\nvt", b" 1 0.5 0\nvt", 1),
    "w and a third texture number": lambda t: b"\n".join(
        line + b" 1.0" if line[:2] in (b"v ", b"vt") else line for line in t.split(b"\n")
    ),
    "smoothing, lines, points": lambda t: b"mtllib none.mtl\ns off\n" + t + b"l 1 2 3\np 4\ns 1\nvp 1 2\n",
    "plus signs": lambda t: t.replace(b"f ", b"f +"),
}


@pytest.mark.parametrize("case", WRITTEN)
def test_what_tools_write_around_the_numbers(tmp_path, text, case):
    """Bit for bit the mesh of the plain file."""
    path = tmp_path / "head.obj"
    path.write_bytes(WRITTEN[case](text))
    got, wanted = read_mesh(path, 1.0), read_mesh(tmp_path / "plain.obj", 1.0)
    for name in ("positions_mm", "faces", "corner_uv", "corner_normal"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))


def test_relative_indices_over_several_objects(tmp_path):
    """-1 is the last vertex above the line, not of the file: as the same file with positive indices."""
    text = "o nose\nv 0 0 0\nv 90 0 0\nv 0 90 0\nvt 0 0\nvt .5 0\nvt 0 .5\nf -3/-3 -2/-2 -1/-1\n"
    text += "o head\nv 0 0 50\nv 90 0 50\nv 0 90 50\nvt .5 .5\nvt 1 .5\nvt .5 1\nf -3/-3 -2/-2 -1/-1\nf 1/1 -2/2 3/-1\n"
    (tmp_path / "relative.obj").write_text(text)
    positive = text.replace("-3/-3 -2/-2 -1/-1", "1/1 2/2 3/3", 1).replace("-3/-3 -2/-2 -1/-1", "4/4 5/5 6/6")
    (tmp_path / "positive.obj").write_text(positive.replace("1/1 -2/2 3/-1", "1/1 5/2 3/6"))
    got, wanted = (read_mesh(tmp_path / f"{name}.obj", 1.0) for name in ("relative", "positive"))
    assert np.ptp(got.positions_mm, axis=0).tolist() == [90, 90, 50]
    np.testing.assert_array_equal(got.corner_position_mm, wanted.corner_position_mm)
    np.testing.assert_array_equal(got.corner_uv, wanted.corner_uv)


def test_a_relative_index_past_the_first_vertex(tmp_path):
    """The message counts what is above the line, though more follows."""
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -2 -1\nv 5 5 5\n")
    with pytest.raises(InputError, match=r"bad\.obj:4: f: expected a vertex from 1 to 4, or from -3 to -1, got -4"):
        read_mesh(tmp_path / "bad.obj", 1.0)


def test_corners_of_every_form_in_one_file(tmp_path):
    """v, v/vt, v//vn, v/vt/vn and v/ side by side: each triangle has the UVs and normals that it names."""
    head = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 100 100 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 1 0 0\n"
    (tmp_path / "mixed.obj").write_text(
        head + "f 1 2 3\nf 1/1 2/2 3/3\nf 1//1 2//2 3//1\nf 1/1/2 2/2/2 3/3/2\nf 1/ 2/ 4/\n"
    )
    raw = read_obj(tmp_path / "mixed.obj")
    assert raw.has_uv.tolist() == [False, True, False, True, False]
    assert raw.corner_uv[[0, 2, 4]].max() == 0
    assert raw.corner_uv[1].tolist() == raw.corner_uv[3].tolist() == [[0, 0], [1, 0], [0, 1]]
    assert raw.corner_normal[:2].any() == False  # noqa: E712
    assert raw.corner_normal[2].tolist() == [[0, 0, 1], [1, 0, 0], [0, 0, 1]]
    assert raw.corner_normal[3].tolist() == [[1, 0, 0]] * 3


def test_parts_are_objects_groups_and_materials(tmp_path):
    """Each run of faces goes by the names that stand above it; the same names again are the same part."""
    (tmp_path / "parts.obj").write_text(
        "v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\no Head\nusemtl skin\ng face left\nf 1 2 3\nf 1 2 3\n"
        "usemtl eye white\ng\nf 1 2 3\nusemtl skin\ng face left\nf 1 2 3\nusemtl unused\n"
    )
    raw = read_obj(tmp_path / "parts.obj")
    assert [raw.names[k] for k in raw.part] == [
        (), ("Head", "face", "left", "skin"), ("Head", "face", "left", "skin"), ("Head", "eye white"),
        ("Head", "face", "left", "skin"),
    ]  # fmt: skip
    assert len(raw.names) == 3


def test_concave_polygons_as_quads(tmp_path):
    """A U of five quads as one polygon covers what the quads cover, each corner with its own UV."""
    corners = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3), (0, 1)]
    rows = "".join(f"v {40 * x} {40 * y} {x * x}\nvt {0.1 + x / 4} {0.1 + y / 4}\n" for x, y in corners)
    quads = ["1 2 9 12", "2 3 8 9", "3 4 5 8", "12 9 10 11", "8 5 6 7"]
    (tmp_path / "one.obj").write_text(rows + "f " + " ".join(f"{k}/{k}" for k in range(1, 13)) + "\n")
    (tmp_path / "quads.obj").write_text(
        rows + "".join("f " + " ".join(f"{k}/{k}" for k in quad.split()) + "\n" for quad in quads)
    )
    one, five = read_mesh(tmp_path / "one.obj", 1.0), read_mesh(tmp_path / "quads.obj", 1.0)
    assert len(one.faces) == len(five.faces) == 10
    assert one.face_area_mm2.sum() == pytest.approx(five.face_area_mm2.sum(), rel=0.01)
    from skinbake.atlas import rasterize, signed_uv_area, uv_report

    assert (signed_uv_area(one) > 0).all()
    report = uv_report(one, rasterize(one, (128, 128)))
    assert (report.overlapping, report.flipped) == (0, 0)


BAD = {
    "a word for a number": ("v 0 0 0\nv 1 o 0\n", "bad.obj:2: v: expected a vertex of 3 or more numbers, got 1 o 0"),
    "two numbers": ("v 0 0 0\n\nv 1 2\n", "bad.obj:3: v: expected a vertex of 3 or more numbers, got 1 2"),
    "a decimal comma": ("v 0,5 0 0\n", "bad.obj:1: v: expected a vertex"),
    "no space": ("v 0 0 0\nv 1-2 3\n", "bad.obj:2: v: expected a vertex"),
    "a UV that is none": ("v 0 0 0\nvt a b\n", "bad.obj:2: vt: expected a UV of 1 or more numbers, got a b"),
    "a corner that is none": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "bad.obj:4: f: expected corners such as"),
    "four numbers a corner": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1/1 2/1/1/1 3/1/1/1\n", "bad.obj:4: f: "),
    "a line number after continued lines": ("v 0 0\\\n 0\nv 1 0 \\\n\\\n0\nv 0 1 0\nf 1 2 9\n", "bad.obj:7: f:"),
    "fractions as index": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2.5\n", "bad.obj:4: f: expected corners"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_line_that_is_none_is_named(tmp_path, case):
    """File, line, tag, what was expected and what came."""
    content, message = BAD[case]
    (tmp_path / "bad.obj").write_text(content)
    with pytest.raises(InputError) as failure:
        read_mesh(tmp_path / "bad.obj", 1.0)
    assert message in str(failure.value)
    assert "\n" not in str(failure.value)
