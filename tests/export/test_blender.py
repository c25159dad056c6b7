"""`skinbake export --blender`: what the script is told and reads adds up to the light of the bake.

Whether Blender draws it is tried by `tests/export/blender_check.py`.
"""

from __future__ import annotations

import ast
import json

import numpy as np
import pytest

import skinbake
from skinbake.bilinear import magnify_bilinear
from skinbake.cli import run
from skinbake.io.exr import read_parts
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import read_mesh
from skinbake.irradiance.oil_albedo import integrate_specular_albedo
from tests.shapes import sphere

OTHERWISE = ("texturing.mode=post-scatter", "output.lights=total", "terms.energy_conservation=on")


@pytest.fixture(scope="module", params=["separate", "total"])
def exported(bake, request, tmp_path_factory):
    """A bake, and the folder of its export; the second one has its albedo after the blur, lights summed, and oil."""
    folder = tmp_path_factory.mktemp("blender")
    changed = OTHERWISE if request.param == "total" else ["terms.energy_conservation=off"]
    look, changes = str(bake.parent / "me.yaml"), [word for change in changed for word in ("--set", change)]
    assert run(["bake", look, *changes, "--out", str(folder / "bake"), "--no-preview", "--quiet"]) == 0
    bake = folder / "bake"
    assert run(["export", str(bake), "--to", str(folder / "x"), "--blender", "--quiet"]) == 0
    return bake, folder / "x"


def told(folder):
    return json.loads((folder / "skin_blender.json").read_text())


def rgb(path):
    (part,) = read_parts(path).values()
    return part.rgb


def test_lobes_times_weights_are_the_light_that_leaves(exported):
    """Files and weights of the script's data, added up as its nodes do, are M to half precision."""
    bake, folder = exported
    baked, about = skinbake.open_bake(bake), told(folder)
    m = baked.radiant_exitance()
    total = np.zeros_like(m)
    for lobe in about["lobes"]:
        assert len(lobe["images"]) == len(about["lights"])
        light = sum(magnify_bilinear(rgb(folder / image), m.shape[:2]) for image in lobe["images"])
        total += np.float32(lobe["weight_rgb"]) * light
    if about["albedo_after"]:
        total *= magnify_bilinear(rgb(folder / about["albedo_after"]), m.shape[:2])
    np.testing.assert_allclose(total, m, rtol=2e-3, atol=1e-4 * m.max())
    assert about["lights"] == (list(baked.lights) if baked.look.output.separate_lights else ["all lights"])


def test_the_mesh_is_the_head_in_mm(exported):
    """With the UVs as they are."""
    mesh, ball = read_mesh(exported[1] / "skin.obj", 1.0, any_size=True), sphere(30.0, "latlong", 24)
    np.testing.assert_allclose(mesh.corner_position_mm, ball.corner_position_mm, atol=1e-5)
    np.testing.assert_allclose(mesh.corner_uv, ball.corner_uv, atol=1e-6)


def test_the_oil_keeps_back_what_it_reflects(exported):
    """The table as Blender addresses it, sqrt(m) to the right and sqrt(N.V) upwards, is the integral; maps go along."""
    bake, folder = exported
    oil = told(folder)["oil"]
    if not read_manifest(bake)["terms"]["energy_conservation"]:
        assert oil is None
        assert not (folder / "oil_albedo.exr").exists()
        return
    table = rgb(folder / oil["table"])
    assert oil["table_size"] == [table.shape[1], table.shape[0]]
    for cosine, m in ((1.0, 0.25), (0.3, 0.5)):
        row, column = (1 - np.sqrt(cosine)) * (table.shape[0] - 1), np.sqrt(m) * (table.shape[1] - 1)
        found = table[round(row), round(column), :2]
        np.testing.assert_allclose(found, integrate_specular_albedo(cosine, m), rtol=0.02, atol=1e-6)
    np.testing.assert_allclose(rgb(folder / oil["roughness"]), 64 / 255, rtol=1e-3)
    normal = 2 * rgb(folder / oil["normal"])[0, 0] - 1
    bent = np.array([140, 120, 250]) / 127.5 - 1
    np.testing.assert_allclose(normal, bent / np.linalg.norm(bent), atol=2e-3)
    assert (oil["normal_space"], oil["specular"]) == ("tangent", None)


def test_the_script_needs_blender_alone(exported):
    """And it names nothing of the machine that wrote it."""
    folder = exported[1]
    tree = ast.parse((folder / "skin_blender.py").read_text())
    imported = {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {
        "__future__",
        "argparse",
        "bpy",
        "collections.abc",
        "json",
        "mathutils",
        "pathlib",
        "sys",
        "typing",
    }
    assert str(folder) not in (folder / "skin_blender.json").read_text()
