from pathlib import Path

import pytest

from skinbake.errors import ConfigError, InputError
from skinbake.io.batch_file import load_batch
from skinbake.io.config import load_look
from tests.conftest import ROOT

LOOK = """\
mesh: {path: head.obj, unit: mm}
maps: {albedo: skin.png}
skin: {preset: jensen-skin1, fit: {gaussians: 3}}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: rim, type: point, position_mm: [0, 0, 100], intensity: [1, 1, 1]}
output: {dir: out/single}
"""
BATCH = """\
defaults:
  base: looks/look.yaml
  texture: {size: 64}
  output: {dir: out}
matrix:
  head:
    small: {mesh: {path: small.obj, unit: cm}}
    scan: {mesh: {path: scan.obj, mm_per_unit: 50}}
  size:
    32: {texture: {size: 32}}
    64:
  rig:
    one:
      lights:
        - {name: sun, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
    two: {lights.rim.intensity: [7, 8, 9]}
"""


@pytest.fixture
def batch(tmp_path):
    (tmp_path / "looks").mkdir()
    (tmp_path / "looks" / "look.yaml").write_text(LOOK)

    def write(text=BATCH):
        path = tmp_path / "looks.yaml"
        path.write_text(text)
        return path

    return write


def faults(path, *overrides):
    with pytest.raises(ConfigError) as caught:
        load_batch(path, overrides)
    return [fault.replace(f"{path.parent}/", "") for fault in caught.value.faults]


def test_the_matrix_is_every_combination_in_order(batch, tmp_path):
    """Two heads, two sizes, two rigs: eight looks, the last axis fastest, each in its own folder."""
    found = load_batch(batch())
    assert [job.name for job in found.jobs] == [
        f"{head}-{size}-{rig}" for head in ("small", "scan") for size in ("32", "64") for rig in ("one", "two")
    ]
    assert found.jobs[1].choices == {"head": "small", "size": "32", "rig": "two"}
    for job in found.jobs:
        assert Path(job.spec.output.dir) == tmp_path / "out" / job.name
        assert job.spec.texture.size == ((32, 32) if job.choices["size"] == "32" else (64, 64))
        assert [light.name for light in job.spec.lights] == (["sun"] if job.choices["rig"] == "one" else ["key", "rim"])


def test_names_of_options_are_as_written(batch):
    """YAML would make True of `on`, and 8 of 010."""
    found = load_batch(
        batch("defaults: {base: looks/look.yaml, output: {dir: out}}\nmatrix: {m: {on: , off: , 010: , 64: }}\n")
    )
    assert [job.name for job in found.jobs] == ["on", "off", "010", "64"]


def test_one_override_does_not_leak_into_another_job(batch):
    """Jobs share defaults, never each other's changes."""
    found = {job.name: job.spec for job in load_batch(batch()).jobs}
    assert found["small-64-two"].lights[1].intensity == (7, 8, 9)
    text = BATCH.replace("{lights.rim.intensity: [7, 8, 9]}", "")
    assert {job.name: job.spec for job in load_batch(batch(text)).jobs}["small-64-two"].lights[1].intensity == (1, 1, 1)
    assert (found["small-32-one"].mesh.unit, found["small-32-one"].mesh.mm_per_unit) == ("cm", None)
    assert (found["scan-32-one"].mesh.unit, found["scan-32-one"].mesh.mm_per_unit) == (None, 50)


def test_a_job_without_overrides_is_its_base(batch, tmp_path):
    """Paths of the base are relative to the base, those of the batch to the batch."""
    path = batch(
        "defaults: {base: looks/look.yaml, output: {dir: out}}\njobs:\n  - {name: a}\n  - {name: b, mesh.path: x.obj}\n"
    )
    first, second = (job.spec for job in load_batch(path).jobs)
    alone = load_look(tmp_path / "looks" / "look.yaml", out=tmp_path / "out" / "a", files=False)
    assert first == alone
    assert Path(second.mesh.path) == tmp_path / "x.obj"
    assert Path(first.mesh.path) == tmp_path / "looks" / "head.obj"


def test_jobs_may_bring_their_own_base(batch, tmp_path):
    """A base of a job stands in the place of the defaults' base, under the other defaults."""
    other = LOOK.replace("head.obj", "other.obj").replace("out/single", "elsewhere")
    (tmp_path / "other.yaml").write_text(other)
    path = batch(
        "defaults: {base: looks/look.yaml, texture: {size: 16}, output: {dir: out}}\n"
        "jobs:\n  - {name: a, base: other.yaml}\nmatrix: {m: {b: , c: {base: other.yaml}}}\n"
    )
    a, b, c = (job.spec for job in load_batch(path).jobs)
    assert Path(a.mesh.path) == Path(c.mesh.path) == tmp_path / "other.obj"
    assert Path(b.mesh.path) == tmp_path / "looks" / "head.obj"
    assert a.texture.size == c.texture.size == (16, 16)


def test_a_base_is_a_path_as_any_other(batch, tmp_path, monkeypatch):
    """With `~` and variables of the environment."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SKINBAKE_TEST_LOOKS", "looks")
    wanted = load_batch(batch()).jobs[0].spec
    for base in ("~/looks/look.yaml", '"${SKINBAKE_TEST_LOOKS}/look.yaml"', "looks/../looks/look.yaml"):
        assert load_batch(batch(BATCH.replace("looks/look.yaml", base))).jobs[0].spec == wanted
    (fault,) = faults(batch(BATCH.replace("looks/look.yaml", '"${SKINBAKE_TEST_NOWHERE}/look.yaml"')))
    assert fault.startswith("looks.yaml:2: base: expected the environment variable SKINBAKE_TEST_NOWHERE, which is not")


def test_another_medium_replaces_the_one_below(batch):
    """Keys of a dipole do not survive under a burley; `fit` does, since it is no part of the medium."""
    text = (
        "defaults: {base: looks/look.yaml, output: {dir: out}}\njobs:\n"
        "  - {name: a, skin: {model: burley, d_mm: 1.0}}\n  - {name: b, skin: {preset: jensen-skin2}}\n"
        "  - {name: c, skin: {eta: 1.4}}\n  - {name: d, skin: {fit: {tolerance: 0.1}}}\n"
    )
    a, b, c, d = (job.spec.skin for job in load_batch(batch(text)).jobs)
    assert (a.model, a.fit.gaussians) == ("burley", 3)
    assert (b.model, b.fit.gaussians, b.sigma_a_per_mm[0]) == ("dipole", 3, 0.013)
    assert (c.eta, c.sigma_a_per_mm[0]) == (1.4, 0.032)
    assert (d.fit.gaussians, d.fit.tolerance) == (None, 0.1)


def test_out_and_set_go_over_every_look(batch, tmp_path):
    """The command line has the last word."""
    found = load_batch(batch(), ["texture.size=8"], out=tmp_path / "far")
    assert found.folder == tmp_path / "far"
    assert {job.spec.texture.size for job in found.jobs} == {(8, 8)}
    no_folder = batch("defaults: {base: looks/look.yaml}\njobs: [{name: a}]\n")
    assert load_batch(no_folder, out=tmp_path / "far").jobs[0].spec.output.dir == str(tmp_path / "far" / "a")
    assert "output: expected" in faults(no_folder)[0] or "output.dir: missing" in faults(no_folder)[0]


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("size: 64}", "sise: 64}", "looks.yaml:3: texture.sise: unknown key; did you mean size? (jobs small-32-one, "),
        (
            "unit: cm",
            "unit: yard",
            "looks.yaml:7: mesh.unit: expected 'mm', 'cm', 'dm', 'm', 'inch' or 'file', got 'yard'",
        ),
        ("{texture: {size: 32}}", "{texture: {size: 0}}", "looks.yaml:10: texture.size: expected a number >= 1"),
        ("[0, 0, -1]", "[0, 0, 0]", "looks.yaml:15: lights[0].direction: expected a direction that is not zero"),
        ("lights.rim", "lights.rum", "looks.yaml:16: lights.rum: no such item"),
        ("matrix:", "matrx:", "looks.yaml:5: matrx: unknown key; did you mean matrix?"),
        ("looks/look.yaml", "looks/lock.yaml", "looks.yaml:2: base: expected a look file, found none at"),
        ("  rig:\n", "  rig name:\n", "looks.yaml:12: matrix.rig name: expected letters, digits, _ and - only"),
        ("    64:\n", "    64: 3\n", "looks.yaml:11: matrix.size.64: expected a mapping, got 3"),
        ("    64:\n", "    64: {output: {dir: x}}\n", "looks.yaml:11: output.dir: expected in defaults only"),
    ],
)
def test_a_fault_names_file_line_key_and_jobs(batch, before, after, message):
    """A fault is told once, however many looks it spoils."""
    assert before in BATCH
    found = faults(batch(BATCH.replace(before, after, 1)))
    assert len([fault for fault in found if fault.startswith(message)]) == 1, found


def test_a_fault_in_the_base_names_the_base(batch, tmp_path):
    """The line that has to be mended stands in the other file."""
    (tmp_path / "looks" / "look.yaml").write_text(LOOK.replace("unit: mm", "unti: mm"))
    found = faults(batch("defaults: {base: looks/look.yaml, output: {dir: out}}\njobs: [{name: a}, {name: b}]\n"))
    assert "looks/look.yaml:1: mesh.unti: unknown key; did you mean unit? (jobs a, b)" in found


@pytest.mark.parametrize("defaults", ["{base: looks/look.yaml}", "{base: looks/look.yaml, output: {lights: total}}"])
def test_a_batch_without_a_folder_blames_the_batch(batch, defaults):
    """The base's own folder does not count, so its line is not where to mend it."""
    (fault,) = faults(batch(f"# two looks\ndefaults: {defaults}\njobs: [{{name: a}}, {{name: b}}]\n"))
    expected = "looks.yaml:2: defaults.output.dir: missing; expected the folder of all jobs, or --out (jobs a, b)"
    assert fault.endswith(expected)


def test_names_must_differ_and_there_must_be_some(batch):
    """Two jobs in one folder would overwrite each other."""
    head = "defaults: {base: looks/look.yaml, output: {dir: out}}\n"
    assert "job names that differ, got a more than once" in faults(batch(head + "jobs: [{name: a}, {name: a}]\n"))[0]
    assert "got a-b more than once" in faults(batch(head + "jobs: [{name: a-b}]\nmatrix: {x: {a: }, y: {b: }}\n"))[0]
    assert "expected jobs, a matrix, or both" in faults(batch(head))[0]
    assert "jobs[0].name: missing" in faults(batch(head + "jobs: [{texture: {size: 8}}]\n"))[0]
    with pytest.raises(InputError, match="expected a configuration file"):
        load_batch("none.yaml")
    assert "expected defaults, jobs, a matrix or frames, this is a look: use `skinbake bake`" in faults(batch(LOOK))[0]


def test_the_project_s_batch_is_valid():
    """What the README names can be baked from a fresh clone: it needs the sample head alone."""
    found = load_batch(ROOT / "configs" / "looks.yaml")
    assert len(found.jobs) == 6
    assert {Path(job.spec.mesh.path) for job in found.jobs} == {ROOT / "data" / "head.obj"}


def test_a_matrix_of_millions_is_refused_by_its_number(batch):
    """Before its names are made."""
    options = "{" + ", ".join(f"o{i}: {{}}" for i in range(10)) + "}"
    text = "defaults: {base: looks/look.yaml}\nmatrix:\n" + "".join(f"  a{i}: {options}\n" for i in range(7))
    assert faults(batch(text)) == ["looks.yaml:1: expected at most 10,000 looks, got 10,000,000"]
