"""A character baked from its parts: hair of the same file and a hat of another shade the skin."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.exr import read_parts
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.gltf_files import Gltf, vertices_of
from tests.shapes import quad

LOOK = """\
mesh: {{path: hero.glb, unit: file, any_size: true, skin: Face}}
{occluders}
texture: {{size: 64, gutter: 2}}
skin: {{model: gaussians, variance_mm2: [1.0], weight_rgb: [[1, 1, 1]]}}
lights: [{{name: key, type: directional, direction: [0, 0, -1], irradiance: [2, 2, 2]}}]
terms: {{energy_conservation: off, transmission: off}}
output: {{dir: out}}
"""


@pytest.fixture
def character(tmp_path):
    """A face of 200 mm in a GLB in metres; a fringe over its upper quarter that uses the same UVs; an eye without."""
    made, nodes = Gltf(), []
    for name, mesh, lift in (("Face", quad(0.2, 0.2), [0, 0, 0]), ("Fringe", quad(0.2, 0.05), [0, 0.075, 0.03])):
        positions, uv, normals, faces = vertices_of(mesh)
        attributes = {"POSITION": made.accessor(positions), "NORMAL": made.accessor(normals)}
        attributes["TEXCOORD_0"] = made.accessor(uv)
        nodes.append(
            {"name": name, "translation": lift, "mesh": made.mesh(attributes, made.accessor(faces.ravel(), "I"))}
        )
    made.tree["nodes"], made.tree["scenes"] = nodes, [{"nodes": [0, 1]}]
    (tmp_path / "hero.glb").write_bytes(made.glb())
    write_obj(tmp_path / "hat.obj", quad(50.0, 50.0, 60.0))
    stripes = np.zeros((8, 8, 4), np.uint8)
    stripes[:, :4, 3] = 255
    write_png(tmp_path / "alpha.png", stripes[..., 3:].repeat(3, axis=2))
    return tmp_path


def baked(folder, occluders=""):
    (folder / "look.yaml").write_text(LOOK.format(occluders=occluders))
    assert run(["irradiance", str(folder / "look.yaml"), "--quiet"]) == 0
    parts = read_parts(folder / "out" / "irradiance.exr")
    return np.asarray(parts["irradiance"].channels["R"], np.float32)


def test_hair_and_hat_shade_the_face(character, capsys):
    """Dark under the fringe, under the whole hat, and under half of it where its picture lets light through."""
    light = baked(character)
    v, u = np.meshgrid((63.5 - np.arange(64)) / 64, (np.arange(64) + 0.5) / 64, indexing="ij")
    fringe = v > 0.75
    edge = np.abs(v - 0.75) < 0.02
    np.testing.assert_array_equal(light[fringe & ~edge], 0)
    np.testing.assert_array_equal(light[~fringe & ~edge], 2)
    hat = (np.abs(u - 0.5) < 0.125) & (np.abs(v - 0.5) < 0.125)
    rim = (np.abs(np.maximum(np.abs(u - 0.5), np.abs(v - 0.5)) - 0.125) < 0.02) | (np.abs(u - 0.5) < 0.02) | edge
    light = baked(character, "occluders: [{path: hat.obj, unit: mm}]")
    np.testing.assert_array_equal(light[~rim], np.where(hat | fringe, 0, 2)[~rim])
    light = baked(character, "occluders: [{path: hat.obj, unit: mm, opacity: alpha.png}]")
    np.testing.assert_array_equal(light[~rim], np.where((hat & (u < 0.5)) | fringe, 0, 2)[~rim])


def test_check_lists_parts(character, capsys):
    """Each with its role, triangles, size and UV box; the overlap that choosing all would make names both."""
    (character / "look.yaml").write_text(LOOK.format(occluders="occluders: [{path: hat.obj, unit: mm}]"))
    assert run(["check", str(character / "look.yaml"), "--json"]) == 0
    parts = json.loads(capsys.readouterr().out)["parts"]
    assert [(p["name"], p["role"], p["triangles"]) for p in parts] == [
        ("Face/head", "skin", 2), ("Fringe/head", "cast", 2), ("unnamed part", "cast", 2),
    ]  # fmt: skip
    assert parts[1]["extent_mm"] == [200, 50, 0]
    assert parts[1]["uv_box"] == [0, 0, 1, 1]
    assert run(["check", str(character / "look.yaml"), "--set", "mesh.skin=head"]) == 2
    said = capsys.readouterr()
    assert "Fringe/head on Face/head" in said.err or "Face/head on Fringe/head" in said.err
    assert "mesh.skin: ['Face/head']" in said.err
    assert "part      skin   Fringe/head: 2 triangles, 200 x 50 x 0 mm, UVs 0.00 0.00 to 1.00 1.00" in said.out
