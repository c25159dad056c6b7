"""A bake ends with its picture, a verdict in words and the next command; what is probably not meant comes last."""

import json
import os

import numpy as np
import pytest

from skinbake.baking.verdict import last_lines, marked, verdict, where_on
from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.scene.decision import NO_DIRECTIONS
from tests.shapes import quad, sphere

ERROR = {"rms": 0.0022, "left_wrong": 0.008, "max": 0.127, "worst": {"where": "at the front left, 62 % of the way up"}}
MANIFEST = {"config": {"diffusion": {"tolerance": 0.01}}, "error": ERROR, "lobes": [{}]}
LOOK = """\
mesh: {path: mesh.obj, unit: mm}
texture: {size: 16}
skin: {model: gaussians, variance_mm2: [4.0], weight_rgb: [[1, 1, 1]]}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: behind, type: directional, direction: [0, 0, 1], irradiance: [1, 1, 1]}
output: {dir: out}
"""


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, "within the 1 % asked for: off by 0.8 % from its own model, the blur by 0.22 %; most at the front left"),
        ({"rms": 0.02}, "beyond the 1 % asked for: off by 0.8 % from its own model, the blur by 2 %"),
        ({"left_wrong": 0.0}, "within the 1 % asked for: the blur off by 0.22 %"),
        ({"worst": None}, "most at one point, by 13 % of the mean; light transport not measured"),
        ({"model": {"rms": 0.0414, "stderr": 0.01}}, "; about 4.1 % from light transport"),
        ({"model": {"rms": 0.0, "stderr": 0.02}}, "; less than 2 % from light transport"),
        ({"texture_size": 0.025}, "; the coarser texture loses about 2.5 %; "),
        ({"rms": None}, "the blur was not measured (diffusion.probes: 0); "),
    ],
)
def test_the_verdict_says_what_was_measured_and_what_was_not(changed, said):
    """Each part of the error in words."""
    assert said in verdict(MANIFEST | {"error": ERROR | changed})


@pytest.mark.parametrize(("error", "told"), [(0.0051, True), (0.0049, False)])
def test_the_verdict_tells_of_a_fit_that_leaves_much(error, told):
    """From half of the tolerance on, as what the look chose is in no sum."""
    plan = [{"term": "fit", "error": error, "how": "4 Gaussians"}]
    said = "; beside that 4 Gaussians are off from the skin's profile by 0.51 %; "
    assert (said in verdict(MANIFEST | {"plan": plan})) == told


def test_the_verdict_tells_of_terms_that_no_sum_holds():
    """Light that was given has no directions; what was switched off is no news."""
    plan = [{"term": "beam", "why": f"auto: {NO_DIRECTIONS}"}, {"term": "curvature", "why": "off"}]
    said = "; beam left out and not counted, as the light was given without directions; "
    assert said in verdict(MANIFEST | {"plan": plan})
    assert "not counted" not in verdict(MANIFEST | {"plan": plan[1:]})


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ([0.9, 0.24, 0.9], "at the front left, 62 % of the way up"),
        ([-0.9, 0.0, 0.0], "at the right, 50 % of the way up"),
        ([0.0, 0.99, -0.9], "at the back, at the top"),
        ([0.1, -1.0, 0.1], "in the middle, at the bottom"),
    ],
)
def test_places_are_told_by_the_head_s_own_sides(place, said):
    """+x is its own left, +z its front, +y up."""
    assert where_on(sphere(1.0, "cube", 8), np.array(place)) == said


def test_the_next_command_can_be_typed(tmp_path, monkeypatch):
    """Relative to the folder one is in, quoted."""
    monkeypatch.chdir(tmp_path)
    lines = last_lines(tmp_path / "my out", MANIFEST, True)
    assert lines[0] == f"picture  {os.path.join('my out', 'preview.png')}"
    assert lines[2].startswith("next     ")
    assert lines[2].endswith("skinbake preview 'my out'")
    assert last_lines(tmp_path.parent, MANIFEST, False)[0] == f"folder   {tmp_path.parent}"


def test_a_bake_ends_so_and_warns_last(tmp_path, monkeypatch, capsys):
    """Also where nothing was stale: a light that no skin gets, texels too coarse; the place stays with the lobes."""
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "mesh.obj", quad(240, 200))
    (tmp_path / "look.yaml").write_text(LOOK)
    found = []
    for _ in range(2):
        assert run(["bake", "look.yaml", "--no-preview"]) == 0
        lines = capsys.readouterr().err.splitlines()
        found.append(lines[-5:])
        manifest = json.loads((tmp_path / "out" / "bake.json").read_text())
        assert marked(manifest["warnings"]) == lines[-2:]
        assert set(manifest["error"]["worst"]) == {"position_mm", "where"}
    assert found[0] == found[1]
    folder, told, following, coarse, dark = found[0]
    assert folder == "folder   out"
    assert told.startswith("verdict  within the 1 % asked for: ")
    assert following.endswith("skinbake preview out")
    assert coarse.startswith("warning  your texels are ")
    assert dark.startswith("warning  light behind: no skin gets any of its light")
