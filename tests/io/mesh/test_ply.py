"""PLY in text and in both byte orders, with UVs on vertices or on faces, and with strips."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.mesh import read_mesh
from skinbake.io.mesh.ply import read_ply
from tests.shapes import sphere

KINDS = {"char": "i1", "uchar": "u1", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
GRID = np.array([[x, y, 0.0] for y in (0, 100) for x in (0, 100, 200)])


def ply(form, *elements, comments=()):
    """Bytes of a PLY; an element is (name, [(property, kind or (length kind, kind)), ...], rows)."""
    head, body = [f"ply\nformat {form} 1.0\n", *(f"comment {c}\n" for c in comments)], b""
    order = ">" if form.endswith("big_endian") else "<"
    for name, properties, rows in elements:
        head.append(f"element {name} {len(rows)}\n")
        for prop, kind in properties:
            head.append(
                f"property {kind} {prop}\n" if isinstance(kind, str) else f"property list {' '.join(kind)} {prop}\n"
            )
        for row in rows:
            words = []
            for value, (_, kind) in zip(row, properties, strict=True):
                items = (
                    [("", kind, [value])]
                    if isinstance(kind, str)
                    else [("n", kind[0], [len(value)]), ("", kind[1], value)]
                )
                for _, k, values in items:
                    if form == "ascii":
                        words += [
                            f"{v:g}" if "i" not in KINDS[k] and "u" not in KINDS[k] else str(int(v)) for v in values
                        ]
                    else:
                        body += np.asarray(values, order + KINDS[k]).tobytes()
            if form == "ascii":
                body += (" ".join(words) + "\n").encode()
    return "".join([*head, "end_header\n"]).encode() + body


VERTEX = ("vertex", [("x", "float"), ("y", "double"), ("z", "float")], GRID)
FACE = ("uchar", "int")


def read(tmp_path, data):
    (tmp_path / "scan.ply").write_bytes(data)
    return read_mesh(tmp_path / "scan.ply", 1.0)


def assert_grid(mesh, triangles):
    """Area, side and UVs of the two squares."""
    assert len(mesh.faces) == triangles
    assert mesh.face_area_mm2.sum() == pytest.approx(20000)
    np.testing.assert_allclose(mesh.face_normal, np.broadcast_to([0, 0, 1.0], (triangles, 3)))
    np.testing.assert_allclose(mesh.corner_uv, mesh.corner_position_mm[..., :2] / 200, atol=1e-7)


@pytest.mark.parametrize("form", FORMATS)
def test_texcoord_lists_on_mixed_faces(tmp_path, form):
    """Quads and triangles with texcoord lists, a texture that is not there: UVs of each corner."""
    uv = GRID[:, :2] / 200
    faces = [QUADS[0], [1, 2, 5], [1, 5, 4]]
    rows = [(face, uv[face].ravel()) for face in faces]
    data = ply(form, VERTEX, ("face", [("vertex_indices", FACE), ("texcoord", ("uchar", "float"))], rows),
               comments=["TextureFile gone.png"])  # fmt: skip
    assert_grid(read(tmp_path, data), 4)


@pytest.mark.parametrize("form", FORMATS)
def test_textures_of_their_own_are_parts(tmp_path, form):
    """texnumber: quads cut into triangles keep the name of their texture; a single one is no part."""
    faces, strips = [*QUADS, [0, 1, 4]], [([3, 4, 5],)]
    rows = [(face, number) for face, number in zip(faces, (1, 0, 1), strict=True)]
    face = [("vertex_indices", FACE), ("texnumber", "int")]
    strip = ("tristrips", [("vertex_indices", FACE)], strips)
    (tmp_path / "scan.ply").write_bytes(ply(form, VERTEX, ("face", face, rows), strip))
    raw = read_ply(tmp_path / "scan.ply")
    assert raw.labels == ("no texture", "texture 0", "texture 1")
    named = {frozenset(f): raw.labels[k] for f, k in zip(raw.faces.tolist(), raw.part, strict=True)}
    assert named == {
        frozenset(corners): f"texture {k}" if k is not None else "no texture"
        for corners, k in (((0, 1, 4), 1), ((0, 4, 3), 1), ((1, 2, 5), 0), ((1, 5, 4), 0), ((3, 4, 5), None))
    }
    (tmp_path / "one.ply").write_bytes(ply(form, VERTEX, ("face", face, [(QUADS[0], 0)])))
    assert read_ply(tmp_path / "one.ply").names == ((),)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("names", [("u", "v"), ("s", "t"), ("texture_u", "texture_v")])
def test_uvs_on_vertices(tmp_path, form, names):
    """Quads alone, by any of the usual names of UVs, with colours between."""
    rows = [(*p, 255, *(p[:2] / 200)) for p in GRID]
    properties = [*VERTEX[1], ("red", "uchar"), *((n, "float") for n in names)]
    data = ply(
        form,
        ("vertex", properties, rows),
        ("face", [("flags", "uchar"), ("vertex_index", FACE)], [(1, q) for q in QUADS]),
    )
    assert_grid(read(tmp_path, data), 4)


@pytest.mark.parametrize("form", FORMATS)
def test_strips(tmp_path, form):
    """Strips that end at -1, as scanners write them; lists of several strips; degenerate steps turn no triangle."""
    rows = [(*p, *(p[:2] / 200)) for p in GRID]
    vertex = ("vertex", [*VERTEX[1], ("u", "float"), ("v", "float")], rows)
    for strips in ([[3, 0, 4, 1, 5, 2]], [[3, 0, 4, 1, -1, 4, 1, 5, 2]], [[3, 0, 4, 1], [4, 1, 5, 2, -1]]):
        data = ply(form, vertex, ("tristrips", [("vertex_indices", ("int", "int"))], [(s,) for s in strips]))
        assert_grid(read(tmp_path, data), 4)


def test_normals_and_a_head(tmp_path):
    """Normals of the vertices are kept."""
    mesh = sphere(100.0, "latlong", 8)
    rows = np.concatenate([mesh.corner_position_mm, mesh.corner_normal, mesh.corner_uv], axis=2).reshape(-1, 8)
    names = [(n, "double") for n in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    faces = np.arange(len(rows)).reshape(-1, 3)
    got = read(
        tmp_path,
        ply(
            "binary_little_endian", ("vertex", names, rows), ("face", [("vertex_indices", FACE)], [(f,) for f in faces])
        ),
    )
    np.testing.assert_allclose(got.corner_normal, mesh.corner_normal, atol=1e-12)
    np.testing.assert_array_equal(got.corner_position_mm, mesh.corner_position_mm)


def good(form="ascii", vertex=VERTEX, faces=QUADS, **more):
    return ply(form, vertex, ("face", [("vertex_indices", FACE)], [(f,) for f in faces]), **more)


BAD = {
    "cut off": (good("binary_little_endian")[:-3], "of element face, the file ends before; cut off?"),
    "cut off text": (good()[:-6], "of element face, the file ends before; cut off?"),
    "no header's end": (b"ply\nformat ascii 1.0\n", "expected end_header"),
    "no PLY": (b"hello\n", "begins with ply"),
    "an index past the vertices": (good(faces=[[0, 1, 99]]), "a triangle names vertex 99, of 6 vertices"),
    "a negative index": (good(faces=[[0, 1, -2]]), "a triangle names vertex -2"),
    "no z": (good(vertex=("vertex", VERTEX[1][:2], GRID[:, :2])), "expected vertices with x, y and z"),
    "a word": (good().replace(b"\n100 ", b"\nhundred "), "expected numbers after the header"),
    "an unknown kind": (good().replace(b"property float x", b"property quad x"), "is not a line of a PLY's header"),
    "endless": (good().replace(b"vertex 6", b"vertex 6000000000000"), "of element vertex, the file ends before"),
    "odd texcoord": (
        ply("ascii", VERTEX, ("face", [("vertex_indices", FACE), ("texcoord", FACE)], [(QUADS[0], [0, 1])])),
        "face 0: expected 8 texcoord numbers, got 2",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_damage_is_named(tmp_path, case):
    """One line with the file's name."""
    data, message = BAD[case]
    with pytest.raises(InputError, match=r"scan\.ply") as failure:
        read(tmp_path, data)
    assert message in str(failure.value)
    assert "\n" not in str(failure.value)
