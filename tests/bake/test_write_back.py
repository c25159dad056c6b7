"""What is set in the window is written into the look: values change, comments stay, the look says what was shown."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.baking.window_actions import save_snapshot
from skinbake.baking.write_back import write_back
from skinbake.errors import InputError
from skinbake.io.config import load_look
from skinbake.io.image import read_map
from skinbake.preview.camera import Camera, camera_of
from skinbake.preview.controls import turned_light
from skinbake.preview.window_state import WindowState
from tests.shapes import quad

LOOK = """\
# the look
mesh: {path: head.obj, unit: mm}
skin: {model: burley, d_mm: [1, 1, 1]}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [3, 2, 1]}   # warm
  - name: lamp        # cold
    type: point
    position_mm: [10, 0, 300]
    intensity: [100, 200, 300]
  - {name: sky, type: environment, path: sky.exr}
output: {dir: out}
"""
ONES = {name: (1.0, 1.0, 1.0) for name in ("key", "lamp", "sky")}
STATE = WindowState(ONES, {}, "three-quarter", None, 0.0)


@pytest.fixture
def look(tmp_path, monkeypatch):
    """A look in the folder one is in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "look.yaml").write_text(LOOK)
    return tmp_path / "look.yaml"


def test_gains_are_in_the_lights_and_comments_stay(look):
    """Each by the key that says how bright it is; what is not changed keeps its letters."""
    gains = {"key": (2.0, 2.0, 2.0), "lamp": (0.5, 1.0, 1.0), "sky": (1.5, 1.5, 1.5)}
    said = write_back(look, replace(STATE, gains=gains))
    assert said == "written to look.yaml: key.irradiance, lamp.intensity, sky.scale"
    text = look.read_text()
    assert "irradiance: [6, 4, 2]}   # warm\n" in text
    assert "  - name: lamp        # cold\n" in text
    assert "    intensity: [50, 200, 300]\n" in text
    assert "path: sky.exr, scale: 1.5}" in text
    assert write_back(look, STATE) == "look.yaml says so already"
    assert look.read_text() == text


def test_a_camera_comes_back_as_it_stood(look):
    """To four digits; a named view takes it away again."""
    camera = Camera(np.array([1.25, -3.5, 20.0]), 431.7, 23.4, -5.0)
    write_back(look, replace(STATE, view="nose", camera=camera, exposure=0.5))
    read = load_look(look, files=False).preview
    assert (read.view, read.exposure) == ("nose", 0.5)
    again = camera_of(quad(), read, 1.0)
    np.testing.assert_allclose(again.pose, camera.pose, atol=1e-9)
    write_back(look, replace(STATE, view="nose", exposure=0.5))
    assert load_look(look, files=False).preview.camera is None
    assert look.read_text().startswith("# the look\n")


def test_a_moved_light_is_where_it_was_carried(look):
    """Whatever says its place."""
    spec = load_look(look, files=False)
    moved = {light.name: turned_light(light, 90.0, np.zeros(3)) for light in spec.lights[:2]}
    write_back(look, replace(STATE, moved=moved))
    lights = load_look(look, files=False).lights
    np.testing.assert_allclose(lights[0].direction, [-1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(lights[1].position_mm, [300, 0, -10], atol=1e-9)


def test_what_a_file_cannot_say_is_refused(look):
    """A coloured gain of a picture, a light that is gone: the file stays as it is."""
    for state, said in (
        (replace(STATE, gains=ONES | {"sky": (1, 2, 3)}), "its picture has one scale for all colours"),
        (replace(STATE, gains=ONES | {"rim": (2, 2, 2)}), "expected rim, found none of that name"),
    ):
        with pytest.raises(InputError, match=said):
            write_back(look, state)
    assert look.read_text() == LOOK


def test_snapshots_are_numbered(look):
    """None is written over."""
    pixels = np.full((4, 5, 3), 128, np.uint8)
    assert [save_snapshot(look.parent, pixels) for _ in range(2)] == [
        "saved snapshot_0001.png", "saved snapshot_0002.png",
    ]  # fmt: skip
    assert read_map(look.parent / "snapshot_0002.png", 3).shape == (4, 5, 3)
