"""A look's mesh with everything that shadows it: parts of its own file, and other files."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import ConfigError, InputError
from skinbake.io.config import load_look
from skinbake.io.mesh import read_look_mesh, write_obj
from skinbake.io.png import write_png
from skinbake.io.read_maps import read_maps
from skinbake.io.repaint import repaint
from skinbake.scene.casters import OPAQUE
from tests.gltf_files import plain
from tests.shapes import joined, quad, sphere

LOOK = """\
mesh: {path: head.obj, unit: mm}
skin: {preset: gpugems3-six-gaussians}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""


def look(folder, *overrides, text=LOOK):
    (folder / "look.yaml").write_text(text)
    return load_look(folder / "look.yaml", overrides)


def two_parts(folder, second, name="hair"):
    """head.obj: the group skin, and another."""
    write_obj(folder / "a.obj", sphere(100.0, "latlong", 12))
    write_obj(folder / "b.obj", second)
    first, other = ((folder / f"{name}.obj").read_text().splitlines() for name in "ab")
    count = {tag: sum(line.startswith(tag + " ") for line in first) for tag in ("v", "vt", "vn")}
    moved = []
    for line in other:
        if line.startswith("f "):
            corners = [[int(k) for k in corner.split("/")] for corner in line.split()[1:]]
            line = "f " + " ".join("/".join(str(k + count[t]) for k, t in zip(c, count, strict=True)) for c in corners)
        moved.append(line)
    (folder / "head.obj").write_text("\n".join(["g skin", *first, f"g {name}", *moved]) + "\n")


def test_hair_casts_and_skin_is_baked(tmp_path):
    """mesh.skin keeps one part as skin, welded on its own; the other is what rays meet besides."""
    two_parts(tmp_path, quad(240.0, 120.0))
    mesh = read_look_mesh(look(tmp_path, "mesh.skin=skin"))
    alone = sphere(100.0, "latlong", 12)
    assert len(mesh.faces) == len(alone.faces)
    assert mesh.positions_mm.shape == alone.positions_mm.shape
    assert len(mesh.casters.faces) == 2
    np.testing.assert_allclose(np.ptp(mesh.casters.positions_mm, axis=0), [240, 120, 0])
    assert (mesh.casters.image == OPAQUE).all()
    assert read_look_mesh(look(tmp_path, "mesh.skin=skin", "mesh.ignore=hair")).casters is None


def test_occluders_have_their_own_unit_parts_and_turn(tmp_path):
    """A hat in centimetres, z up, with one of its parts: in millimetres, y up, beside what the mesh casts."""
    two_parts(tmp_path, quad(240.0, 120.0))
    made, _ = plain(quad(24.0, 12.0))
    made.tree["nodes"] = [{"mesh": 0, "name": "hat"}, {"mesh": 0, "name": "stand", "translation": [99, 0, 0]}]
    made.tree["scenes"] = [{"nodes": [0, 1]}]
    (tmp_path / "hat.glb").write_bytes(made.glb())
    hat = "occluders=[{path: hat.glb, unit: cm, up: z, parts: hat}]"
    spec = look(tmp_path, "mesh.skin=skin")
    assert spec.occluders == ()
    text = LOOK + "occluders: [{path: hat.glb, unit: cm, up: z, parts: hat}]\n"
    mesh = read_look_mesh(look(tmp_path, "mesh.skin=skin", text=text))
    assert len(mesh.casters.faces) == 4
    own, hat = mesh.casters.positions_mm[:4], mesh.casters.positions_mm[4:]
    np.testing.assert_allclose(np.ptp(own, axis=0), [240, 120, 0], atol=1e-4)
    np.testing.assert_allclose(np.ptp(hat, axis=0), [240, 0, 120], atol=1e-4)  # y was up, and is -z
    with pytest.raises(InputError, match=r"hat\.glb: occluders\.parts: no part is called 'cap'; there are hat, head"):
        read_look_mesh(look(tmp_path, text=text.replace("parts: hat", "parts: cap")))
    with pytest.raises(ConfigError, match=r"occluders\[0\]\.path: expected a file"):
        look(tmp_path, text=text.replace("hat.glb", "gone.glb"))


@pytest.mark.parametrize(
    ("up", "front", "file_up", "file_front"),
    [
        (None, "z", "y", "z"),
        ("z", "z", "z", "-y"),
        ("y", "x", "y", "x"),
        ("y", "-z", "y", "-z"),
        ("z", "-x", "z", "-x"),
    ],
)
def test_up_and_front(tmp_path, up, front, file_up, file_front):
    """Whatever the file's axes, y is up and z is where the face looks; nothing is mirrored."""
    axis = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}
    axis |= {f"-{name}": -vector for name, vector in axis.items()}
    head = sphere(100.0, "latlong", 8)
    side = np.cross(axis[file_up], axis[file_front])
    turn = np.stack([side, axis[file_up], axis[file_front]], axis=1)
    shape = head.positions_mm * [0.8, 1.2, 1.0] + [0, 30.0, 70.0]
    stored = type(head)(shape @ turn.T, head.faces, head.corner_uv, head.corner_normal @ turn.T)
    write_obj(tmp_path / "head.obj", stored)
    options = [f"mesh.front={front}", *([f"mesh.up={up}"] if up else [])]
    mesh = read_look_mesh(look(tmp_path, *options))
    np.testing.assert_allclose(mesh.positions_mm.mean(axis=0), shape.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(np.ptp(mesh.positions_mm, axis=0), np.ptp(shape, axis=0), atol=1e-3)
    assert (np.einsum("fi,fi->f", mesh.face_normal, mesh.corner_normal.mean(axis=1)) > 0).all()


def test_unit_of_the_file(tmp_path):
    """glTF is in metres; an OBJ does not say."""
    (tmp_path / "head.glb").write_bytes(plain(sphere(0.1, "latlong", 8))[0].glb())
    text = LOOK.replace("head.obj, unit: mm", "head.glb, unit: file")
    assert np.ptp(read_look_mesh(look(tmp_path, text=text)).positions_mm[:, 1]) == pytest.approx(200, rel=1e-5)
    write_obj(tmp_path / "head.obj", sphere(100.0, "latlong", 8))
    with pytest.raises(InputError, match=r"head\.obj: unit: file: .*set mesh\.unit: mm, cm or m"):
        read_look_mesh(look(tmp_path, "mesh.unit=file"))


def test_opacity_needs_uvs(tmp_path):
    """A picture on a part without UVs is refused by the part's name."""
    write_obj(tmp_path / "head.obj", sphere(100.0, "latlong", 8))
    (tmp_path / "hair.obj").write_text("g fringe\nv 0 0 150\nv 90 0 150\nv 0 90 150\nf 1 2 3\n")
    write_png(tmp_path / "alpha.png", np.full((2, 2, 3), 128, np.uint8))
    text = LOOK + "occluders: [{path: hair.obj, unit: mm, opacity: alpha.png}]\n"
    with pytest.raises(InputError, match=r"occluders\.opacity: expected UVs by which to look it up, fringe has none"):
        read_look_mesh(look(tmp_path, text=text))


def test_maps_for_a_layout_that_is_made_are_refused(tmp_path):
    """No map was painted for UVs that the file does not have."""
    write_obj(tmp_path / "uv.obj", sphere(100.0, "latlong", 12))
    bare = [line.replace("//", "/") for line in (tmp_path / "uv.obj").read_text().splitlines() if line[:2] != "vt"]
    faces = ["f " + " ".join(c.split("/")[0] for c in line.split()[1:]) if line[0] == "f" else line for line in bare]
    (tmp_path / "head.obj").write_text("\n".join(faces))
    write_png(tmp_path / "map.png", np.full((4, 4, 3), 200, np.uint8))
    assert read_look_mesh(look(tmp_path, "texture.unwrap=xatlas")).map_uv is None
    spec = look(tmp_path, "texture.unwrap=xatlas", f"maps.albedo={tmp_path / 'map.png'}")
    with pytest.raises(InputError, match=r"maps\.albedo: was painted for UVs that the mesh does not have"):
        read_look_mesh(spec)


def test_mirrored_halves_get_their_own_place_and_their_maps(tmp_path):
    """Two quads on one place of a map: unwrapped apart, each reads the map by its old UVs, normals too."""
    halves = joined(quad(100.0, 200.0), quad(100.0, 200.0, 150.0))
    write_obj(tmp_path / "head.obj", halves)
    ramp = np.zeros((64, 64, 3), np.uint8)
    ramp[..., 0], ramp[..., 1] = np.arange(64) * 4, np.arange(64)[::-1, None] * 4
    write_png(tmp_path / "map.png", ramp)
    spec = look(tmp_path, "texture.unwrap=xatlas", "texture.size=128", f"maps.albedo={tmp_path / 'map.png'}",
                "maps.albedo.color_space=linear")  # fmt: skip
    mesh = read_look_mesh(spec)
    np.testing.assert_allclose(mesh.map_uv, halves.corner_uv, atol=1e-6)
    from skinbake.atlas import interpolate, rasterize, uv_report

    (raster,) = rasterize(mesh, (128, 128), 8)
    assert uv_report(mesh, [raster]).overlapping == 0
    maps = repaint(spec, mesh, read_maps(spec.maps))
    place = interpolate(raster, mesh.corner_position_mm - mesh.positions_mm.min(axis=0))
    inside = raster.covered
    u, v = place[inside, 0] / 100, place[inside, 1] / 200
    np.testing.assert_allclose(maps.albedo[1001][inside, 0], (u * 64 - 0.5).clip(0, 63) * 4 / 255, atol=0.02)
    np.testing.assert_allclose(maps.albedo[1001][inside, 1], (v * 64 - 0.5).clip(0, 63) * 4 / 255, atol=0.02)
