"""A look that is watched: a save shows as a draft, then as asked; a fault is told, and the picture stays."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from skinbake.io.mesh import write_obj
from skinbake.preview.setup_gl import renderer_name
from tests.cli.test_faults import LOOK, mounted
from tests.cli.test_interrupt import LIMIT_S, Running, litter
from tests.conftest import ROOT
from tests.preview.display import display
from tests.shapes import relief

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

WAIT_S = 120.0
SMALL = "preview: {size: [48, 60]}\n"


@pytest.fixture
def folder(tmp_path):
    """A look of a small relief, whose albedo is a file."""
    if renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    folder = tmp_path / "watched"
    folder.mkdir()
    write_obj(folder / "mesh.obj", relief(segments=24))
    (folder / "look.yaml").write_text(LOOK.replace(", tx: true", "") + SMALL)
    return folder


class Watched(Running):
    """A `skinbake watch` whose lines are read as they come."""

    def __init__(self, folder, *more):
        self.log = folder / "log"
        self.picture = folder / "out" / "watch.png"
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "skinbake", "watch", "look.yaml", *more], cwd=folder, stderr=log,
                stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)}, start_new_session=True,
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL), text=True,
            )  # fmt: skip

    @property
    def lines(self):
        return self.log.read_text().splitlines()

    def until(self, so):
        """Wait until something is so."""
        end = time.monotonic() + WAIT_S
        while not so():
            assert self.process.poll() is None, self.lines
            assert time.monotonic() < end, self.lines
            time.sleep(0.02)

    def counted(self, word):
        return sum(word in line for line in self.lines)

    def stop(self, alone=False):
        """Ctrl-C; the exit code, seconds, and what is left of its processes."""
        begun = time.monotonic()
        os.killpg(self.process.pid, signal.SIGINT)
        self.process.communicate(timeout=WAIT_S)
        return self.process.returncode, time.monotonic() - begun


def edited(folder, before, after, name="look.yaml"):
    """Save a file as editors do: another one in its place."""
    text = (folder / name).read_text()
    assert before in text
    (folder / ".new").write_text(text.replace(before, after))
    os.replace(folder / ".new", folder / name)


def test_saves_show_and_ctrl_c_ends_it(folder):
    """Draft and bake; a changed light; a fault in a line; mended; another mesh; exit 130 and nothing left."""
    watched = Watched(folder)
    watched.until(lambda: watched.counted("  as asked: "))
    assert watched.lines[0].endswith("watching look.yaml and 1 files that it names; Ctrl-C ends it")
    manifest = json.loads((folder / "out" / "bake.json").read_text())
    assert watched.picture.read_bytes() == (folder / "out" / "preview.png").read_bytes()

    first = watched.picture.read_bytes()
    edited(folder, "irradiance: [1, 2, 3]", "irradiance: [3, 2, 1]")
    watched.until(lambda: watched.counted("  draft in ") == 2)
    assert watched.picture.read_bytes() != first
    watched.until(lambda: watched.counted("  as asked: ") == 2)
    assert json.loads((folder / "out" / "bake.json").read_text())["config"] != manifest["config"]

    kept = watched.picture.read_bytes()
    edited(folder, "irradiance: [3, 2, 1]", "irradiance: [3, 2, 1")
    watched.until(lambda: watched.counted("look.yaml:"))
    edited(folder, "irradiance: [3, 2, 1", "irradianc: [3, 2, 1]")
    watched.until(lambda: watched.counted("did you mean irradiance?"))
    assert watched.picture.read_bytes() == kept
    assert "Traceback" not in watched.log.read_text()
    edited(folder, "irradianc: [3, 2, 1]", "irradiance: [3, 2, 1]")
    watched.until(lambda: watched.counted("  as asked: ") == 3)
    assert watched.picture.read_bytes() == kept

    write_obj(folder / "mesh.obj", relief(segments=12))
    watched.until(lambda: watched.counted("  as asked: ") == 4)
    assert watched.picture.read_bytes() != kept
    assert watched.counted("look.yaml:") == 2  # each fault once

    edited(folder, "irradiance: [3, 2, 1]", "irradiance: [2, 2, 2]")
    watched.until(lambda: watched.counted("  draft in ") == 5)
    code, seconds = watched.stop()  # while it bakes as asked
    assert (code, watched.lines[-1]) == (130, "stopped")
    assert seconds < LIMIT_S
    end = time.monotonic() + 0.5
    while watched.family() and time.monotonic() < end:
        time.sleep(0.02)
    assert watched.family() + litter(folder / "out") == []


DRIVE = """
import json, sys, time
import numpy as np
from pyglet.window import key
from skinbake import interrupt
from skinbake.watch.picture_window import PictureWindow
from skinbake.watch.watch import Watch
from pathlib import Path

config = Path("look.yaml")
screen = PictureWindow(Path("window"), config)
watch = Watch(config, ["preview.size=[200, 160]"], "window", screen)
watch.begin()
window = screen.window
said, shots = {"first": window.message}, {"first": window.pixels()}

def until(so):
    end = time.monotonic() + 120
    while not so():
        assert time.monotonic() < end, window.lines
        window.window.dispatch_events()
        watch.step()
        time.sleep(0.01)

def save(before, after):
    text = config.read_text()
    assert before in text
    config.write_text(text.replace(before, after))

until(lambda: window.message == "as asked")
renderer, camera = window.renderer, window.camera.turned(20)
window.camera = camera
window.frame()
save("irradiance: [1, 2, 3]", "irradiance: [9, 1, 1]")
until(lambda: window.message.startswith("draft"))
shots["draft"] = window.pixels()
until(lambda: window.message == "as asked")
shots["as asked"] = window.pixels()
said["in place"] = [window.renderer is renderer, window.camera is camera]
save("irradiance: [9, 1, 1]", "irradiance: [9, 1")
until(lambda: "look.yaml:" in window.message)
shots["fault"] = window.pixels()
said["fault"] = window.message
save("irradiance: [9, 1", "irradiance: [9, 1, 1]")
until(lambda: window.message == "as asked")
window.window.dispatch_event("on_key_press", key.UP, 0)
window.window.dispatch_event("on_key_press", key.W, 0)
window.window.dispatch_events()
said["written"] = window.message
until(lambda: window.message == "as asked")
said["look"] = config.read_text()
said["gains"] = window.controls.gains_rgb.tolist()
watch.close()
window.close()
np.savez(sys.argv[1], **shots)
print(json.dumps(said))
"""


def test_the_window_shows_it_in_place(folder, tmp_path):
    """Draft and bake from where the camera stands; a fault below the picture; W writes the gain, which is then 1."""
    with display() as environment:
        done = subprocess.run(
            [sys.executable, "-c", DRIVE, str(tmp_path / "shots.npz")], cwd=folder, capture_output=True, text=True,
            env=environment | {"PYTHONPATH": str(ROOT)}, timeout=2 * WAIT_S,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said, shots = json.loads(done.stdout.splitlines()[-1]), dict(np.load(tmp_path / "shots.npz"))
    assert said["first"] == "draft, 52 x 48"
    assert said["in place"] == [True, True]
    assert said["fault"].startswith("look.yaml:")
    assert said["written"] == "written to look.yaml: key.irradiance, preview.camera"
    assert "irradiance: [10.7, 1.189, 1.189]" in said["look"]
    assert said["gains"] == [[1, 1, 1], [1, 1, 1]]
    below = 120  # the text
    assert (shots["draft"][below:] != shots["first"][below:]).any()
    np.testing.assert_array_equal(shots["fault"][below:], shots["as asked"][below:])


def test_what_cannot_be_shown_is_refused_at_the_start(folder, tmp_path):
    """A file in the folder's place, somebody else's watch.png, a look that cannot be read: exit 2, nothing written."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "watch.png").write_bytes(b"\x89PNG of another program")
    (tmp_path / "file").write_text("in the way")
    with mounted(tmp_path / "disk", "size=1m,ro"):
        watched = Watched(folder, "--out", str(tmp_path / "disk" / "out"))
        watched.process.communicate(timeout=WAIT_S)
    assert watched.process.returncode == 2, watched.lines
    assert "expected a folder that can be written to" in watched.log.read_text()
    for more, said in (
        (["--out", str(tmp_path / "out")], "that skinbake has not written"),
        (["--out", str(tmp_path / "file")], "expected a folder, got a file"),
        (["--set", "texture.siz=64"], "did you mean size?"),
    ):
        watched = Watched(folder, *more)
        watched.process.communicate(timeout=WAIT_S)
        assert watched.process.returncode == 2, watched.lines
        assert said in watched.log.read_text()
        assert "Traceback" not in watched.log.read_text()
    assert os.listdir(tmp_path / "out") == ["watch.png"]
