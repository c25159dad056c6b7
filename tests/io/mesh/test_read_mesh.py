"""Meshes come in as they are in the file: welded in space, split where UVs and normals are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from skinbake.atlas import signed_uv_area
from skinbake.errors import InputError
from skinbake.io.mesh import read_mesh, unwrap_mesh, write_obj
from tests.gltf_files import plain
from tests.shapes import quad, sphere

TENT = """# two quads that share the edge 2 3 in space; its UVs and normals differ on either side
v 0 0 0
v 100 0 0
v 100 100 0
v 0 100 0
v 200 0 50
v 200 100 50
vt 0 0
vt 0.4 0
vt 0.4 1
vt 0 1
vt 0.6 0
vt 1 0
vt 1 1
vt 0.6 1
vn 0 0 1
vn -0.4472135955 0 0.894427191
f 1/1/1 2/2/1 3/3/1 4/4/1
f 2/5/2 5/6/2 6/7/2 3/8/2
"""


def written(folder, text, name="mesh.obj"):
    path = folder / name
    path.write_text(text)
    return path


def by_place(mesh):
    """Corners keyed by place, so that two meshes compare whatever the order of their faces."""
    rows = np.concatenate([mesh.corner_position_mm, mesh.corner_uv, mesh.corner_normal], axis=2).round(4) + 0.0
    turned = [np.roll(face, -np.lexsort(face.T[::-1])[0], axis=0).ravel() for face in rows]
    return np.array(sorted(map(tuple, turned)))


def test_a_seam_is_welded_in_space_and_split_in_uv(tmp_path):
    """Two quads: four triangles, six positions, and each corner the UV and normal of its own side."""
    mesh = read_mesh(written(tmp_path, TENT), 1.0)
    assert mesh.positions_mm.shape == (6, 3)
    assert mesh.faces.shape == (4, 3)
    left = mesh.corner_position_mm[..., 0].max(axis=1) <= 100
    assert (mesh.corner_uv[left, :, 0] <= 0.4).all()
    assert (mesh.corner_uv[~left, :, 0] >= 0.6).all()
    np.testing.assert_allclose(mesh.corner_normal[left], np.broadcast_to([0, 0, 1.0], (2, 3, 3)))
    assert (signed_uv_area(mesh) > 0).all()
    # u runs with x on both sides: nothing was mixed up across the seam
    x, u = mesh.corner_position_mm[left][..., 0], mesh.corner_uv[left][..., 0]
    np.testing.assert_allclose(u, 0.004 * x, atol=1e-9)


def test_the_scan_keeps_every_uv(lee_perry_smith):
    """OBJ and GLB of the scan agree, flipped V included, and no triangle spans the texture."""
    obj = read_mesh(lee_perry_smith / "head.obj", 50.35)
    assert obj.positions_mm.shape == (8844, 3)
    assert obj.faces.shape == (17684, 3)
    assert np.ptp(obj.corner_uv, axis=1).max() < 0.3
    glb = lee_perry_smith / "LeePerrySmith.glb"
    if glb.is_file():
        other = read_mesh(glb, 50.35, flip_v=True)
        np.testing.assert_allclose(other.positions_mm, obj.positions_mm, atol=1e-3)
        np.testing.assert_allclose(other.corner_uv, obj.corner_uv, atol=1e-5)
        np.testing.assert_allclose(other.corner_normal, obj.corner_normal, atol=1e-4)


def test_what_is_written_is_read(tmp_path):
    """write_obj and read_mesh are inverses, in another unit too."""
    mesh = sphere(90.0, "cube", 16)
    write_obj(tmp_path / "out.obj", mesh, mm_per_unit=10.0)
    back = read_mesh(tmp_path / "out.obj", 10.0)
    assert back.positions_mm.shape == mesh.positions_mm.shape
    np.testing.assert_allclose(by_place(back), by_place(mesh), atol=2e-4)


@pytest.mark.parametrize("suffix", ["glb", "ply"])
def test_other_formats_agree_with_obj(tmp_path, suffix):
    """GLB and PLY of one mesh give the same triangles, UVs with v up."""
    mesh = sphere(90.0, "latlong", 12)
    corners = mesh.corner_position_mm.reshape(-1, 3)
    soup = trimesh.Trimesh(
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        visual=trimesh.visual.TextureVisuals(uv=mesh.corner_uv.reshape(-1, 2)),
        vertex_normals=mesh.corner_normal.reshape(-1, 3),
        process=False,
    )
    path = tmp_path / f"mesh.{suffix}"
    if suffix == "ply":
        vertices = "\n".join(
            " ".join(f"{x:.9g}" for x in row)
            for row in np.concatenate([corners, soup.vertex_normals, soup.visual.uv], axis=1)
        )
        faces = "\n".join("3 " + " ".join(map(str, face)) for face in soup.faces)
        names = "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
        path.write_text(
            f"ply\nformat ascii 1.0\nelement vertex {len(corners)}\n{names}"
            f"element face {len(soup.faces)}\nproperty list uchar int vertex_indices\nend_header\n{vertices}\n{faces}\n"
        )
    else:
        soup.export(path, include_normals=True)
    back = read_mesh(path, 1.0)
    assert back.faces.shape == mesh.faces.shape
    assert back.positions_mm.shape == mesh.positions_mm.shape
    np.testing.assert_allclose(back.corner_position_mm, mesh.corner_position_mm, atol=1e-3)
    np.testing.assert_allclose(back.corner_uv, mesh.corner_uv, atol=1e-5)
    np.testing.assert_allclose(back.corner_normal, mesh.corner_normal, atol=1e-3)


def test_a_transformed_and_mirrored_part_is_placed(tmp_path):
    """A node with a mirroring matrix: positions placed, triangles still outside, normals turned."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    ball.visual = trimesh.visual.TextureVisuals(uv=ball.vertices[:, :2] * 0.4 + 0.5)
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=np.diag([-100.0, 100.0, 100.0, 1.0]))
    scene.export(tmp_path / "part.glb", include_normals=True)
    mesh = read_mesh(tmp_path / "part.glb", 1.0)
    centre = mesh.corner_position_mm.mean(axis=1)
    assert (np.einsum("ij,ij->i", mesh.face_normal, centre) > 0).all()
    assert (np.einsum("ij,ij->i", mesh.corner_normal[:, 0], centre) > 0).all()
    assert np.abs(mesh.positions_mm).max() == pytest.approx(100, rel=1e-5)


def test_polygons_and_negative_indices(tmp_path):
    """A pentagon becomes three triangles that keep its area; indices from the end count back."""
    text = (
        "v 0 0 0\nv 100 0 0\nv 150 80 0\nv 50 150 0\nv -50 80 0\n"
        + "vt 0.1 0.1\nvt 0.5 0.1\nvt 0.7 0.4\nvt 0.3 0.7\nvt 0 0.4\n"
    )
    mesh = read_mesh(written(tmp_path, text + "f -5/-5 -4/-4 -3/-3 -2/-2 -1/-1\n"), 1.0)
    assert mesh.faces.shape == (3, 3)
    assert mesh.face_area_mm2.sum() == pytest.approx(8000 + 0.5 * 200 * 70 + 4000, rel=1e-9)
    np.testing.assert_allclose(mesh.corner_normal, np.broadcast_to([0, 0, 1.0], (3, 3, 3)), atol=1e-12)


def test_normals_are_made_where_the_file_has_none(tmp_path):
    """Without vn a UV seam does not become a crease: normals are smooth over welded positions."""
    ball = sphere(100.0, "latlong", 24)
    write_obj(tmp_path / "ball.obj", ball)
    lines = [
        " ".join(part.rsplit("/", 1)[0] if i else part for i, part in enumerate(line.split()))
        for line in (tmp_path / "ball.obj").read_text().splitlines()
        if not line.startswith("vn")
    ]
    mesh = read_mesh(written(tmp_path, "\n".join(lines), "plain.obj"), 1.0)
    radial = mesh.corner_position_mm / 100.0
    assert np.einsum("fki,fki->fk", mesh.corner_normal, radial).min() > 0.999


def test_flip_v(tmp_path):
    """flip_v turns v into 1 - v."""
    path = written(tmp_path, TENT)
    np.testing.assert_allclose(
        read_mesh(path, 1.0, flip_v=True).corner_uv[..., 1], 1 - read_mesh(path, 1.0).corner_uv[..., 1]
    )


def test_unwrap_makes_charts_without_overlap():
    """xatlas gives every triangle its own place in the unit square, faces in the order they were."""
    mesh = sphere(80.0, "cube", 24)
    made = unwrap_mesh(mesh)
    np.testing.assert_array_equal(made.faces, mesh.faces)
    assert made.corner_uv.min() >= 0
    assert made.corner_uv.max() <= 1
    area = np.abs(signed_uv_area(made))
    assert (area > 0).all()
    from skinbake.atlas import rasterize, uv_report

    report = uv_report(made, rasterize(made, (512, 512)))
    assert report.overlapping == 0
    assert report.faults == ()


def test_reading_unwraps_where_it_is_asked_for(tmp_path):
    """unwrap: xatlas makes UVs for a bare mesh, and for one that has some, which are kept to read maps by."""
    bare = "\n".join(line for line in TENT.splitlines() if line[:2] in ("v ", "# ")) + "\nf 1 2 3 4\nf 2 5 6 3\n"
    made = read_mesh(written(tmp_path, bare), 1.0, unwrap="xatlas")
    assert np.ptp(made.corner_uv) > 0.1
    assert made.map_uv is None
    path = written(tmp_path, TENT, "tent.obj")
    made, own = read_mesh(path, 1.0, unwrap="xatlas"), read_mesh(path, 1.0)
    np.testing.assert_array_equal(made.map_uv, own.corner_uv)
    assert np.abs(made.corner_uv - own.corner_uv).max() > 0.1
    assert own.map_uv is None


BAD = {
    "missing": (None, "no such file"),
    "empty": ("", "expected triangles, got none"),
    "text": ("hello, this is no mesh\n", "expected triangles, got none"),
    "no triangles": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "expected triangles, got none"),
    "no uvs": ("v 0 0 0\nv 200 0 0\nv 0 200 0\nf 1 2 3\n", "set texture.unwrap: xatlas"),
    "nan": (TENT.replace("v 200 0 50", "v nan 0 50"), "NaN or Inf, the first at index"),
    "inf uv": (TENT.replace("vt 0.6 1", "vt inf 1"), "expected finite UVs"),
    "vertex 99": (
        TENT + "f 1/1/1 2/2/1 99/3/1\n",
        "bad.obj:20: f: expected a vertex from 1 to 6, or from -6 to -1, got 99",
    ),
    "vertex 0": (
        TENT + "f 1/1/1 2/2/2 0/3/1\n",
        "bad.obj:20: f: expected a vertex from 1 to 6, or from -6 to -1, got 0",
    ),
    "uv 0": (TENT + "f 1/1/1 2/0/1 3/3/1\n", "bad.obj:20: f: expected a UV from 1 to 8, or from -8 to -1, got 0"),
    "uv far out": (TENT + "f 1/1/1 2/-99999999/1 3/3/1\n", "bad.obj:20: f: expected a UV from 1 to 8"),
    "normal 0": (TENT + "f 1/1/1 2/2/1 3/3/0", "bad.obj:20: f: expected a normal from 1 to 2, or from -2 to -1, got 0"),
    "normal -3": (TENT + "f 1/1/-3 2/2/1 3/3/1\n", "bad.obj:20: f: expected a normal from 1 to 2"),
    "bare index 0": ("v 0 0 0\nv 9 0 0\nv 0 9 0\nf 0 1 2\n", "bad.obj:4: f: expected a vertex from 1 to 3"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_mesh_is_refused_with_its_fault(tmp_path, case):
    """Each fault ends as one line that names the file and what is wrong with it."""
    text, message = BAD[case]
    path = tmp_path / "bad.obj"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=r"bad\.obj") as failure:
        read_mesh(path, 1.0)
    assert message in str(failure.value)
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize(
    ("factor", "fix"),
    [(0.001, "mesh.unit: m"), (0.1, "mesh.unit: cm"), (0.01, "mesh.unit: dm"), (1000.0, "mm_per_unit")],
)
def test_a_head_of_the_wrong_unit_is_refused_with_the_right_one(tmp_path, factor, fix):
    """0.24 'mm' is a head in metres: the message says so; any_size lets it pass."""
    write_obj(tmp_path / "head.obj", quad(240 * factor, 200 * factor))
    with pytest.raises(InputError, match=fix):
        read_mesh(tmp_path / "head.obj", 1.0)
    read_mesh(tmp_path / "head.obj", 1.0, any_size=True)


@pytest.mark.parametrize(
    ("size", "mm_per_unit", "said"),
    [
        (1.75, 1000.0, "size of a whole body in metres: set mesh.any_size: true"),
        (175.0, 10.0, "size of a whole body in centimetres: set mesh.any_size: true"),
        (1.75, 1.0, "set mesh.unit: dm (175 mm), or mesh.unit: m and mesh.any_size: true for a whole body (1750 mm)"),
    ],
)
def test_a_whole_body_is_told_from_a_wrong_unit(tmp_path, size, mm_per_unit, said):
    """A body in its right unit is offered any_size and no other unit."""
    write_obj(tmp_path / "body.obj", quad(size, size / 2))
    with pytest.raises(InputError) as failure:
        read_mesh(tmp_path / "body.obj", mm_per_unit)
    assert said in str(failure.value)
    assert ("mesh.unit" in str(failure.value)) == (mm_per_unit == 1.0)


def test_a_gltf_in_another_unit_is_told_its_own(tmp_path):
    """glTF is in metres: 0.24 of it are a head, whatever the look says."""
    (tmp_path / "head.glb").write_bytes(plain(quad(0.24, 0.2))[0].glb())
    with pytest.raises(InputError, match=r"own unit makes it 240: set mesh\.unit: file, or"):
        read_mesh(tmp_path / "head.glb", 10.0)
    assert np.ptp(read_mesh(tmp_path / "head.glb", None).positions_mm[:, 0]) == pytest.approx(240)


def test_truncated_binary_is_refused(tmp_path):
    """Half a GLB is an error with the file's name, no traceback of the parser."""
    ball = trimesh.creation.icosphere()
    ball.export(tmp_path / "ball.glb")
    data = (tmp_path / "ball.glb").read_bytes()
    (tmp_path / "half.glb").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"half\.glb"):
        read_mesh(tmp_path / "half.glb", 100.0)
