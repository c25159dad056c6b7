import os
from pathlib import Path

import pytest

from skinbake.errors import ConfigError, InputError
from skinbake.io.config import load_look, load_skin
from tests.conftest import ROOT

LOOK = """\
mesh: {path: head.obj, unit: mm}
skin:
  model: gaussians
  variance_mm2: [0.01, 1.0]
  weight_rgb: [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: rim, type: point, position_mm: [0, 0, 100], intensity: [1, 1, 1]}
output: {dir: out}
"""


@pytest.fixture
def look(tmp_path):
    def write(text=LOOK, name="look.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def faults(path, *overrides):
    with pytest.raises(ConfigError) as caught:
        load_look(path, overrides)
    return [fault.replace(f"{path}", "look.yaml") for fault in caught.value.faults]


def test_paths_are_relative_to_the_file_that_names_them(look, tmp_path):
    """A look means the same from whatever folder it is baked."""
    spec = load_look(look())
    assert Path(spec.mesh.path) == tmp_path / "head.obj"
    assert Path(spec.output.dir) == tmp_path / "out"
    assert Path(load_look(look(), ["mesh.path=x.obj"]).mesh.path) == Path.cwd() / "x.obj"
    assert Path(load_look(look(), out="elsewhere").output.dir) == Path.cwd() / "elsewhere"


def test_environment_variables_name_folders(look, monkeypatch):
    """`${NAME:-default}` lets a user set where a scan lies without editing the look."""
    text = LOOK.replace("head.obj", '"${SKINBAKE_TEST_HEADS:-heads}/a.obj"')
    monkeypatch.delenv("SKINBAKE_TEST_HEADS", raising=False)
    assert load_look(look(text)).mesh.path.endswith(os.path.join("heads", "a.obj"))
    monkeypatch.setenv("SKINBAKE_TEST_HEADS", "/scans")
    assert load_look(look(text)).mesh.path == "/scans/a.obj"
    with pytest.raises(ConfigError, match="SKINBAKE_TEST_NOWHERE, which is not set"):
        load_look(look(LOOK.replace("head.obj", '"${SKINBAKE_TEST_NOWHERE}/a.obj"')))


def test_overrides_reach_into_lists_by_index_and_by_name(look):
    """`lights.rim.intensity` and `lights.1.intensity` are the same key."""
    by_name = load_look(look(), ["lights.rim.intensity=[2, 3, 4]", "texture.size=[64, 32]"])
    assert by_name.lights[1].intensity == (2, 3, 4)
    assert by_name.texture.size == (64, 32)
    assert load_look(look(), ["lights.1.intensity=[2, 3, 4]"]).lights == by_name.lights


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("unit: mm", "unti: mm", "look.yaml:1: mesh.unti: unknown key; did you mean unit?"),
        ("unit: mm", "unit: yard", "look.yaml:1: mesh.unit: expected 'mm', 'cm', 'dm', 'm' or 'inch', got 'yard'"),
        ("[0, 0, -1]", "[0, 0, 0]", "look.yaml:7: lights[0].direction: expected a direction that is not zero"),
        (
            "[1, 1, 1]}\n  - {name: rim",
            "[1, -1, 1]}\n  - {name: rim",
            "look.yaml:7: lights[0].irradiance[1]: expected a number >= 0, got -1",
        ),
        ("type: point", "type: sun", "look.yaml:8: lights[1].type: expected one of directional, point"),
        ("name: rim", "name: key", "look.yaml:6: lights: expected light names that differ, got key more than once"),
        ("output: {dir: out}", "", "look.yaml:1: output: missing"),
        ("output:", "shadows: maybe\noutput:", "look.yaml:9: shadows: expected a boolean"),
        (
            "[1, 1, 1]}\n  - {name: rim",
            "[1, .nan, 1]}\n  - {name: rim",
            "look.yaml:7: lights[0].irradiance[1]: expected a finite number",
        ),
        ("unit: mm", "unit: mm, unit: cm", "look.yaml:1: mesh.unit: key stands twice"),
        ("unit: mm}", "unit: mm", "look.yaml:2: expected YAML"),
        ("model: gaussians", "model: gausians", "look.yaml:3: skin.model: expected one of multipole"),
    ],
)
def test_a_fault_names_file_line_key_and_what_was_expected(look, before, after, message):
    """One line says all that a person needs to mend the file."""
    assert before in LOOK
    found = faults(look(LOOK.replace(before, after, 1)))
    assert any(fault.startswith(message) for fault in found), found


def test_all_faults_are_told_at_once(look):
    """A person mends a file once, not fault by fault."""
    text = LOOK.replace("unit: mm", "unti: mm").replace("[0, 0, -1]", "[0, 0, 0]")
    assert len(faults(look(text))) >= 2


def test_overrides_are_named_in_their_faults(look):
    """A fault that came from the command line does not blame the file."""
    assert faults(look(), "texture.size=0")[0].startswith("--set texture.size: texture.size")
    assert faults(look(), "lights.sky.scale=1")[0].startswith("--set lights.sky.scale: lights.sky: no such item")
    assert faults(look(), "nonsense")[0] == "--set nonsense: expected dotted.key=value"


def test_bare_on_and_off_are_switches(look):
    """YAML reads a bare `on` as true; the look means the word."""
    spec = load_look(look(LOOK + "terms: {energy_conservation: on, transmission: off}\n"))
    assert (spec.terms.energy_conservation, spec.terms.transmission) == ("on", "off")


def test_presets_are_looked_up_by_name_and_can_be_changed(look):
    """`preset` gives the medium, the other keys of `skin` go over it."""
    head, tail = LOOK.split("skin:\n")[0], "lights:" + LOOK.split("lights:")[1]
    spec = load_look(look(head + "skin: {preset: jensen-skin1, fit: {gaussians: 3}}\n" + tail))
    assert spec.skin.model == "dipole"
    assert spec.skin.fit.gaussians == 3
    found = faults(look(head + "skin: {preset: jensen-skin9}\n" + tail))
    assert found[0].startswith("look.yaml:2: skin.preset: expected one of")
    assert "jensen-skin1" in found[0]


def test_a_file_with_nothing_but_a_skin_will_do_where_only_skin_is_needed(look):
    """`profile` and `fit` take a whole look or just a skin."""
    text = "model: gaussians\nvariance_mm2: [1.0]\nweight_rgb: [[1, 1, 1]]\n"
    assert load_skin(look(text)) == load_skin(look("skin:\n  " + text.replace("\n", "\n  ").rstrip() + "\n"))
    assert load_skin(look()).variance_mm2 == (0.01, 1.0)


def test_missing_and_empty_files_are_told(look, tmp_path):
    """Neither ends in a traceback."""
    with pytest.raises(InputError, match="expected a configuration file"):
        load_look(tmp_path / "none.yaml")
    assert faults(look("")) == ["look.yaml:1: expected a mapping, got an empty file"]
    assert faults(look("- 1\n")) == ["look.yaml:1: expected a mapping, got sequence"]


def test_every_look_of_the_project_is_valid(monkeypatch):
    """What the README names can be baked."""
    looks = [path for path in sorted((ROOT / "configs").glob("*.yaml")) if "mesh:" in path.read_text()]
    assert looks
    for path in looks:
        if "jobs:" not in path.read_text():
            load_look(path)
