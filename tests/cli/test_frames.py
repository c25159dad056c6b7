"""Sequences: a folder a frame, what does not change computed once, taken up where they were left."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.errors import ConfigError
from skinbake.io.config import frames_of, load_look
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from skinbake.scene.frames import frame_numbers
from tests.cli.test_batch import Here
from tests.conftest import ROOT
from tests.shapes import relief

LOOK = """\
frames: 3-5
mesh: {path: mesh.obj, unit: mm, any_size: true}
maps: {albedo: skin.####.png}
texture: {size: 48, gutter: 4}
skin: {model: gaussians, variance_mm2: [0.05, 1.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
diffusion: {method: surface, tolerance: 1.0, probes: 50}
terms: {energy_conservation: off, transmission: off}
output: {dir: out}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A look of three frames with their maps; jobs run in this process."""
    monkeypatch.delenv("SKINBAKE_CACHE", raising=False)
    monkeypatch.setattr("skinbake.batch.batching.ProcessPool", Here)
    monkeypatch.setattr("skinbake.baking.session._LAST", {})
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    for number in (3, 4, 5):
        write_png(tmp_path / f"skin.{number:04d}.png", np.full((4, 4, 3), 40 * number, np.uint8))
    (tmp_path / "look.yaml").write_text(LOOK)
    return tmp_path


def jobs(folder, verb="bake", *more, code=0):
    """Bake it, and give batch.json's jobs by name."""
    assert run([verb, str(folder / "look.yaml"), "--no-preview", "--quiet", *more]) == code
    return {job["name"]: job for job in json.loads((folder / "out" / "batch.json").read_text())["jobs"]}


@pytest.mark.parametrize(
    ("given", "wanted"),
    [(7, [7]), ("7", [7]), ("1-4", [1, 2, 3, 4]), ("1-9x4", [1, 5, 9]), ("1-2,8", [1, 2, 8]), ([3, "5-6"], [3, 5, 6])],
)
def test_frames_are_numbers_ranges_and_lists(given, wanted):
    """In the order in which they are given."""
    assert list(frame_numbers(given)) == wanted


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("4-1", "got none"),
        ("1-9x0", "expected frames such as"),
        ("a-b", "expected frames such as"),
        (True, "expected frames such as"),
        (1.5, "expected frames such as"),
        ([], "got none"),
        ("1-3,2", "expected each frame once, got 2 twice"),
        ("1-999999", "at most 10,000 frames"),
        ([[1]], "expected frames such as"),
    ],
)
def test_what_is_no_frame_is_refused(folder, given, said):
    """With the line of the key."""
    with pytest.raises(ConfigError, match=rf"look\.yaml:1: frames: .*{said}|--set frames: frames: .*{said}"):
        load_look(folder / "look.yaml", [f"frames={json.dumps(given)}"])


@pytest.mark.parametrize("verb", ["bake", "batch"])
def test_every_frame_has_its_folder_and_light_is_traced_once(folder, verb):
    """Three albedos under one light: three bakes, one irradiance; again, nothing; one map changed, one frame."""
    first = jobs(folder, verb)
    assert {name: job["status"] for name, job in first.items()} == {"0003": "done", "0004": "done", "0005": "done"}
    manifests = [json.loads((folder / "out" / name / "bake.json").read_text()) for name in first]
    assert [m["config"]["maps"]["albedo"]["path"] for m in manifests] == [f"../../skin.000{n}.png" for n in (3, 4, 5)]
    assert all(m["config"]["frames"] is None for m in manifests)
    light = {(folder / "out" / name / "irradiance.exr").read_bytes() for name in first}
    assert len(light) == 1
    assert first["0005"]["cache"]["hits"] >= 1
    assert [job["status"] for job in jobs(folder, verb).values()] == ["fresh"] * 3
    write_png(folder / "skin.0004.png", np.full((4, 4, 3), 9, np.uint8))
    assert [job["status"] for job in jobs(folder, verb).values()] == ["fresh", "done", "fresh"]


def test_a_frame_without_its_file_fails_alone(folder, capsys):
    """The others are baked; `check` names it beforehand, and looks at the first."""
    (folder / "skin.0004.png").unlink()
    assert run(["check", str(folder / "look.yaml")]) == 0
    assert "note      frames: 3, this is what frame 3 would be; files are missing of 4" in capsys.readouterr().out
    found = jobs(folder, code=1)
    assert [job["status"] for job in found.values()] == ["done", "failed", "done"]
    assert "skin.0004.png" in found["0004"]["error"]


def test_one_frame_is_a_look(folder):
    """Chosen by --set, in the folder that the sequence gives it; `--only` does it as well."""
    look = load_look(folder / "look.yaml", ["frames=4"])
    assert look.output.dir == str(folder / "out" / "0004")
    assert look.maps.albedo.path == str(folder / "skin.0004.png")
    assert run(["bake", str(folder / "look.yaml"), "--set", "frames=4", "--no-preview", "--quiet"]) == 0
    assert (folder / "out" / "0004" / "bake.json").exists()
    found = jobs(folder, "batch", "--only", "0004")
    assert [found[name]["status"] for name in ("0003", "0004")] == ["not run", "fresh"]
    with pytest.raises(ConfigError, match=r"look\.yaml:1: frames: expected one frame here, got 3: .* --set frames=3"):
        load_look(folder / "look.yaml")


def test_marks_in_paths(folder):
    """#### and %04d, any number of digits; tiles' marks, and a single #, stay."""
    text = LOOK.replace("mesh.obj", "head%d.obj").replace("skin.####.png", "s#.##.%(UDIM)d.%03d.png")
    (folder / "look.yaml").write_text(text)
    look = load_look(folder / "look.yaml", ["frames=12"], files=False)
    assert look.mesh.path == str(folder / "head12.obj")
    assert look.maps.albedo.path == str(folder / "s#.12.%(UDIM)d.012.png")


def test_a_sequence_that_does_not_move_is_refused(folder, capsys):
    """No mark in any path; frames within a batch."""
    (folder / "look.yaml").write_text(LOOK.replace("skin.####.png", "skin.0003.png"))
    assert run(["bake", str(folder / "look.yaml"), "--quiet"]) == 2
    assert "look.yaml:1: frames: expected #### or %04d in a path, or as mesh.time, got none" in capsys.readouterr().err
    (folder / "many.yaml").write_text("defaults: {base: look.yaml, output: {dir: out}}\njobs: [{name: a}]\n")
    assert run(["batch", str(folder / "many.yaml"), "--quiet"]) == 2
    assert "frames: expected in a look of its own" in capsys.readouterr().err
    assert frames_of(folder / "look.yaml", ["frames=1-2"]) == (1, 2)


@pytest.mark.slow  # starts a cluster of two processes, each of which imports everything
def test_a_sequence_on_a_cluster_of_its_own(folder):
    """`batch --dask local` leaves what baking one frame after another does, and takes up what is there."""
    pytest.importorskip("distributed", reason="the extra `farm` is not installed")
    command = [sys.executable, "-m", "skinbake", "batch", "look.yaml", "--dask", "local", "-j", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "1"}

    def farmed(*more):
        subprocess.run(
            [*command, "--no-preview", "--quiet", *more], cwd=folder, env=environment, check=True, timeout=180
        )
        report = json.loads((folder / "out" / "batch.json").read_text())
        return [(job["name"], job["status"]) for job in report["jobs"]]

    assert farmed() == [("0003", "done"), ("0004", "done"), ("0005", "done")]
    found = [(folder / "out" / name / "lobe_1.exr").read_bytes() for name in ("0003", "0004", "0005")]
    jobs(folder, "bake", "--out", str(folder / "out"), "--force")
    assert [(folder / "out" / name / "lobe_1.exr").read_bytes() for name in ("0003", "0004", "0005")] == found
    write_png(folder / "skin.0005.png", np.full((4, 4, 3), 9, np.uint8))
    assert farmed() == [("0003", "fresh"), ("0004", "fresh"), ("0005", "done")]
