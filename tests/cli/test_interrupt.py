"""Ctrl-C at any moment of any verb: exit code 130 within two seconds, a line, and nothing left behind."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.preview.setup_gl import renderer_name
from tests.cli.test_faults import LOOK, contents
from tests.conftest import ROOT
from tests.shapes import relief, sphere

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

STOPS = int(os.environ.get("SKINBAKE_STOPS", "0"))  # of each verb; `make faults` asks for 34
LIMIT_S = 2.0
VERBS = ["bake", "batch", "preview", *(["movie", "export", "irradiance", "diffuse", "truth"] if STOPS else [])]
BATCH = """\
defaults: {base: BASE, texture: {size: 32}, output: {dir: looks}}
jobs: [{name: one}, {name: two, lights.key.irradiance: [3, 2, 1]}, {name: three, lights.key.irradiance: [1, 2, 3]}]
"""


BALL = """\
mesh: {path: ball.obj, unit: mm, any_size: true}
texture: {size: 32}
skin: {model: multipole, normalise: none, layers: [{sigma_a_per_mm: [0.1, 0.2, 0.3], sigma_sp_per_mm: [3, 3, 3],
       thickness_mm: .inf, eta: 1.0}]}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: ball}
"""


def heard():
    """Ctrl-C is ignored where the tests themselves run in the background; a child hears it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Running:
    """A skinbake of its own session, as a terminal starts one."""

    def __init__(self, arguments, folder):
        command = [sys.executable, "-m", "skinbake", *map(str, arguments)]
        self.process = subprocess.Popen(
            command, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=heard,
        )  # fmt: skip

    def wait_until_it_listens(self):
        """Wait for the interpreter to be there and `install` to have been called: SIGTERM is caught."""
        while self.process.poll() is None:
            status = Path(f"/proc/{self.process.pid}/status").read_text()
            caught = int(next(line for line in status.splitlines() if line.startswith("SigCgt")).split()[1], 16)
            if caught >> signal.SIGTERM - 1 & 1:
                return
            time.sleep(0.002)

    def stop(self, alone=False):
        """Press Ctrl-C, which all processes of the terminal get, or have the first `alone` get it; seconds it took."""
        begun = time.monotonic()
        if self.process.poll() is not None:
            return None
        (os.kill if alone else os.killpg)(self.process.pid, signal.SIGINT)
        self.said = self.process.communicate(timeout=60)[1]
        return time.monotonic() - begun

    def family(self):
        """Processes of the session that are there still; one that nobody has asked for its exit code is gone."""
        found = []
        for entry in os.listdir("/proc"):
            try:
                if not entry.isdigit() or os.getsid(int(entry)) != self.process.pid:
                    continue
                if Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX":
                    found.append(Path(f"/proc/{entry}/cmdline").read_bytes().replace(b"\0", b" "))
            except OSError:
                continue
        return found


def litter(folder):
    """What is neither a result nor an input: unfinished files and locks."""
    return [str(path) for path in folder.rglob(".*") if ".part" in path.name or path.name.endswith("lock")] + [
        str(path) for path in folder.rglob("locks/*")
    ]


def sweep(folder, arguments, moments, seed):
    """Stop a command at random moments of its run, half of them in the first quarter; what went wrong, and seconds."""
    rng = random.Random(seed)
    begun = time.monotonic()
    whole = Running(arguments, folder)
    whole.process.communicate()
    seconds = time.monotonic() - begun
    wrong, took, stopped = [], [], 0
    for turn in range(2 * moments):
        if stopped == moments:
            break
        running = Running(arguments, folder)
        running.wait_until_it_listens()
        delay = rng.uniform(0, 0.25 if turn % 2 else 1.0) * seconds
        time.sleep(delay)
        needed = running.stop(alone=turn % 3 == 0)
        if needed is None or running.process.returncode == whole.process.returncode:
            running.process.communicate()
            continue  # done before it was stopped
        stopped += 1
        took.append(needed)
        said = running.said.strip().splitlines()
        fine = running.process.returncode == 130 and needed < LIMIT_S and "Traceback" not in running.said
        fine &= said[-1:] == ["stopped"]
        end = time.monotonic() + 0.5  # the one that multiprocessing starts for itself hears of it by the closed pipe
        while running.family() and time.monotonic() < end:
            time.sleep(0.02)
        left = running.family() + litter(folder)
        if not fine or left:
            wrong.append((round(delay, 3), running.process.returncode, round(needed, 2), running.said[-400:], left))
    return stopped, wrong, took


@pytest.fixture(scope="module")
def look(tmp_path_factory):
    """The sample head at 128^2, for `make faults`; a small relief else."""
    folder = tmp_path_factory.mktemp("stopped")
    text = (ROOT / "configs" / "head_plain.yaml").read_text().replace("../data", str(ROOT / "data")) if STOPS else LOOK
    (folder / "head.yaml").write_text(text)
    write_obj(folder / "mesh.obj", relief(segments=24))
    write_obj(folder / "ball.obj", sphere(30.0, "cube", 8))
    (folder / "ball.yaml").write_text(BALL)
    (folder / "batch.yaml").write_text(BATCH.replace("BASE", str(folder / "head.yaml")))
    return folder


SMALL = ["--set", f"texture.size={128 if STOPS else 32}", "--set", "preview.size=[96, 120]", "--quiet"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.slow  # a process for each moment
@pytest.mark.usefixtures("drawn_plots")  # as those processes do
def test_ctrl_c_at_any_moment(look, verb, capsys):
    """130 within two seconds, one line, no child and no unfinished file; the next run ends in the same bytes."""
    if verb == "preview" and renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    bake = ["bake", look / "head.yaml", *SMALL, "--out", look / "out"]
    arguments = {
        "bake": [*bake, "--force"],
        "batch": ["batch", look / "batch.yaml", "-j2", "--force", "--quiet", "--no-preview"],
        "preview": ["preview", look / "out", "--png", look / "picture.png", "--quiet"],
        "movie": ["preview", look / "out", "--turntable", "12", "--movie", look / "turn.gif", "--quiet"],
        "export": ["export", look / "out", "--to", look / "handed", "--sum", "--layers", "--web", "--quiet"],
        "irradiance": ["irradiance", look / "head.yaml", *SMALL, "--out", look / "lit", "--force"],
        "diffuse": ["diffuse", look / "head.yaml", look / "out" / "irradiance.exr", *SMALL, "--out", look / "blurred"],
        "truth": ["truth", look / "ball.yaml", "--points", "40", "--walks", "400", "--quiet"],
    }[verb]
    if verb in ("preview", "movie", "export", "diffuse"):
        assert run([*map(str, bake)]) == 0
    stopped, wrong, took = sweep(look, arguments, STOPS or 2, seed=len(verb))
    with capsys.disabled():
        if STOPS:
            print(f"\n{verb}: stopped {stopped} times, {stopped - len(wrong)} well, at most {max(took):.2f} s")
    assert not wrong, "\n".join(map(str, wrong))
    assert stopped
    if verb == "bake":
        assert run([*map(str, bake)]) == 0
        assert run([*map(str, bake), "--out", str(look / "alone")]) == 0
        assert contents(look / "out") == contents(look / "alone")


def test_an_ignored_signal_stays_ignored(tmp_path):
    """What a shell has put into the background does not hear the terminal's Ctrl-C."""
    code = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
from skinbake import interrupt
interrupt.install()
os.kill(os.getpid(), signal.SIGINT)
time.sleep(0.1)
print("on")
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "on\n"


STUCK = """
import os, signal, sys, threading, time
from functools import partial
from skinbake import interrupt
interrupt.install()
open("half", "w").close()
threading.Timer(0.1, os.kill, (os.getpid(), signal.{signal})).start()
with interrupt.undone_at_stop(partial(os.unlink, "half")):
    {work}
"""


@pytest.mark.parametrize(
    ("work", "name", "code"),
    [
        ("import ctypes; ctypes.CDLL(None).sleep(9)", "SIGINT", 130),
        ("while True: pass", "SIGINT", 130),
        ("while True:\n        try:\n            time.sleep(9)\n        except BaseException: pass", "SIGINT", 130),
        ("with interrupt.saving():\n        try: time.sleep(9)\n        finally: time.sleep(9)", "SIGINT", 130),
        ("time.sleep(9)", "SIGTERM", 143),
        ("time.sleep(9)", "SIGHUP", 129),
    ],
)
def test_whatever_the_main_thread_is_doing(tmp_path, work, name, code):
    """Within a library, a swallowed exception, a save that takes too long: the process ends, and its file is undone."""
    script = tmp_path / "stuck.py"
    script.write_text(STUCK.format(signal=name, work=work))
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True, check=False, timeout=8, preexec_fn=heard,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "stopped\n")
    assert not (tmp_path / "half").exists()


def test_a_save_that_ends_in_time_decides_the_exit_code(tmp_path):
    """KeyboardInterrupt is raised where a block asks for it, and a command that is done is not stopped any more."""
    script = tmp_path / "saves.py"
    work = "with interrupt.saving():\n        try: time.sleep(9)\n        except KeyboardInterrupt: pass\n"
    work += "interrupt.finish(); time.sleep(0.1); os.kill(os.getpid(), signal.SIGINT); time.sleep(0.1); sys.exit(7)"
    script.write_text(STUCK.format(signal="SIGINT", work=work))
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True, check=False, timeout=8, preexec_fn=heard,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (7, "")
