"""What a bake survives: being killed at any moment, a full disk, a folder it may not write to, inputs that vanish."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.errors import InputError, MachineError
from skinbake.io.exr import Part, read_parts, rgb_channels, write_parts
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.cli.test_batch import Here
from tests.conftest import ROOT
from tests.shapes import relief

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: [52, 48], gutter: 4}
skin: {model: gaussians, variance_mm2: [0.05, 1.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
  - {name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}
diffusion: {method: surface, tolerance: 1.0, probes: 50}
terms: {energy_conservation: off, transmission: off, interreflection: off}
output: {dir: out, tx: true}
"""
KILLS = int(os.environ.get("SKINBAKE_KILLS", "5"))  # `make faults` kills fifty times
OTHER = ["--set", "lights.key.irradiance=[3, 2, 1]"]  # makes something stale


class Bakes:
    """A look, and the process that bakes it in children that may die."""

    def __init__(self, folder, process) -> None:
        self.folder, self.process, self.out = folder, process, folder / "out"

    def __call__(self, *more, out=None, **how):
        arguments = ["bake", str(self.folder / "look.yaml"), "--no-preview", "--quiet", "--out", str(out or self.out)]
        return self.run([*arguments, *more], **how)

    def run(self, arguments, **how):
        """Any command, in a child that may die."""
        self.process.stdin.write(json.dumps({"arguments": arguments, **how}) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())


@pytest.fixture(scope="module")
def process():
    command = [sys.executable, "-m", "tests.cli.victim"]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        yield running
        running.stdin.close()


@pytest.fixture
def bakes(tmp_path, process):
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    (tmp_path / "look.yaml").write_text(LOOK)
    return Bakes(tmp_path, process)


def contents(folder):
    """Every file's digest; of the manifest what does not tell of time and memory."""
    found = {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.iterdir() if f.name != "bake.json"}
    told = ("timings", "timings_expected", "reused", "peak_memory_mib")
    manifest = {key: value for key, value in read_manifest(folder).items() if key not in told}
    return found | {f"bake.json {key}": json.dumps(value) for key, value in manifest.items()}


def check_whole(folder):
    """Whatever is there under its own name is whole; a manifest vouches for all that it names."""
    for path in folder.glob("[!.]*.exr") if folder.is_dir() else ():
        read_parts(path)
    try:
        manifest = read_manifest(folder)
    except InputError:
        return
    for name in [*manifest["irradiance"], *(lobe["file"] for lobe in manifest["lobes"])]:
        inputs = json.loads(read_parts(folder / name)["irradiance"].attributes["skinbake:inputs"])
        assert inputs["mesh"]
        assert inputs.items() <= manifest["inputs"].items()


def test_a_bake_killed_at_random_times_ends_in_the_same_bytes(bakes):
    """Killed at any moment, in a new folder or in the middle of a change: the clean rerun is as one left alone."""
    undisturbed = bakes(out=bakes.folder / "alone")
    assert undisturbed["code"] == 0, undisturbed
    seconds = bakes("--force", out=bakes.folder / "alone")["seconds"]
    want = contents(bakes.folder / "alone")
    rng = random.Random(5)
    killed = 0
    while killed < KILLS:
        if rng.random() < 0.3:
            shutil.rmtree(bakes.out, ignore_errors=True)
        else:
            bakes(*OTHER, kill_after=rng.uniform(0, 1.2) * seconds)
        answer = bakes(kill_after=rng.uniform(0, 1) * seconds)
        if answer["code"] != -9:
            assert answer["code"] == 0, answer
            continue
        killed += 1
        check_whole(bakes.out)
        answer = bakes()
        assert answer["code"] == 0, answer
        assert contents(bakes.out) == want, f"after kill {killed}"


@pytest.mark.parametrize("relight", ["", "relight: {textures: 4, size: 16, basis: harmonics}\n"], ids=["", "relight"])
def test_a_bake_killed_before_any_step_on_the_disk_ends_in_the_same_bytes(bakes, relight):
    """Each fsync, rename and removal in turn is the one that is never made, when the folder holds another look."""
    (bakes.folder / "look.yaml").write_text(LOOK.replace("[52, 48]", "[26, 24]") + relight if relight else LOOK)
    undisturbed = bakes(out=bakes.folder / "alone")
    assert undisturbed["code"] == 0, undisturbed
    want = contents(bakes.folder / "alone")
    assert bakes(*OTHER)["code"] == 0
    shutil.copytree(bakes.out, bakes.folder / "other")
    steps = bakes()["steps"]
    assert steps > 15
    for step in range(0, steps, 1 if KILLS > 8 else 30 if relight else 8):
        shutil.rmtree(bakes.out)
        shutil.copytree(bakes.folder / "other", bakes.out)
        assert bakes(die_at=step)["code"] == -9
        check_whole(bakes.out)
        assert bakes()["code"] == 0
        assert contents(bakes.out) == want, f"step {step} of {steps}"


def test_two_bakes_of_one_folder_take_turns(bakes):
    """The second waits for the lock, finds everything done, and both end well."""
    command = [sys.executable, "-m", "skinbake", "bake", str(bakes.folder / "look.yaml"), "--no-preview"]
    both = [subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate(timeout=120)[1] for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    assert sum("as it was" in text for text in said) == 1, said
    assert not [f.name for f in bakes.out.iterdir() if f.name.startswith(".")]


@contextmanager
def mounted(folder, options):
    """A small file system of its own on `folder`."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, check=False
    )
    if done.returncode:
        pytest.skip("mounting a small file system needs the rights to: run as root")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mounts a tmpfs")
@pytest.mark.parametrize("kib", [24, 80, 140])
def test_a_full_disk_is_told_and_survived(bakes, kib):
    """Exit code 3 with what to do; nothing half-written; with room again the bake goes on to the same bytes."""
    alone = bakes.folder / "other_disk" / "out"
    assert bakes(out=alone)["code"] == 0
    disk = bakes.folder / "disk"
    with mounted(disk, f"size={kib}k"):
        answer = bakes(out=disk / "out")
        assert answer["code"] == 3, answer
        assert "the disk is full; free some space" in answer["stderr"]
        assert "Traceback" not in answer["stderr"]
        assert not list(disk.rglob("*.part*"))
        check_whole(disk / "out")
        subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)
        assert bakes(out=disk / "out")["code"] == 0
        assert contents(disk / "out") == contents(alone)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mounts a tmpfs")
@pytest.mark.parametrize("name", ["noise.exr", "noise.png"])
def test_a_disk_that_fills_up_in_the_middle_of_a_file_is_told(tmp_path, name):
    """Libraries have errors of their own for it; read-only, the same; nothing stays."""
    noise = np.random.default_rng(0).random((256, 256, 3), dtype=np.float32)

    def write():
        if name.endswith("exr"):
            write_parts(tmp_path / "disk" / name, [Part("", rgb_channels(noise))])
        else:
            write_png(tmp_path / "disk" / name, (255 * noise).astype(np.uint8))

    with mounted(tmp_path / "disk", "size=60k"):
        with pytest.raises(MachineError, match=f"{name}: the disk is full"):
            write()
        assert not list((tmp_path / "disk").iterdir())
        subprocess.run(["mount", "-o", "remount,ro", str(tmp_path / "disk")], check=True)
        with pytest.raises(InputError, match="a folder that can be written to"):
            write()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mounts a tmpfs")
def test_a_folder_that_becomes_read_only_is_told(bakes):
    """Exit code 2, the path and what to do; what was there stays readable."""
    disk = bakes.folder / "disk"
    with mounted(disk, "size=8m"):
        assert bakes(out=disk / "out")["code"] == 0
        before = contents(disk / "out")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        answer = bakes(*OTHER, out=disk / "out")
        assert answer["code"] == 2, answer
        assert "expected a folder that can be written to" in answer["stderr"]
        assert contents(disk / "out") == before


@pytest.mark.skipif(not os.path.isdir("/sys/kernel"), reason="needs a folder that not even root can write to")
def test_a_folder_nobody_may_write_to_is_told(bakes):
    """Not even root can make a folder there."""
    answer = bakes(out="/sys/kernel/out")
    assert answer["code"] == 2, answer
    assert "/sys/kernel/out" in answer["stderr"]
    assert "Traceback" not in answer["stderr"]


def test_an_input_that_vanishes_is_named_and_its_return_heals(bakes):
    """Exit code 2 and the file's name; once it is back the bake gives the same bytes."""
    assert bakes(out=bakes.folder / "alone")["code"] == 0
    mesh = bakes.folder / "mesh.obj"
    mesh.rename(bakes.folder / "away.obj")
    answer = bakes()
    assert answer["code"] == 2, answer
    assert str(mesh) in answer["stderr"]
    (bakes.folder / "away.obj").rename(mesh)
    assert bakes()["code"] == 0
    assert contents(bakes.out) == contents(bakes.folder / "alone")


def test_an_input_changed_while_it_is_read_is_refused(bakes, monkeypatch):
    """Else its results would be kept under the key of what it was before."""
    from skinbake.baking import inputs
    from skinbake.baking.session import BakeSession
    from skinbake.baking.stage_log import StageLog
    from skinbake.io.config import load_look

    look = inputs.BakeInputs(load_look(bakes.folder / "look.yaml"), BakeSession(), StageLog())
    assert look.digests["mesh"]
    read = inputs.read_scene

    def read_and_touch(spec, **how):
        scene = read(spec, **how)
        with open(bakes.folder / "mesh.obj", "a") as file:
            file.write("# edited\n")
        return scene

    monkeypatch.setattr(inputs, "read_scene", read_and_touch)
    with pytest.raises(InputError, match=r"mesh\.obj: it was changed while it was read; run again"):
        look.scene()


def test_a_cut_file_is_made_anew(bakes):
    """A copy that went wrong is not taken for a finished stage."""
    assert bakes()["code"] == 0
    want = contents(bakes.out)
    for name in ("irradiance.exr", "lobe_0.exr", "lobe_1.exr", "profile.json", "lobe_0.tx", "bake.json"):
        data = (bakes.out / name).read_bytes()
        (bakes.out / name).write_bytes(data[: len(data) // 3])
        answer = bakes()
        assert answer["code"] == 0, (name, answer)
        assert contents(bakes.out) == want, name


@pytest.mark.slow  # two processes, each with another number of threads
def test_bytes_are_the_same_whatever_the_number_of_threads(bakes):
    """Of the kernels and of BLAS, which divides long sums among its own: 2000 probes of two lights make some."""
    command = [sys.executable, "-m", "skinbake", "bake", str(bakes.folder / "look.yaml"), "--no-preview", "--quiet"]
    left = []
    for threads in ("1", "2"):
        out = bakes.folder / f"of_{threads}"
        environment = os.environ | {"OPENBLAS_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}
        more = ["--set", "diffusion.probes=2000", "--out", str(out)]
        done = subprocess.run([*command, *more], cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
        assert done.stdout + done.stderr == "", "--quiet, and no library complains at the end"
        left.append(contents(out))
    assert left[0] == left[1]


def digests(folder):
    """Every file below `folder` and its digest; nothing of a temporary name is among them."""
    return {
        str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.rglob("*") if f.is_file()
    }


@pytest.mark.parametrize("moment", ["random", "each step"])
def test_an_export_killed_at_any_moment_ends_in_the_same_bytes(bakes, moment):
    """Over an export of another bake: what has a name is whole, and the next run leaves what one left alone would."""
    assert bakes()["code"] == 0
    command = ["export", str(bakes.out), "--quiet", "--sum", "--layers", "--gltf", "--blender", "--web", "--to"]
    alone, to, other = (bakes.folder / name for name in ("exported alone", "exported", "exported before"))
    undisturbed = bakes.run([*command, str(alone)])
    assert undisturbed["code"] == 0, undisturbed
    want = digests(alone)
    assert bakes(*OTHER)["code"] == bakes.run([*command, str(other)])["code"] == bakes()["code"] == 0
    assert digests(other).keys() == want.keys()
    shutil.copytree(other, to)
    steps = bakes.run([*command, str(to)])["steps"]
    assert steps >= len(want)
    assert digests(to) == want
    rng = random.Random(11)
    hows = [{"die_at": step} for step in range(0, steps, 1 if KILLS > 8 else 20)]
    if moment == "random":
        hows = [{"kill_after": rng.uniform(0, 1) * undisturbed["seconds"]} for _ in range(KILLS // 4)]
    for how in hows:
        shutil.rmtree(to)
        shutil.copytree(other, to)
        code = bakes.run([*command, str(to)], **how)["code"]
        assert code == -9 or ("kill_after" in how and code == 0)
        old = digests(other)
        for name, digest in digests(to).items():
            whole = digest in (old.get(name), want.get(name))
            assert whole or Path(name).name.startswith(".") or name == "export.json", (how, name)  # what is begun
        assert bakes.run([*command, str(to)])["code"] == 0
        assert digests(to) == want, how


@pytest.mark.slow  # three bakes a kill
def test_a_sequence_killed_at_random_times_ends_in_the_same_bytes(bakes):
    """Frames are bakes of their own: those that were finished stay, the rest is made, no temporary file is left."""
    for frame, level in ((1, 90), (2, 140), (3, 200)):
        write_png(bakes.folder / f"albedo.{frame:04d}.png", np.full((8, 8, 3), level, np.uint8))
    text = LOOK.replace("output: {dir: out, tx: true}", "output: {dir: out}")
    (bakes.folder / "look.yaml").write_text(text + "maps: {albedo: albedo.####.png}\nframes: 1-3\n")

    def frames(folder):
        return {path.parent.name: contents(path.parent) for path in sorted(folder.rglob("bake.json"))}

    alone = bakes(out=bakes.folder / "alone")
    assert alone["code"] == 0, alone
    want = frames(bakes.folder / "alone")
    assert len(want) == 3
    rng, killed = random.Random(13), 0
    while killed < (KILLS if KILLS > 8 else 1):
        if rng.random() < 0.5:
            shutil.rmtree(bakes.out, ignore_errors=True)
        else:
            assert bakes(*OTHER)["code"] == 0
        if bakes(kill_after=rng.uniform(0, 1) * alone["seconds"])["code"] != -9:
            continue
        killed += 1
        for folder in bakes.out.glob("*/"):
            check_whole(folder)
        assert bakes()["code"] == 0
        assert frames(bakes.out) == want, f"after kill {killed}"
        assert not list(bakes.out.rglob("*.part*"))


BATCH = """\
defaults: {base: look.yaml, output: {dir: looks}}
jobs: [{name: one}, {name: two, lights.key.irradiance: [3, 2, 1]}, {name: three, diffusion.probes: 40}]
"""


@pytest.mark.slow  # a batch of two processes a kill
def test_a_batch_killed_at_random_times_ends_in_the_same_bytes(bakes, drawn_plots):
    """The parent, one of its processes, or all of them: the clean rerun is as one left alone, and nobody stays."""
    (bakes.folder / "looks.yaml").write_text(BATCH)

    def command(out):
        more = ["--out", str(bakes.folder / out), "--cache", str(bakes.folder / f"cache of {out}")]
        return ["batch", str(bakes.folder / "looks.yaml"), "-j2", "--no-preview", "--quiet", *more]

    def in_here(arguments):
        """In this process, which has everything imported."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("skinbake.batch.batching.ProcessPool", Here)
            patch.setattr("skinbake.baking.session._LAST", {})
            return run(arguments)

    def left(out):
        report = json.loads((bakes.folder / out / "batch.json").read_text())
        assert [job["status"] in ("done", "fresh") for job in report["jobs"]] == [True] * 3, report
        assert not list((bakes.folder / out).rglob("*.part*"))
        return {name: contents(bakes.folder / out / name) for name in ("one", "two", "three")}

    assert in_here(command("alone")) == 0
    want, looks = left("alone"), bakes.folder / "looks"
    files = sum(len(found) for found in want.values())
    rng, killed = random.Random(7), 0
    while killed < (KILLS if KILLS > 8 else 1):
        if rng.random() < 0.6:
            shutil.rmtree(looks, ignore_errors=True)
            shutil.rmtree(bakes.folder / "cache of looks", ignore_errors=True)
        # Killed when so many files have their names, and a moment later
        moment, later = rng.randrange(files), rng.uniform(0, 0.2)
        process = subprocess.Popen(
            [sys.executable, "-m", "skinbake", *command("looks")], cwd=ROOT, start_new_session=True
        )
        while process.poll() is None and len(list(looks.glob("*/[!.]*"))) < moment:
            time.sleep(0.01)
        time.sleep(later)
        if process.poll() is not None:
            continue
        who = rng.choice(["parent", "all", "child"])
        family = [pid for pid in map(int, filter(str.isdigit, os.listdir("/proc"))) if session_of(pid) == process.pid]
        for pid in {"parent": [process.pid], "all": family, "child": family[-1:]}[who]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        code = process.wait(120)
        assert code == (0 if who == "child" and family[-1] != process.pid else -signal.SIGKILL), who
        killed += 1
        for folder in looks.glob("*/"):
            check_whole(folder)
        deadline = time.monotonic() + 10
        while any(session_of(int(pid)) == process.pid for pid in os.listdir("/proc") if pid.isdigit()):
            assert time.monotonic() < deadline, f"processes stay after a kill of {who}"
            time.sleep(0.05)
        assert in_here(command("looks")) == 0
        assert left("looks") == want, f"after kill {killed}, of {who}"


def session_of(pid):
    """Session of a process that lives."""
    try:
        with open(f"/proc/{pid}/stat") as status:
            fields = status.read().rpartition(")")[2].split()
        return None if fields[0] in "ZX" else int(fields[3])
    except OSError:
        return None
