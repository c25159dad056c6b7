"""A loose tolerance bakes at a coarser size, says so, and is found again as it was."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skinbake
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.cli import run
from skinbake.io.config import load_look
from skinbake.io.exr import read_attributes
from skinbake.io.mesh import write_obj
from tests.shapes import sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: [1024, 2048]}
skin: {model: gaussians, variance_mm2: [0.5, 30.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
lights: [{name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}]
diffusion: {method: texture, tolerance: 0.3, probes: 50}
terms: {transmission: off, interreflection: off}
output: {dir: out}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A look beside its mesh, baked."""
    folder = tmp_path_factory.mktemp("size")
    write_obj(folder / "mesh.obj", sphere(60.0, "latlong", 24))
    (folder / "me.yaml").write_text(LOOK)
    assert run(["bake", str(folder / "me.yaml"), "--no-preview", "--quiet"]) == 0
    return folder


def test_a_loose_tolerance_bakes_at_a_coarser_size(folder):
    """Half of it here, since a quarter would be under 512; plan, manifest and files agree."""
    manifest = json.loads((folder / "out" / "bake.json").read_text())
    assert read_attributes(folder / "out" / "irradiance.exr")["irradiance"]["size"] == [512, 1024]
    assert manifest["config"]["texture"]["size"] == [512, 1024]
    (line,) = [line for line in manifest["plan"] if line["term"] == "texture_size"]
    assert not line["kept"]
    assert line["why"].startswith("auto: 512 x 1024 of 1024 x 2048: 768 x 1536 loses ")
    assert ", 512 x 1024 loses " in line["why"]
    error = manifest["error"]
    assert 0 < error["texture_size"] == line["error"] < 0.3
    assert np.hypot(error["rms"], error["texture_size"]) <= error["left_wrong"] + 1e-6 <= 0.3
    assert manifest["config"]["diffusion"]["tolerance"] == 0.3
    assert skinbake.open_bake(folder / "out").radiant_exitance().shape == (1024, 512, 3)


def test_it_is_told_and_found_again(folder, capfd):
    """The second bake decides the same, and does nothing; with `reduce: off` the size is kept."""
    assert run(["bake", str(folder / "me.yaml"), "--no-preview"]) == 0
    said = capfd.readouterr().err
    assert said.count("as it was") == 3
    assert "  texture size     512 x 1024 of 1024 x 2048" in said
    asked = ["--set", "texture.reduce=off", "--set", "diffusion.probes=0", "--out", str(folder / "off")]
    assert run(["bake", str(folder / "me.yaml"), "--no-preview", *asked]) == 0
    assert "  texture size" not in capfd.readouterr().err
    assert read_attributes(folder / "off" / "irradiance.exr")["irradiance"]["size"] == [1024, 2048]


def test_the_stages_alone_agree_on_the_size(folder, tmp_path):
    """`irradiance`, then `diffuse` of what it wrote; light of the size that the look asks for keeps that size."""
    quick = ["--set", "diffusion.probes=0", "--quiet"]
    assert run(["irradiance", str(folder / "me.yaml"), "--out", str(tmp_path / "a"), "--quiet"]) == 0
    ours = str(tmp_path / "a" / "irradiance.exr")
    assert run(["diffuse", str(folder / "me.yaml"), ours, "--out", str(tmp_path / "b"), *quick]) == 0
    assert json.loads((tmp_path / "b" / "bake.json").read_text())["config"]["texture"]["size"] == [512, 1024]
    whole = ["--set", "texture.reduce=off", "--out", str(tmp_path / "off"), "--quiet"]
    assert run(["irradiance", str(folder / "me.yaml"), *whole]) == 0
    theirs = str(tmp_path / "off" / "irradiance.exr")
    assert run(["diffuse", str(folder / "me.yaml"), theirs, "--out", str(tmp_path / "c"), *quick]) == 0
    assert json.loads((tmp_path / "c" / "bake.json").read_text())["config"]["texture"]["size"] == [1024, 2048]


def test_colours_of_vertices_are_made_at_the_size_that_is_worked_at(folder):
    """What was drawn at the other size, to choose, is let go."""
    lines = (folder / "mesh.obj").read_text().splitlines()
    coloured = [f"{line} 0.8 0.6 0.5" if line.startswith("v ") else line for line in lines]
    (folder / "coloured.obj").write_text("\n".join(coloured) + "\n")
    more = [f"mesh.path={folder}/coloured.obj", "maps.vertex_colors=true"]
    inputs = BakeInputs(load_look(folder / "me.yaml", more), BakeSession(), StageLog())
    assert inputs.spec.texture.size == (512, 1024)
    assert inputs.scene().maps.albedo[1001].shape == (1024, 512, 3)


def test_a_bake_in_memory_has_the_size_of_the_one_on_the_disk(folder):
    """Also where the tolerance chose it."""
    ours = skinbake.bake(skinbake.load_look(folder / "me.yaml"))
    theirs = skinbake.open_bake(folder / "out")
    np.testing.assert_array_equal(ours.radiant_exitance(), theirs.radiant_exitance())
    assert ours.plan == theirs.plan
