"""`skinbake init` writes a look that bakes as it stands, whatever the mesh is made of."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest

from skinbake.cli import run
from skinbake.cli.check import examine
from skinbake.io.config import load_look
from skinbake.io.mesh import read_look_mesh, write_obj
from skinbake.io.png import write_png
from skinbake.io.schema_file import HEADER
from skinbake.io.yaml_lines import read_yaml
from tests.conftest import ROOT
from tests.gltf_files import Gltf, plain, vertices_of
from tests.shapes import quad, sphere


def started(folder, mesh, *overrides):
    """The look that init writes for a mesh in a folder."""
    look = folder / "me.yaml"
    assert run(["init", str(folder / mesh), "--out", str(look), "--force"]) == 0
    return load_look(look, ("texture.size=64", "texture.gutter=2", *overrides))


def shrunk(mesh, scale, uv_box=(0.0, 0.0, 1.0, 1.0)):
    low, high = np.array(uv_box[:2]), np.array(uv_box[2:])
    return type(mesh)(mesh.positions_mm * scale, mesh.faces, low + mesh.corner_uv * (high - low), mesh.corner_normal)


def character(folder):
    """A face and the back of a head side by side, eyes, sockets and teeth on their places, lashes: one GLB, metres."""
    made, nodes = Gltf(), []
    ball = sphere(120.0, "latlong", 12)
    front = ball.corner_position_mm.mean(axis=1)[:, 2] > 0

    def half(keep):
        return type(ball)(ball.positions_mm, ball.faces[keep], ball.corner_uv[keep], ball.corner_normal[keep])

    small = sphere(15.0, "latlong", 6)
    parts = {
        "Face": (half(front), [0, 0, 0]),
        "Back of head": (half(~front), [0, 0, 0]),
        "Eyeball left": (small, [0.04, 0.02, 0.1]),
        "Eyeball right": (small, [-0.04, 0.02, 0.1]),
        "Eye socket left": (shrunk(small, 1.2, (0.0, 0.0, 0.2, 0.2)), [0.04, 0.02, 0.09]),
        "Teeth": (shrunk(quad(40, 20), 1.0), [0, -0.05, 0.1]),
        "Eyelashes": (shrunk(quad(40, 10), 1.0), [0.04, 0.04, 0.12]),
    }
    for name, (mesh, shift) in parts.items():
        positions, uv, normals, faces = vertices_of(mesh)
        attributes = {"POSITION": made.accessor(positions / 1000), "NORMAL": made.accessor(normals)}
        attributes["TEXCOORD_0"] = made.accessor(uv)
        mesh_index = made.mesh(attributes, made.accessor(faces.ravel(), "I"), name=name)
        nodes.append({"name": name, "mesh": mesh_index, "translation": shift})
    made.tree["nodes"], made.tree["scenes"] = nodes, [{"nodes": list(range(len(nodes)))}]
    (folder / "hero.glb").write_bytes(made.glb())


def test_a_character_of_many_parts(tmp_path):
    """Face and back of head are skin, eyes and teeth cast, lashes are left out, a socket on the face's UVs casts."""
    character(tmp_path)
    spec = started(tmp_path, "hero.glb")
    assert spec.mesh.unit == "file"
    assert spec.mesh.skin == ("Face", "Back of head")
    assert spec.mesh.ignore == ("Eyelashes",)
    report, _, uv = examine(spec)
    assert uv.faults == ()
    roles = {row["name"]: row["role"] for row in report["parts"]}
    assert roles["Teeth"] == roles["Eyeball left"] == roles["Eye socket left"] == "cast"
    assert len(spec.lights) == 3


def test_it_bakes_as_it_stands(tmp_path, capsys):
    """In one command after init; the key light meets the face."""
    character(tmp_path)
    started(tmp_path, "hero.glb")
    small = ["--set", "texture.size=64", "--set", "texture.gutter=2", "--set", "diffusion.tolerance=0.3"]
    assert run(["bake", str(tmp_path / "me.yaml"), "--quiet", "--no-preview", *small]) == 0
    assert (tmp_path / "out" / "me" / "lobe_0.exr").is_file()


def test_the_face_goes_before_larger_skin_that_lies_on_its_uvs(tmp_path):
    """As where face, back of head and sockets have a texture each: it bakes, and the others are named."""
    lines = list[str]()
    for number, (name, size, z) in enumerate(
        [("HeadAndNeck", 24, -9), ("MyFace", 20, 0), ("EyeSocketLeft", 2, -1), ("FaceHair", 22, 3), ("Teeth", 3, -2)]
    ):
        corners = [(-size / 2, -size / 2), (size / 2, -size / 2), (size / 2, size / 2), (-size / 2, size / 2)]
        lines += [f"g {name}", *(f"v {x} {y} {z}" for x, y in corners), "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
        lines.append("f " + " ".join(f"{4 * number + k}/{4 * number + k}" for k in (1, 2, 3, 4)))
    (tmp_path / "ict.obj").write_text("\n".join(lines))
    spec = started(tmp_path, "ict.obj")
    assert spec.mesh.skin == ("MyFace",)
    assert spec.texture.unwrap == "none"
    text = (tmp_path / "me.yaml").read_text()
    assert "# HeadAndNeck: skin, too, but with UVs where other skin has its own." in text
    small = ["--set", "texture.size=32", "--set", "texture.gutter=2", "--set", "diffusion.tolerance=0.3"]
    assert run(["bake", str(tmp_path / "me.yaml"), "--quiet", "--no-preview", *small]) == 0


@pytest.mark.parametrize(
    ("size", "wanted"), [(240.0, "mm"), (24.0, "cm"), (0.24, "m"), (9.4, "inch"), (1.75, "m"), (7e4, None)]
)
def test_the_unit_is_guessed(tmp_path, size, wanted):
    """By the size of a head, else of a body, else a length that makes it a head."""
    write_obj(tmp_path / "head.obj", quad(size, size * 0.8, columns=2, rows=2))
    spec = started(tmp_path, "head.obj")
    expected = "dm" if size == 1.75 else wanted  # 175 mm are a head, which is likelier than a body here
    assert spec.mesh.unit == expected
    assert 80 <= np.ptp(read_look_mesh(spec).positions_mm, axis=0).max() <= 1000


def test_a_body_in_metres_stays_one(tmp_path):
    """glTF says its unit."""
    (tmp_path / "body.glb").write_bytes(plain(quad(0.9, 1.75))[0].glb())
    spec = started(tmp_path, "body.glb")
    assert (spec.mesh.unit, spec.mesh.any_size) == ("file", True)


def test_maps_beside_the_mesh(tmp_path):
    """By their names, in its folder or textures/; two of one kind are not chosen between; without: a skin colour."""
    write_obj(tmp_path / "head.obj", quad(240.0, 200.0, columns=2, rows=2))
    assert started(tmp_path, "head.obj").maps.albedo is None
    assert max(started(tmp_path, "head.obj").maps.albedo_rgb) < 0.7
    grey = np.full((4, 4, 3), 128, np.uint8)
    (tmp_path / "textures").mkdir()
    for name in ("head_BaseColor.png", "old_color.png", "textures/Normal.png", "rough_1.png", "rough_2.png"):
        write_png(tmp_path / name, grey)
    maps = started(tmp_path, "head.obj").maps
    assert maps.albedo.path == str(tmp_path / "head_BaseColor.png")
    assert maps.normal.path == str(tmp_path / "textures" / "Normal.png")
    assert maps.roughness is None


@pytest.mark.parametrize("tiles", [("1001", "1002"), ("u1_v1", "u2_v1"), ("1002",)])
def test_maps_of_tiles_beside_the_mesh(tmp_path, tiles):
    """Pictures that differ in the number of their tile alone are one map; another number is part of the name."""
    write_obj(tmp_path / "head.obj", sphere(120.0, "latlong", 12, tiles=2))
    for tile in tiles:
        write_png(tmp_path / f"head_2048_albedo.{tile}.png", np.full((4, 4, 3), 128, np.uint8))
    spec = started(tmp_path, "head.obj")
    mark = "<UVTILE>" if "_" in tiles[0] else "<UDIM>"
    assert spec.maps.albedo.path == str(tmp_path / f"head_2048_albedo.{mark}.png")
    assert run(["check", str(tmp_path / "me.yaml"), "--set", "texture.size=64"]) == 0


def test_maps_of_the_file_itself(tmp_path, capsys):
    """A GLB whose material has a picture of its colour: `maps: file`, which `check` reads; without one, a constant."""
    made, _ = plain(sphere(120.0, "latlong", 12))
    write_png(tmp_path / "skin.png", np.full((4, 4, 3), 128, np.uint8))
    picture = made.image((tmp_path / "skin.png").read_bytes())
    (tmp_path / "skin.png").unlink()
    primitive = made.tree["meshes"][0]["primitives"][0]
    primitive["material"] = made.material(name="Skin", pbrMetallicRoughness={"baseColorTexture": picture})
    made.tree["nodes"][0]["scale"] = [0.001] * 3
    (tmp_path / "me.glb").write_bytes(made.glb())
    assert started(tmp_path, "me.glb").maps.source == "file"
    capsys.readouterr()
    assert run(["check", str(tmp_path / "me.yaml"), "--set", "texture.size=64"]) == 0
    out = capsys.readouterr().out
    assert "note      maps.albedo: of the material Skin: me.glb: image 0, 4 x 4\n" in out
    assert "maps.albedo: none" not in out
    del made.tree["materials"][0]["pbrMetallicRoughness"]
    (tmp_path / "me.glb").write_bytes(made.glb())
    assert started(tmp_path, "me.glb").maps.source is None


def test_hair_cards_of_the_file_itself(tmp_path):
    """What casts and has a material that is not opaque: `opacity: file`."""
    character(tmp_path)
    assert started(tmp_path, "hero.glb").mesh.opacity == {}
    made = Gltf()
    nodes = []
    for name, mesh in (("Face", sphere(120.0, "latlong", 12)), ("Hair", quad(40, 20, 130))):
        positions, uv, normals, faces = vertices_of(mesh)
        attributes = {"POSITION": made.accessor(positions / 1000), "NORMAL": made.accessor(normals)}
        attributes["TEXCOORD_0"] = made.accessor(uv)
        material = made.material(name=name, alphaMode="BLEND" if name == "Hair" else "OPAQUE")
        index = made.mesh(attributes, made.accessor(faces.ravel(), "I"), name=name, material=material)
        nodes.append({"name": name, "mesh": index})
    made.tree["nodes"], made.tree["scenes"] = nodes, [{"nodes": [0, 1]}]
    (tmp_path / "hero.glb").write_bytes(made.glb())
    assert started(tmp_path, "hero.glb").mesh.opacity == {"*": "file"}


def test_without_uvs_or_with_stacked_ones_a_layout_is_made(tmp_path):
    """And no map is taken from beside it."""
    write_png(tmp_path / "albedo.png", np.full((4, 4, 3), 128, np.uint8))
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 240 0 0\nv 0 240 0\nv 240 240 0\nf 1 2 4 3\n")
    spec = started(tmp_path, "bare.obj")
    assert (spec.texture.unwrap, spec.maps.albedo) == ("xatlas", None)
    from tests.shapes import joined

    write_obj(tmp_path / "twice.obj", joined(quad(240, 200), quad(240, 200, 90)))
    assert started(tmp_path, "twice.obj").texture.unwrap == "xatlas"


def test_a_head_that_lies_is_turned(tmp_path):
    """The sample head with z up: mesh.up says so."""
    from skinbake.io.mesh import read_mesh

    head = read_mesh(ROOT / "data" / "head.obj", 1.0)
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    write_obj(tmp_path / "lying.obj", type(head)(head.positions_mm @ turn.T, head.faces, head.corner_uv,
                                                 head.corner_normal @ turn.T))  # fmt: skip
    spec = started(tmp_path, "lying.obj")
    assert spec.mesh.up == "z"
    np.testing.assert_allclose(read_look_mesh(spec).positions_mm.mean(axis=0), head.positions_mm.mean(axis=0), atol=0.1)


def test_a_file_that_is_there_is_kept(tmp_path, capsys):
    """Without --force."""
    write_obj(tmp_path / "head.obj", quad(240.0, 200.0))
    (tmp_path / "me.yaml").write_text("mine")
    assert run(["init", str(tmp_path / "head.obj"), "--out", str(tmp_path / "me.yaml")]) == 2
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "me.yaml").read_text() == "mine"


def test_names_that_yaml_would_mistake(tmp_path):
    """Spaces, brackets, words for true and false: the look still finds each part."""
    write_obj(tmp_path / "a.obj", quad(240.0, 200.0, columns=2, rows=2))
    text = (tmp_path / "a.obj").read_text()
    faces = [line for line in text.splitlines() if line.startswith("f ")]
    rest = "\n".join(line for line in text.splitlines() if not line.startswith("f "))
    parts = "\n".join(
        f"o {name}\n{face}" for name, face in zip(["on", "Head [1]: ä", "it's", "hair"], faces, strict=False)
    )
    (tmp_path / "my head, 2.obj").write_text(f"{rest}\n{parts}\n" + "o skin\n" + "\n".join(faces[4:]), "utf-8")
    spec = started(tmp_path, "my head, 2.obj")
    assert set(spec.mesh.skin) == {"on", "Head [1]: ä", "it's", "skin"}
    assert len(read_look_mesh(spec).casters.faces) == 1


def test_editors_find_the_schema_beside_the_look(tmp_path):
    """The header names a valid file that lies there; an older one is renewed, one of others stays and is not named."""
    write_obj(tmp_path / "head.obj", sphere(100.0, "latlong", 12))
    started(tmp_path, "head.obj")
    assert (tmp_path / "me.yaml").read_text().splitlines()[0] == HEADER
    schema = tmp_path / HEADER.partition("=")[2]
    whole = schema.read_text()
    jsonschema.validate(read_yaml(tmp_path / "me.yaml").value, json.loads(whole))
    schema.write_text(json.dumps({"title": json.loads(whole)["title"]}))
    started(tmp_path, "head.obj")
    assert schema.read_text() == whole
    for other in ('{"title": "mine"}', "mine"):
        schema.write_text(other)
        started(tmp_path, "head.obj")
        assert schema.read_text() == other
        assert HEADER not in (tmp_path / "me.yaml").read_text()
