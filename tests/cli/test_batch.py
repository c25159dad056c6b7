"""Batches through the command line: what is shared, what is left, what fails."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys

import pytest

from skinbake.cli import run
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from tests.conftest import ROOT
from tests.shapes import relief

BATCH = """\
defaults:
  mesh: {path: mesh.obj, unit: mm, any_size: true}
  texture: {size: 48, gutter: 4}
  lights:
    - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
    - {name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}
  diffusion: {method: surface, tolerance: 1.0, probes: 50}
  terms: {energy_conservation: off, transmission: off, interreflection: off}
  output: {dir: out}
matrix:
  skin:
    thin: {skin: {model: gaussians, variance_mm2: [0.05, 1.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}}
    thick: {skin: {model: gaussians, variance_mm2: [0.05, 4.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}}
  rig:
    day:
    dusk: {lights.lamp.intensity: [90, 80, 70]}
"""
NAMES = ["thin-day", "thin-dusk", "thick-day", "thick-dusk"]


class Here:
    """Stands in for the crew: the same jobs one after another in this process, which has everything imported."""

    peak_mib = 0.0

    def __init__(self, work, workers, retries, listen):
        self.work, self.listen = work, listen

    def run(self, payloads, keep_going):
        results = {}
        for name, payload in payloads.items():
            if not keep_going and "failed" in [result["status"] for result in results.values()]:
                results[name] = {"status": "skipped", "error": "an earlier job failed"}
                continue
            results[name] = self.work(payload, lambda event: None)
            self.listen(name, {"event": "end", **results[name]})
        return results


@pytest.fixture
def here(monkeypatch):
    monkeypatch.setattr("skinbake.batch.batching.ProcessPool", Here)
    monkeypatch.setattr("skinbake.baking.session._LAST", {})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.delenv("SKINBAKE_CACHE", raising=False)
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    (tmp_path / "looks.yaml").write_text(BATCH)
    return tmp_path


def batch(folder, *more, code=0, preview=False):
    """Run it, and give batch.json's jobs by name."""
    picture = [] if preview else ["--no-preview"]
    assert run(["batch", str(folder / "looks.yaml"), *picture, "--quiet", *more]) == code
    report = json.loads((folder / "out" / "batch.json").read_text())
    return {job["name"]: job for job in report["jobs"]}


def digests(folder, out="out"):
    return {
        f"{f.parent.name}/{f.name}": hashlib.sha256(f.read_bytes()).hexdigest()
        for f in sorted((folder / out).glob("*/*"))
        if f.suffix in (".exr", ".csv", ".tx") or f.name == "profile.json"
    }


@pytest.mark.slow
def test_bytes_do_not_tell_what_was_shared(here, folder):
    """With the cache, without it, one look alone, on one process or two: the same files."""
    batch(folder, "-j", "2")
    want = digests(folder)
    batch(folder, "-j", "1", "--no-cache", "--force", "--only", "*-day")
    assert digests(folder) == want
    look = folder / "alone.yaml"
    defaults = BATCH.partition("matrix:")[0].replace("defaults:\n", "").replace("\n  ", "\n").removeprefix("  ")
    skin = re.search(r"thick: \{(skin: .*)\}\n", BATCH)
    look.write_text(defaults + skin[1] + "\n")
    out = folder / "alone" / "thick-dusk"
    more = ["--set", "lights.lamp.intensity=[90, 80, 70]", "--no-preview", "--quiet"]
    assert run(["bake", str(look), "--out", str(out), *more]) == 0
    alone = digests(folder, "alone")
    assert alone == {name: value for name, value in want.items() if name.startswith("thick-dusk/")}


@pytest.mark.parametrize("udim", ["false", "true"])
def test_a_second_run_does_nothing(here, folder, monkeypatch, udim):
    """Not a file is written but the manifests, and the report says so; also where the mesh is read for its tiles."""
    tiles = ("--set", f"texture.udim={udim}")
    batch(folder, *tiles)
    before = {f: f.stat().st_mtime_ns for f in (folder / "out").glob("*/*.exr")}
    monkeypatch.setattr("skinbake.baking.session._LAST", {})  # as in another process
    jobs = batch(folder, *tiles)
    assert {job["status"] for job in jobs.values()} == {"fresh"}
    assert {f: f.stat().st_mtime_ns for f in before} == before


def test_one_changed_light_is_baked_alone(here, folder):
    """Its light is traced, its lobes are blurred; the other light's come from the cache, and the bytes agree."""
    first = batch(folder, "--only", "thin-day")["thin-day"]["cache"]
    other = batch(folder, "--only", "thin-day", "--set", "lights.lamp.intensity=[1, 2, 3]")["thin-day"]
    assert other["traced"] == ["lamp"]
    lights = 2
    assert first["misses"] == 1 + lights * (1 + 2 * 3)  # the raster; a light's texels; per lobe map, probes, reference
    assert other["cache"]["misses"] == 1 + 2 * 3
    after = digests(folder)
    batch(folder, "--only", "thin-day", "--set", "lights.lamp.intensity=[1, 2, 3]", "--force", "--no-cache")
    assert digests(folder) == after


@pytest.mark.parametrize("method", ["auto", "stretch", "texture", "hybrid", "reference"])
def test_a_changed_light_gives_the_bytes_of_a_bake_from_nothing(here, folder, method):
    """Whatever the plan: what is blurred alone is what is blurred together, and the figures in the headers agree."""
    how = ["--only", "thick-day", "--set", f"diffusion.method={method}", "--set", "texture.size=[64, 56]"]
    how += ["--set", "terms.interreflection=on"] if method == "auto" else []
    batch(folder, *how)
    brighter = [*how, "--set", "lights.lamp.intensity=[9000, 20, 3]"]
    assert batch(folder, *brighter)["thick-day"]["traced"] == ["lamp"]
    after = digests(folder)
    batch(folder, *brighter, "--force", "--no-cache")
    assert digests(folder) == after


def test_roughness_re_blurs_nothing(here, folder):
    """The oil layer is the preview's; where it takes no light off the skin the bake stays as it is."""
    batch(folder, "--only", "thin-*")
    before = digests(folder)
    jobs = batch(folder, "--only", "thin-*", "--set", "specular.roughness=0.5")
    assert [jobs[name]["ran"] for name in NAMES[:2]] == [[], []]
    assert digests(folder) == before
    assert read_manifest(folder / "out" / "thin-day")["config"]["specular"]["roughness"] == 0.5
    on = batch(folder, "--only", "thin-day", "--set", "terms.energy_conservation=on")
    rough = ["--set", "terms.energy_conservation=on", "--set", "specular.roughness=0.5"]
    more = batch(folder, "--only", "thin-day", *rough)
    assert "irradiance" in on["thin-day"]["ran"]
    assert "irradiance" in more["thin-day"]["ran"], "where it does take light off, it must be traced anew"


def test_a_failure_does_not_stop_the_others(here, folder, capsys):
    """Exit code 1 and a summary that names file and job; the sheet has a cell for it."""
    text = BATCH.replace("    day:\n", "    day:\n    lost: {mesh.path: nowhere.obj}\n")
    (folder / "looks.yaml").write_text(text)
    assert run(["batch", str(folder / "looks.yaml"), "--no-preview", "-j", "2"]) == 1
    said = capsys.readouterr().err
    assert "4 of 6 looks in" in said
    assert re.search(r"  thin-lost: .*nowhere\.obj: expected", said)
    report = json.loads((folder / "out" / "batch.json").read_text())
    assert [job["status"] for job in report["jobs"]] == ["done", "failed", "done"] * 2
    jobs = batch(folder, "--fail-fast", code=1)
    assert re.match(r"  thin-lost: .*nowhere\.obj: expected", capsys.readouterr().err), "quiet is not silent"
    assert [job["status"] for job in jobs.values()] == ["fresh", "failed", "skipped", "skipped", "skipped", "skipped"]


def test_a_missed_tolerance_is_told_and_written(here, folder, capsys):
    """Exit code 1 as a bake has; the files are there."""
    missed = ["--set", "diffusion.method=texture", "--set", "diffusion.tolerance=1e-4"]
    jobs = batch(folder, "--only", "thin-day", *missed, code=1)
    assert jobs["thin-day"]["status"] == "missed"
    assert "tolerance 0.0001 missed" in jobs["thin-day"]["error"]
    assert capsys.readouterr().err == f"  thin-day: {jobs['thin-day']['error']}\n"
    assert (folder / "out" / "thin-day" / "lobe_0.exr").is_file()


def test_dry_run_says_what_would_be_done_and_does_nothing(here, folder, capsys):
    """Stage by stage, and which lights are in the cache already."""
    assert run(["batch", str(folder / "looks.yaml"), "--dry-run", "--no-preview"]) == 0
    assert not (folder / "out").exists()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split(maxsplit=1) == [
        "thin-day", "profile: to fit; irradiance: trace key, lamp; diffuse: after the profile"
    ]  # fmt: skip
    batch(folder, "--only", "thin-day")
    assert run(["batch", str(folder / "looks.yaml"), "--dry-run", "--no-preview"]) == 0
    lines = [line.split(maxsplit=1)[1] for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "as it was"
    assert "irradiance: trace lamp; from the cache key" in lines[1]
    (folder / "mesh.obj").rename(folder / "gone.obj")
    assert run(["batch", str(folder / "looks.yaml"), "--dry-run"]) == 1
    assert "mesh.obj: expected a file that can be read" in capsys.readouterr().out


@pytest.mark.slow
def test_only_bakes_what_is_named_and_keeps_what_is_known(here, folder, capsys):
    """A later run for one look does not forget the others."""
    assert {j["status"] for j in batch(folder, "--only", "thin-*").values()} == {"done", "not run"}
    jobs = batch(folder, "--only", "thick-day")
    assert [job["status"] for job in jobs.values()] == ["done", "done", "done", "not run"]
    assert [job["selected"] for job in jobs.values()] == [False, False, True, False]
    assert run(["batch", str(folder / "looks.yaml"), "--only", "none"]) == 2
    assert "--only none: expected one of thin-day, thin-dusk" in capsys.readouterr().err


@pytest.mark.slow
def test_each_light_of_a_head_is_traced_once_and_plain_lines_tell_of_it(folder):
    """Four looks on two processes have a raster and three lights between them; a line a look where no terminal is.

    Lines with the time left are on stderr, JSON on stdout.
    """
    command = [sys.executable, "-m", "skinbake", "batch", str(folder / "looks.yaml"), "--no-preview", "--json"]
    done = subprocess.run([*command, "-j", "2"], cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("  ... looks: ")]  # each five seconds
    assert [line[:5] for line in lines[:4]] == ["[1/4]", "[2/4]", "[3/4]", "[4/4]"]
    assert "left)" in lines[0]
    assert "\x1b" not in done.stderr
    report = json.loads(done.stdout)
    assert report["workers"] == 2
    assert report["peak_memory_mib"] > 100
    assert all(job["peak_memory_mib"] > 50 for job in report["jobs"])
    jobs = {job["name"]: job for job in report["jobs"]}
    assert list(jobs) == NAMES
    assert {job["status"] for job in jobs.values()} == {"done"}
    assert sorted(name for job in jobs.values() for name in job["traced"]) == ["key", "lamp", "lamp"]
    assert sum("raster" in job["ran"] for job in jobs.values()) == 1
    assert {p.name for p in (folder / "out" / "thin-day").iterdir()} == {
        "bake.json", "irradiance.exr", "lobe_0.exr", "lobe_1.exr", "profile.json", "profile.csv", "profile.png"
    }  # fmt: skip


@pytest.mark.slow
def test_a_bar_on_a_terminal(folder):
    """With a terminal behind stderr the display moves, and names the look that is baked."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [
        sys.executable,
        "-m",
        "skinbake",
        "batch",
        str(folder / "looks.yaml"),
        "--no-preview",
        "--only",
        "thin-*",
    ]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(command, cwd=ROOT, stderr=theirs, env=environment) as process:
        os.close(theirs)
        said = b""
        while True:
            try:
                chunk = os.read(ours, 4096)
            except OSError:
                break
            if not chunk:
                break
            said += chunk
    os.close(ours)
    assert process.returncode == 0
    assert b"\x1b[" in said
    assert re.search(r"\r\x1b\[K  looks: thin-\w+ .*\d s", said.decode())
    assert "2 of 2 looks in" in said.decode()


def test_the_cache_can_live_elsewhere_and_be_bounded(here, folder, monkeypatch):
    """SKINBAKE_CACHE and --cache say where; past --cache-gib the longest unread go; --no-cache leaves nothing."""
    batch(folder, "--only", "thin-day", "--no-cache")
    assert not (folder / "out" / ".cache").exists()
    monkeypatch.setenv("SKINBAKE_CACHE", str(folder / "shared"))
    batch(folder, "--only", "thin-dusk")
    entries = list((folder / "shared").rglob("*.npz"))
    assert entries
    assert not (folder / "out" / ".cache").exists()
    batch(folder, "--only", "thick-*", "--cache", str(folder / "tiny"), "--cache-gib", "0")
    assert not list((folder / "tiny").rglob("*.npz"))
    assert len(list((folder / "shared").rglob("*.npz"))) == len(entries)


@pytest.mark.parametrize("size", ["nan", "inf", "1e300", "-1"])
def test_a_cache_has_a_size(folder, capsys, size):
    """Nothing is written otherwise."""
    assert run(["batch", str(folder / "looks.yaml"), "--cache-gib", size]) == 2
    assert "Invalid value for '--cache-gib'" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_a_single_bake_can_use_the_cache_too(here, folder, monkeypatch, capsys):
    """Folder by option or by environment: another look of the head finds its lights traced."""
    look = ["bake", str(folder / "alone.yaml"), "--no-preview", "--out"]
    defaults = BATCH.partition("matrix:")[0].replace("defaults:\n", "").replace("\n  ", "\n").removeprefix("  ")
    (folder / "alone.yaml").write_text(defaults + "skin: {preset: jensen-skin1, fit: {gaussians: 2}}\n")
    assert run([*look, str(folder / "a"), "--cache", str(folder / "shared")]) == 0
    entries = sorted((folder / "shared").rglob("*.npz"))
    assert entries
    monkeypatch.setenv("SKINBAKE_CACHE", str(folder / "shared"))
    assert run([*look, str(folder / "b")]) == 0
    assert sorted((folder / "shared").rglob("*.npz")) == entries
    for name in ("irradiance.exr", "lobe_0.exr"):
        assert (folder / "a" / name).read_bytes() == (folder / "b" / name).read_bytes()
    monkeypatch.delenv("SKINBAKE_CACHE")
    assert run([*look, str(folder / "c")]) == 0
    assert not list((folder / "c").glob(".*"))


def test_info_lists_a_batch(here, folder, capsys):
    """Its looks and how they fared."""
    batch(folder, "--only", "thin-*")
    assert run(["info", str(folder / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("4 looks of looks.yaml")
    assert re.fullmatch(r"  thin-day +done +off by 0\.\d\d% from its own model", lines[1])
    assert lines[3].split() == ["thick-day", "not", "run"]


def test_a_look_is_told_by_all_that_is_left_wrong(here, folder):
    """As its bake.json has it, with the blur named as such: what the rest adds must not be lost from the report."""
    job = batch(folder, "--only", "thin-day", "--set", "terms.interreflection=off")["thin-day"]
    error = read_manifest(folder / "out" / "thin-day")["error"]
    assert job["measured"]["left_wrong"] == error["left_wrong"] > error["rms"] == job["measured"]["blur"]["rms"]
    assert job["note"] == f"off by {error['left_wrong']:.2%} from its own model"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "expected JSON"),
        ("[]", "expected a mapping"),
        ("{}", "jobs: missing"),
        ('{"jobs": [{"name": "thin-day"}]}', "jobs.0.status: missing"),
    ],
)
def test_a_damaged_report_is_told_and_written_anew(here, folder, capsys, text, message):
    """`info` ends with one line; the next batch knows nothing of it."""
    (folder / "out").mkdir()
    (folder / "out" / "batch.json").write_text(text)
    assert run(["info", str(folder / "out")]) == 2
    said = capsys.readouterr().err
    assert re.fullmatch(rf"skinbake: \S+batch\.json: {message}.*\n", said)
    assert [job["status"] for job in batch(folder, "--only", "thick-day").values()][1:3] == ["not run", "done"]
