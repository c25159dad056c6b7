"""Plain OBJ files are read as trimesh reads them, to the last bit; all others are left to it."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.io import mesh as mesh_file
from skinbake.io.mesh import read_mesh, write_obj
from skinbake.io.obj import read_plain_obj
from tests.shapes import joined, quad, relief, sphere

CORNERS = """v 0 0 0
v 100 0 1e1
v 100.25 1.00e+2 -0.125
v -1e-1 +80. .5
vt 0 0
vt 1 0
vt 1 1
vt .25 1
vn 0 0 1
vn 0 0.6 0.8
"""
FACES = {
    "v": "f 1 2 3\nf 1 3 4\n",
    "v/vt": "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n",
    "v//vn": "f 1//1 2//1 3//1\nf 1//2 3//2 4//2\n",
    "v/vt/vn": "f 1/1/1 2/2/1 3/3/1\nf 1/1/2 3/3/2 4/4/2",
    "names, comments": "o a\n# v 1\ng b c\ns off\nusemtl m\nf 1/1/1  2/2/1\t3/3/1 \r\n\n s 1\nf 1/1/2 3/3/2 4/4/2\n",
}  # fmt: skip
OTHERS = {
    "a quad": "f 1 2 3 4\n",
    "negative numbers": "f -4 -3 -2\n",
    "a vertex that is not there": "f 1 2 5\n",
    "vertex zero": "f 0 1 2\n",
    "corners of two kinds": "f 1/1 2/2 3\n",
    "a line that goes on": "f 1 2 \\\n3\n",
    "colours": "v 0 0 0 1 1 1\nf 1 2 3\n",
    "a depth of the texture": "vt 0 0 0\nf 1 2 3\n",
    "not a number": "v nan 0 0\nf 1 2 3\n",
    "more digits than are exact": "v 0.12345678901234567 0 0\nf 1 2 3\n",
    "a power that is not exact": "v 1e23 0 0\nf 1 2 3\n",
    "no digit": "v . 0 0\nf 1 2 3\n",
    "a word": "f 1 2 3\nl 1 2\n",
    "a face cut short": "f 1 2",
    "no face": "",
}


def agree(path, monkeypatch, **options):
    """Read it both ways."""
    assert read_plain_obj(path.read_bytes()) is not None
    ours = read_mesh(path, 1.0, any_size=True, **options)
    with monkeypatch.context() as patch:
        patch.setattr(mesh_file, "read_plain_obj", lambda data: None)
        theirs = read_mesh(path, 1.0, any_size=True, **options)
    for name in ("positions_mm", "faces", "corner_uv", "corner_normal"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), name)


@pytest.mark.parametrize("corners", FACES)
def test_every_kind_of_corner_is_read_as_trimesh_reads_it(tmp_path, monkeypatch, corners):
    """Positions, faces, UVs and normals are equal, with comments, names, tabs and Windows' line ends between them."""
    path = tmp_path / "mesh.obj"
    path.write_bytes((CORNERS + FACES[corners]).encode())
    agree(path, monkeypatch, without_uvs=True)


def test_what_we_write_is_plain(tmp_path, monkeypatch):
    """Seams, hard edges and several charts: both readers give the same mesh."""
    for mesh in (sphere(60.0, "cube", 8), relief(segments=9), joined(quad(), sphere(30.0, "latlong", 9))):
        write_obj(tmp_path / "mesh.obj", mesh)
        agree(tmp_path / "mesh.obj", monkeypatch)


@pytest.mark.parametrize("fault", OTHERS)
def test_what_is_not_plain_is_left_to_trimesh(fault):
    """None, whatever it is that is unusual or wrong: one reader judges it."""
    assert read_plain_obj((CORNERS + OTHERS[fault]).encode()) is None


def test_numbers_are_rounded_once():
    """Ten thousand numbers of up to 15 digits come out as Python reads them."""
    rng = np.random.default_rng(3)
    texts = [
        f"{rng.normal() * 10.0 ** rng.integers(-6, 9):.{rng.integers(1, 16)}{kind}}"
        for kind in "fge"
        for _ in range(3333)
    ]
    texts = [text for text in texts if sum(c.isdigit() for c in text.split("e")[0]) <= 15]
    assert len(texts) > 5000
    texts = texts[: len(texts) // 3 * 3]
    lines = [f"v {' '.join(texts[i : i + 3])}" for i in range(0, len(texts), 3)]
    faces = [f"f {i} {i} {i}" for i in range(1, len(lines) + 1)]
    position, *_ = read_plain_obj("\n".join(lines + faces).encode())
    np.testing.assert_array_equal(position[::3].ravel(), [float(text) for text in texts])
