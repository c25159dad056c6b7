"""Keys hold what a stage depends on: what changes in a hat changes light and transmission, not the raster."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.io.config import load_look
from skinbake.io.fingerprint import input_files
from skinbake.io.manifest import portable_config, spec_of
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.shapes import quad

LOOK = """\
mesh: {path: head.obj, unit: mm}
occluders: [{path: hat.obj, unit: mm, opacity: alpha.png}]
skin: {preset: gpugems3-six-gaussians}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""


@pytest.fixture
def keys(tmp_path):
    """A function of overrides: keys of a light, of the lobes and of the raster, as the files are now."""
    write_obj(tmp_path / "head.obj", quad(240, 200))
    write_obj(tmp_path / "hat.obj", quad(100, 100, 50))
    write_png(tmp_path / "alpha.png", quad_alpha(255))
    (tmp_path / "look.yaml").write_text(LOOK)

    def of(*overrides):
        spec = load_look(tmp_path / "look.yaml", overrides)
        session, log = BakeSession(), StageLog()
        stages = look_stages(BakeInputs(spec, session, log), MemoryStore(), session, log)
        return stages.irradiance.light_keys["key"], stages.diffuse.key(), stages.raster.key()

    return of


def quad_alpha(value):
    return np.full((4, 4, 3), value, np.uint8)


def test_a_changed_occluder_stales_light_and_transmission(tmp_path, keys):
    """Another mesh, picture, unit or turn; the raster is the head's alone."""
    before = keys()
    changes = [
        lambda: (write_obj(tmp_path / "hat.obj", quad(120, 100, 50)), ()),
        lambda: (write_png(tmp_path / "alpha.png", quad_alpha(9)), ()),
        lambda: (None, ("occluders.0.unit=cm",)),
        lambda: (None, ("occluders.0.front=x",)),
    ]
    seen = {before[0]}
    for change in changes:
        _, overrides = change()
        light, diffuse, raster = keys(*overrides)
        assert light not in seen
        assert diffuse != before[1]
        assert raster == before[2]
        seen.add(light)


def test_a_changed_opacity_of_what_the_mesh_casts_stales_light(tmp_path, keys):
    """Another picture, another part's, the file's own, or none; the raster stays."""
    before = keys()
    picture, other = (f"mesh.opacity={{{name}: {tmp_path}/alpha.png}}" for name in ("Hair", "Hat"))
    seen = {before[0]}
    for overrides in ((picture,), (other,), ("mesh.opacity=file",)):
        light, diffuse, raster = keys(*overrides)
        assert light not in seen
        assert diffuse != before[1]
        assert raster == before[2]
        seen.add(light)
    write_png(tmp_path / "alpha.png", quad_alpha(9))
    assert keys(picture)[0] not in seen


def test_occluders_are_inputs_and_move_with_the_folder(tmp_path, keys):
    """Their files are hashed by role, and the manifest's paths are relative to the bake."""
    keys()
    spec = load_look(tmp_path / "look.yaml")
    files = input_files(spec)
    assert files["occluder.0"] == (tmp_path / "hat.obj",)
    assert files["occluder.0.opacity"] == (tmp_path / "alpha.png",)
    config = portable_config(spec, tmp_path / "out")
    assert (config["occluders"][0]["path"], config["occluders"][0]["opacity"]) == ("../hat.obj", "../alpha.png")
    assert spec_of({"config": config}, tmp_path / "out") == spec
