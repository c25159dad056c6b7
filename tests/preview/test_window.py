"""The window shows what the headless picture shows, and its keys and mouse change it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.preview.display import display

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

ROOT = Path(__file__).parents[2]

DRIVE = """
import dataclasses, json, sys
import numpy as np
from pyglet.window import key, mouse
from skinbake.errors import InputError
from skinbake.preview.other_skin import OtherSkin, stored_variances
from skinbake.preview.tonemap import tonemap
from skinbake.preview.window import PreviewWindow, WindowActions
from skinbake.profile import GaussianSum
from skinbake.scene.output import PreviewSpec
from tests.preview.scenes import scene

def no_fit():
    raise InputError("it does not go")

said, shots, states = {}, {}, []
def write(state):
    states.append(state)
    return "written"
def save(pixels):
    shots["snapshot"] = pixels
    return "saved it"
shown = scene()
other = GaussianSum(stored_variances(shown), np.full((6, 3), 0.1), np.full(3, 0.05), np.ones(3))
skins = [OtherSkin("pale", lambda: other), OtherSkin("odd", no_fit)]
look = PreviewSpec(size=(260, 420), background_rgb=(0.05, 0.02, 0.1))
window = PreviewWindow(shown, look, skins=skins, actions=WindowActions(save, write))

def shoot(name):
    window.window.dispatch_events()
    shots[name] = window.pixels()
    said[name] = window.lines

def press(symbol):
    window.window.dispatch_event("on_key_press", symbol, 0)  # queued until dispatch_events

shoot("full")
linear = window.renderer.target.read()
over = linear[..., :3] + (1 - linear[..., 3:]) * np.array([0.05, 0.02, 0.1])
shots["numpy"] = tonemap(over)
for name, symbol in (("specular", key.S), ("diffuse", key.D), ("none", key.N), ("lobe", key._1), ("again", key.F)):
    press(symbol); shoot(name)
press(key.TAB); press(key.UP); shoot("brighter lamp")
press(key.L); shoot("lamp alone")
[press(key.PERIOD) for _ in range(8)]; shoot("moved")
press(key.H); shoot("help")
press(key.H); press(key.R); shoot("reset")
press(key.BRACKETRIGHT); shoot("exposed"); press(key.BRACKETLEFT)
window.window.dispatch_event("on_mouse_drag", 50, 50, 40, 10, mouse.LEFT, 0); shoot("orbit")
window.window.dispatch_event("on_mouse_drag", 50, 50, 40, 10, mouse.LEFT, key.MOD_SHIFT); shoot("pan")
window.window.dispatch_event("on_mouse_scroll", 50, 50, 0, 3); shoot("zoom")
press(key.K); shoot("other skin"); press(key.K); shoot("wrong skin"); press(key.K); shoot("own skin")
press(key.V); shoot("view")
press(key.P); shoot("saved")
press(key.W); press(key.UP); press(key.W); shoot("written")
said["gains"] = [[state.gains["key"], state.gains["lamp"]] for state in states]
said["view of state"] = [states[0].view, states[0].camera is None]
window.window.dispatch_event("on_mouse_drag", 50, 50, 40, 10, mouse.LEFT, 0)
window.window.dispatch_events()
said["view moved"] = [window.lines[0], window.state().camera is None]
press(key.R); press(key.S); shoot("before")
scales = []
from skinbake.preview.drag_quality import DragQuality
window.quality = DragQuality(3)
window.window.dispatch_event("on_mouse_drag", 50, 50, 0, 0, mouse.LEFT, 0)
window.window.dispatch_events(); window.frame(flip=False); scales.append(window.shown_scale)
window.window.dispatch_event("on_mouse_drag", 50, 50, 0, 0, mouse.LEFT, 0)
window.window.dispatch_events(); window.quality = DragQuality(3)
coarse = window._drawn(3, window.window.get_framebuffer_size())
scales.append([coarse.width, coarse.height])
shoot("after"); scales.append(window.shown_scale)
said["scales"] = scales
press(key.F); press(key.UP); window.window.dispatch_events()
again = scene()
brighter = again.lights[0].model_copy(update={"irradiance": (9, 9, 9)})
again = dataclasses.replace(again, lights=(brighter, *again.lights[1:]))
kept = window.controls.gains_rgb[1:].tolist()
window.set_scene(again, look); shoot("again in place")
said["gains of other"] = [window.controls.gains_rgb[0].tolist(), window.controls.gains_rgb[1:].tolist() == kept]
window.say("look.yaml:3: a fault"); shoot("fault")
press(key.Q)
window.run()
said["exit"] = window.window.has_exit
np.savez(sys.argv[1], **shots)
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    shots = tmp_path_factory.mktemp("window") / "shots.npz"
    with display() as environment:
        done = subprocess.run(
            [sys.executable, "-c", DRIVE, str(shots)], env=environment, cwd=ROOT, capture_output=True, text=True,
            timeout=120,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), dict(np.load(shots))


def differs(a, b, below=150):
    """Share of pixels more than 1 of 255 apart, below the text."""
    return (np.abs(a[below:].astype(int) - b[below:]) > 1).any(axis=-1).mean()


def test_the_screens_view_transform_is_tonemap_to_a_step_of_eight_bits(driven):
    _, shots = driven
    step = np.abs(shots["full"].astype(int) - shots["numpy"])[150:]  # below the text
    assert step.max() <= 1


def test_each_key_shows_its_part(driven):
    _, shots = driven
    for name in ("specular", "diffuse", "none", "lobe", "exposed", "orbit", "pan", "zoom", "view"):
        assert differs(shots["full"], shots[name]) > 0.05, name
    assert differs(shots["full"], shots["again"]) == 0
    assert differs(shots["full"], shots["reset"]) == 0


def test_lights_are_live(driven):
    said, shots = driven
    assert differs(shots["again"], shots["brighter lamp"]) > 0.02
    assert shots["lamp alone"][150:, :, :].astype(int).sum() < shots["brighter lamp"][150:].astype(int).sum()
    assert differs(shots["lamp alone"], shots["moved"]) > 0.001  # its specular moved with it
    assert any("lamp" in line and "stale" in line for line in said["moved"])
    assert not any("stale" in line for line in said["reset"])


def test_a_key_shows_another_skin_and_says_how_well_it_fits(driven):
    said, shots = driven
    assert differs(shots["zoom"], shots["other skin"], below=190) > 0.02
    assert said["other skin"][1] == "skin pale: its fit on these lobes is off by 5.00%; bake again for this one"
    assert said["wrong skin"][1] == "skin odd: it does not go"
    for name in ("wrong skin", "own skin"):
        assert differs(shots["zoom"], shots[name], below=190) == 0
    assert not any("skin" in line for line in said["own skin"])


def test_the_text_tells_frame_rate_and_help(driven):
    said, _ = driven
    assert "fps" in said["full"][0]
    assert any("orbit" in line for line in said["help"])
    assert said["exit"] is True


def test_the_view_is_named_and_moves_are_told(driven):
    """In the first line, and in what is written."""
    said, _ = driven
    assert said["full"][0].startswith("three-quarter   everything")
    assert said["orbit"][0].startswith("three-quarter, moved   ")
    assert said["view"][0].startswith("three-quarter-right   ")
    assert said["view of state"] == ["three-quarter-right", True]
    assert said["view moved"][0].startswith("three-quarter-right, moved   ")
    assert said["view moved"][1] is False


def test_keys_save_the_picture_and_write_the_look(driven):
    """The picture is the frame without its text; gains are those since the look was last written."""
    said, shots = driven
    assert said["saved"][-1] == "saved it"
    assert said["written"][-1] == "written"
    assert np.abs(shots["snapshot"].astype(int) - shots["saved"])[250:].max() <= 1
    first, second = said["gains"]
    assert first == [[1, 1, 1], [1, 1, 1]]
    assert second == [[2**0.25] * 3, [1, 1, 1]]


def test_frames_are_coarse_while_the_mouse_moves(driven):
    """Fewer points, over the whole window; then the fine frame, the same as before."""
    said, shots = driven
    assert said["scales"] == [3, [260 // 3, 420 // 3], 1]
    assert differs(shots["before"], shots["after"]) == 0


def test_another_bake_is_shown_in_place(driven):
    """A light that was changed in the look loses its gain, the others keep theirs; a fault is told in the window."""
    said, _ = driven
    assert said["gains of other"] == [[1, 1, 1], True]
    assert said["fault"][-1] == "look.yaml:3: a fault"
