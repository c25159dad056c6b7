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


def read(path, overrides=(), out=None):
    """A look whose files nobody needs."""
    return load_look(path, overrides, out, files=False)


def test_paths_are_relative_to_the_file_that_names_them(look, tmp_path):
    """A look means the same from whatever folder it is baked."""
    spec = read(look())
    assert Path(spec.mesh.path) == tmp_path / "head.obj"
    assert Path(spec.output.dir) == tmp_path / "out"
    assert Path(read(look(), ["mesh.path=x.obj"]).mesh.path) == Path.cwd() / "x.obj"
    assert Path(read(look(), out="elsewhere").output.dir) == Path.cwd() / "elsewhere"


def test_environment_variables_name_folders(look, monkeypatch):
    """`${NAME:-default}` lets a user set where a scan lies without editing the look."""
    text = LOOK.replace("head.obj", '"${SKINBAKE_TEST_HEADS:-heads}/a.obj"')
    monkeypatch.delenv("SKINBAKE_TEST_HEADS", raising=False)
    assert read(look(text)).mesh.path.endswith(os.path.join("heads", "a.obj"))
    monkeypatch.setenv("SKINBAKE_TEST_HEADS", "/scans")
    assert read(look(text)).mesh.path == "/scans/a.obj"
    with pytest.raises(ConfigError, match="SKINBAKE_TEST_NOWHERE, which is not set"):
        read(look(LOOK.replace("head.obj", '"${SKINBAKE_TEST_NOWHERE}/a.obj"')))


def test_overrides_reach_into_lists_by_index_and_by_name(look):
    """`lights.rim.intensity` and `lights.1.intensity` are the same key."""
    by_name = read(look(), ["lights.rim.intensity=[2, 3, 4]", "texture.size=[64, 32]"])
    assert by_name.lights[1].intensity == (2, 3, 4)
    assert by_name.texture.size == (64, 32)
    assert read(look(), ["lights.1.intensity=[2, 3, 4]"]).lights == by_name.lights


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("unit: mm", "unti: mm", "look.yaml:1: mesh.unti: unknown key; did you mean unit?"),
        ("unit: mm", "unit: yard", "look.yaml:1: mesh.unit: expected 'mm', 'cm', 'dm', 'm', 'inch' or 'file'"),
        ("[0, 0, -1]", "[0, 0, 0]", "look.yaml:7: lights[0].direction: expected a direction that is not zero"),
        ("skin:", "skn: 1\nskin:", "look.yaml:2: skn: unknown key; did you mean skin?"),
        (
            "skin:",
            "foo: 1\nskin:",
            "look.yaml:2: foo: unknown key; expected one of mesh, occluders, maps, texture, skin, ",
        ),
        ("unit: mm", "unit: mm, size: 3", "look.yaml:1: mesh.size: does not belong here; expected one of path, unit, "),
        (
            "direction: [0, 0, -1]",
            "position_mm: [0, 0, -1]",
            "look.yaml:7: lights[0].position_mm: does not belong here; expected one of name, shadows, type, ",
        ),
        ("model: gaussians", "model: dipole", "look.yaml:4: skin.variance_mm2: does not belong here; expected one of "),
        ("unit: mm", "unit: mm, 7: 3", "look.yaml:1: mesh.7: unknown key; expected one of path, "),
        ("mesh: {path: head.obj, unit: mm}", "mesh: 5", "look.yaml:1: mesh: expected a mapping, got 5"),
        ("path: head.obj", "path: 2020-01-01", "look.yaml:1: mesh.path: expected text, got 2020-01-01"),
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


def test_no_export_of_lights_that_all_come_later(look):
    """It is said before the bake, not after it."""
    told = faults(look(), "lights=[]", "relight={}", "output.export=[web]")
    assert len(told) == 1
    assert told[0].endswith("expected no export of a look whose lights all come later, got output.export")


def test_a_misspelt_key_of_a_light_is_not_missed_as_well(look):
    """One line, which says what was meant; a key that nothing resembles is missed."""
    text = LOOK.replace("irradiance", "irradience")
    assert [fault.split(": ", 2)[2] for fault in faults(look(text))] == ["unknown key; did you mean irradiance?"]
    both = [fault.split(": ", 2)[2] for fault in faults(look(text.replace("irradience", "foo")))]
    assert both[0] == "missing; expected a value"
    assert both[1].startswith("unknown key; expected one of ")


@pytest.mark.parametrize("own", ["tolerance: 0.05", "diffusion: {tolerance: 0.05}"])
@pytest.mark.parametrize("name", ["tolerance", "diffusion.tolerance"])
def test_either_name_of_the_tolerance_overrides_the_files_own(look, own, name):
    """As `tradeoff` does, which knows only one of them; of several overrides the last one counts. A file says one."""
    path = look(LOOK + own + "\n")
    assert read(path, [f"{name}=0.01"]).diffusion.tolerance == 0.01
    assert read(path, ["diffusion.tolerance=0.02", "tolerance=0.03", f"{name}=0.01"]).diffusion.tolerance == 0.01
    assert read(path, ["tolerance=null"]).diffusion.tolerance == (0.05 if own.startswith("diffusion") else 0.01)
    both = look(LOOK + "tolerance: 0.05\ndiffusion: {tolerance: 0.01}\n")
    assert "or one of the two" in faults(both)[0]


def test_overrides_are_named_in_their_faults(look):
    """A fault that came from the command line does not blame the file."""
    assert faults(look(), "texture.size=0")[0].startswith("--set texture.size: texture.size")
    assert faults(look(), "lights.sky.scale=1")[0].startswith("--set lights.sky.scale: lights.sky: no such item")
    assert faults(look(), "nonsense")[0] == "--set nonsense: expected dotted.key=value"
    assert faults(look(), "skn.fit.gaussians=3")[0].startswith("--set skn.fit.gaussians: skn: unknown key; did you ")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("texture.size=abc", "texture.size: expected a whole number or [width, height], got 'abc'"),
        ("texture.size=true", "texture.size: expected a whole number or [width, height], got true"),
        ("texture.size=128.5", "texture.size: expected a whole number or [width, height], got 128.5"),
        ("texture.size=[1, 2.5]", "texture.size[1]: expected a whole number, got 2.5"),
        ("texture.size=[1, 2, 3]", "texture.size: expected a list of at most 2, got 3"),
        ("preview.size=5", "preview.size: expected a list, got 5"),
        ("preview.exposure=abc", "preview.exposure: expected a number, got 'abc'"),
        ("preview.exposure=[1]", "preview.exposure: expected a number, got a list"),
        ("lights=[]", "lights: expected at least one light, or relight for those that come later, got none"),
        ("lights.key=5", "lights[0]: expected a mapping, got 5"),
        ("skin=null", "skin: expected a mapping, got nothing"),
        ("specular.strength=on", "specular.strength: expected a number, got true"),
        ("texture.gutter=false", "texture.gutter: expected a number, got false"),
        ("tolerance=on", "tolerance: expected a number, got true"),
        ("maps.albedo_rgb=[0.5, yes, 0.3]", "maps.albedo_rgb[1]: expected a number, got true"),
    ],
)
def test_values_of_another_kind_are_told_in_plain_words(look, override, message):
    """`expected ..., got ...`, and no word of the library that found it."""
    assert faults(look(), override) == [f"--set {override.split('=')[0]}: {message}"]


@pytest.mark.parametrize("name", [".", "texture.", ".size", "texture..size", "[]"])
def test_an_empty_key_is_refused(look, name):
    """It would set nothing, without a word."""
    assert faults(look(), f"{name}=5") == [f"--set {name}: expected a key such as texture.size, got {name!r}"]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("mesh.path=gone.obj", "--set mesh.path: mesh.path: expected a file, there is none at {cwd}/gone.obj"),
        (
            "maps.normal=n.<UDIM>.png",
            "--set maps.normal: maps.normal: expected a file, there is none at {cwd}/n.<UDIM>",
        ),
        ("maps.normal={path: n.png}", "--set maps.normal: maps.normal.path: expected a file, there is none at {cwd}/n"),
        ("maps={}", "look.yaml:1: mesh.path: expected a file, there is none at {beside}/head.obj"),
        (
            "lights.1={name: sky, type: environment, path: sky.exr}",
            "--set lights.1: lights[1].path: expected a file, there is none at {cwd}/sky.exr",
        ),
    ],
)
def test_a_missing_file_is_told_with_its_line_and_key(look, tmp_path, override, message):
    """The reader of the file would know neither."""
    found = faults(look(), override)
    assert any(fault.startswith(message.format(cwd=Path.cwd(), beside=tmp_path)) for fault in found), found
    (tmp_path / "head.obj").touch()
    assert load_look(look()).mesh.path == str(tmp_path / "head.obj")


def test_bare_on_and_off_are_switches(look):
    """YAML reads a bare `on` as true; the look means the word."""
    spec = read(look(LOOK + "terms: {energy_conservation: on, transmission: off}\n"))
    assert (spec.terms.energy_conservation, spec.terms.transmission) == ("on", "off")
    assert (spec.terms.incidence, spec.terms.interreflection, spec.terms.bounces) == ("auto", "auto", "auto")
    spec = read(look(LOOK + "terms: {incidence: on, beam: off, curvature: on, interreflection: off, bounces: 3}\n"))
    assert (spec.terms.beam, spec.terms.curvature) == ("off", "on")
    assert (spec.terms.incidence, spec.terms.interreflection, spec.terms.bounces) == ("on", "off", 3)


@pytest.mark.parametrize(
    ("term", "said"),
    [
        ("incidence: maybe", "'auto', 'on' or 'off', got 'maybe'"),
        ("bounces: 0", "auto or a whole number from 1 to 16, got 0"),
    ],
)
def test_a_term_that_is_no_switch_is_refused(look, term, said):
    """With its line and its key."""
    found = faults(look(LOOK + f"terms: {{{term}}}\n"))
    assert len(found) == 1
    assert f"terms.{term.split(':')[0]}: " in found[0]
    assert said in found[0]


def test_presets_are_looked_up_by_name_and_can_be_changed(look):
    """`preset` gives the medium, the other keys of `skin` go over it."""
    head, tail = LOOK.split("skin:\n")[0], "lights:" + LOOK.split("lights:")[1]
    spec = read(look(head + "skin: {preset: jensen-skin1, fit: {gaussians: 3}}\n" + tail))
    assert spec.skin.model == "dipole"
    assert spec.skin.fit.gaussians == 3
    found = faults(look(head + "skin: {preset: jensen-skin9}\n" + tail))
    assert found[0].startswith("look.yaml:2: skin.preset: expected one of")
    assert "jensen-skin1" in found[0]


def test_gaussians_may_name_their_medium(look):
    """By a preset too, below the keys of their own; another skin's medium does not stay; what is none is refused."""
    head, tail = LOOK.split("skin:\n")[0], "lights:" + LOOK.split("lights:")[1]
    six = "skin: {preset: gpugems3-six-gaussians%s}\n"
    spec = read(look(head + six % "" + tail))
    assert spec.skin.medium.model == "multipole"
    assert len(spec.skin.medium.layers) == 3
    skin1 = ", medium: {preset: jensen-skin1, eta: 1.4}"
    medium = read(look(head + six % skin1 + tail)).skin.medium
    assert (medium.model, medium.eta, medium.sigma_a_per_mm) == ("dipole", 1.4, (0.032, 0.17, 0.48))
    assert read(look(head + six % ", medium: null" + tail)).skin.medium is None
    found = faults(look(head + six % ", medium: {preset: jensen-skin9}" + tail))
    assert found[0].startswith("look.yaml:2: skin.medium.preset: expected one of")
    found = faults(look(head + six % ", medium: {model: gaussians}" + tail))
    assert "skin.medium.model: expected one of multipole, dipole, transport, physiology, got gaussians" in found[0]
    found = faults(look(head + "skin: {preset: jensen-skin1, medium: {preset: jensen-skin1}}\n" + tail))
    assert "skin.medium: does not belong here" in found[0]


def test_a_file_with_nothing_but_a_skin_will_do_where_only_skin_is_needed(look):
    """`profile` and `fit` take a whole look or just a skin."""
    text = "model: gaussians\nvariance_mm2: [1.0]\nweight_rgb: [[1, 1, 1]]\n"
    assert load_skin(look(text)) == load_skin(look("skin:\n  " + text.replace("\n", "\n  ").rstrip() + "\n"))
    assert load_skin(look()).variance_mm2 == (0.01, 1.0)
    for key in ("normalise", "skin.normalise"):
        assert load_skin(look(text), [f"{key}=none"]).normalise == "none"


@pytest.mark.parametrize(
    ("text", "override", "message"),
    [
        (LOOK, "skn.fit.gaussians=3", "--set skn.fit.gaussians: skn: unknown key; did you mean skin?"),
        ("foo: 3\n" + LOOK, "shadows=false", "look.yaml:1: foo: unknown key; expected one of mesh, occluders, maps, "),
        (LOOK.replace("skin:", "skn:"), "shadows=false", "look.yaml:2: skn: unknown key; did you mean skin?"),
        (LOOK.replace("unit:", "unti:"), "shadows=false", "look.yaml:1: mesh.unti: unknown key; did you mean unit?"),
        (
            "d_mm: 1",
            "fit.gausians=3",
            "--set skin.fit.gausians: skin.fit.gausians: unknown key; did you mean gaussians?",
        ),
        ("d_mm: 1", "texture.size=3", "--set skin.texture.size: skin.texture: does not belong here; expected one of "),
        ("d_mm: 1", "skin.=3", "--set skin.: expected a key such as texture.size, got 'skin.'"),
        ("path: none.csv", "normalise=none", "look.yaml:1: skin.path: expected a file, there is none at "),
        ("jobs: [{name: a}]", "normalise=none", "look.yaml:1: expected a look, this is a batch file: use `skinbake b"),
    ],
)
def test_keys_that_no_look_has_are_refused_with_a_skin_too(look, text, override, message):
    """A slip beside `skin` would leave its default in place; what is unfinished elsewhere does not matter."""
    with pytest.raises(ConfigError) as caught:
        load_skin(look(text), [override])
    found = [fault.replace(f"{look(text)}", "look.yaml") for fault in caught.value.faults]
    assert any(fault.startswith(message) for fault in found), found


def test_missing_and_empty_files_are_told(look, tmp_path):
    """Neither ends in a traceback."""
    with pytest.raises(InputError, match="expected a configuration file"):
        read(tmp_path / "none.yaml")
    assert faults(look("")) == ["look.yaml:1: expected a mapping, got an empty file"]
    assert faults(look("- 1\n")) == ["look.yaml:1: expected a mapping, got sequence"]


def test_every_look_of_the_project_is_valid(monkeypatch):
    """What the README names can be baked."""
    looks = [path for path in sorted((ROOT / "configs").glob("*.yaml")) if "mesh:" in path.read_text()]
    assert looks
    for path in looks:
        if "jobs:" not in path.read_text():
            read(path)
