"""The plan as a table."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake import pipeline
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.plan_table import HEAD, plan_rows
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.cli import run
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from tests.shapes import relief

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: 64, gutter: 3}
skin:
  model: gaussians
  variance_mm2: [1.0e-9, 0.5, 40.0]
  weight_rgb: [[0.2, 0.3, 0.3], [0.4, 0.4, 0.4], [0.4, 0.3, 0.3]]
lights:
  - {name: key, type: directional, direction: [-0.5, -0.4, -0.7], irradiance: [2.0, 1.9, 1.7]}
  - {name: sky, type: environment, radiance: [0.2, 0.2, 0.3]}
diffusion: {method: surface, tolerance: 0.05, probes: 50}
output: {dir: out}
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What a bake says, once at the usual length and once as it was."""
    folder = tmp_path_factory.mktemp("table")
    write_obj(folder / "mesh.obj", relief(30.0, 9.0, 5.0, 12))
    (folder / "look.yaml").write_text(LOOK)
    return folder


def test_every_choice_has_its_line(said, capfd):
    """What, how, seconds, error, and their sum last; why only with --verbose; again, it has no seconds."""
    look = [str(said / "look.yaml"), "--no-preview"]
    assert run(["bake", *look]) == 0
    lines = capfd.readouterr().err.splitlines()
    first = next(i for i, line in enumerate(lines) if line.split() == list(HEAD))
    table = {line[2:].split("  ")[0]: line.split() for line in lines[first + 1 :] if line.startswith("  ")}
    terms = {
        "oil",
        "light key",
        "light sky",
        "incidence",
        "beam",
        "curvature",
        "interreflection",
        "diffuse_profile",
        "thin parts",
        "fit",
        "all",
    }
    assert terms <= set(table)
    assert "not blurred, too narrow to show" in " ".join(table["lobe 0, 3.2e-05 mm"])
    assert "surface, full size" in " ".join(table["lobe 1, 0.71 mm"])
    assert not any("left unblurred" in line or "auto: " in line for line in lines)
    assert float(table["light sky"][-2]) >= 0
    assert run(["bake", *look, "--verbose"]) == 0
    again = capfd.readouterr().err
    assert "energy_conservation" in again
    assert "auto: " in again


def test_rows_hold_the_bake_s_own_figures(said):
    """Seconds of a part go to its row; the last row is the root of all squares that the bake says."""
    session, log = BakeSession(keep=False), StageLog()
    inputs = BakeInputs(load_look(said / "look.yaml"), session, log)
    baked = pipeline.bake(look_stages(inputs, MemoryStore(), session, log))
    parts = {"sky, 2 of 2": 3.0, "lobe 1: surface": 4.0, "measuring lobe 1": 0.5, "measuring points": 0.25}
    rows = {row.what.split(",")[0]: row for row in plan_rows(baked, parts)}
    found = [rows[name].seconds for name in ("light sky", "light key", "lobe 1", "lobe 2", "the blur")]
    assert found == [3.0, None, 4.5, None, 0.25]
    own = [rows[name].error or 0.0 for name in ("the blur", "oil", "thin parts", "light sky", "interreflection")]
    assert rows["all"].error == baked.left_wrong <= np.hypot.reduce(own) + 1e-6


def test_parts_of_a_stage_are_timed():
    """From what a stage says that it does until it says something else, or has ended."""
    log = StageLog()
    with log.measured("diffuse"):
        log.note("one")
        log.note("two")
    log.say("done")
    assert list(log.parts) == ["one", "two"]
    assert all(0 <= seconds < 1 for seconds in log.parts.values())
