"""Keys change what they say, and a moved light is called stale until it is back."""

import numpy as np
import pytest

from skinbake.preview.controls import Controls, overlay, press, turned_light
from skinbake.preview.mode import Mode
from tests.preview.scenes import LIGHTS, scene

SCENE = scene(with_maps=False)
START = Controls(LIGHTS, tuple(np.ones(3) for _ in LIGHTS))


def after(*keys):
    controls = START
    for key in keys:
        controls = press(controls, START, SCENE, key)
    return controls


def test_modes_and_lobes():
    assert after("S").mode == Mode("specular")
    assert after("N", "6").mode == Mode("lobe", 5)
    assert after("D", "7").mode == Mode("diffuse")  # there are six
    assert "lobe 3 of 6, sigma 0.30 mm" in overlay(after("3"), SCENE, 30.0)[0]


def test_gains_act_on_the_selected_light_and_solo_silences_the_others():
    controls = after("TAB", "UP", "UP", "UP", "UP")
    np.testing.assert_allclose(controls.gains_rgb[:, 0], [1, 2, 1, 1, 1])
    alone = press(controls, START, SCENE, "L")
    np.testing.assert_allclose(alone.gains_rgb[:, 0], [0, 2, 0, 0, 0])
    assert after("UP", "DOWN").gains_rgb == pytest.approx(START.gains_rgb)


def test_a_moved_light_is_stale_in_the_text_until_it_is_back():
    text = "\n".join(overlay(after("TAB", "."), SCENE, 30.0))
    assert "lamp  x 1.00  MOVED: its diffuse part is stale, bake again" in text
    assert text.count("stale") == 1
    assert not after("TAB", ".", ",").moved
    assert not after(*["."] * 72).moved  # once around
    assert not after("TAB", "TAB", "TAB", "TAB", ".").moved  # an environment does not move


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.name)
def test_turning_carries_a_light_round_the_axis(light):
    there = turned_light(light, 90.0, np.array([0.0, 5.0, 0.0]))
    back = turned_light(there, -90.0, np.array([0.0, 5.0, 0.0]))
    for name in ("direction", "position_mm", "axis", "edge_u_mm", "edge_v_mm"):
        if hasattr(light, name):
            x, y, z = getattr(light, name)
            np.testing.assert_allclose(getattr(there, name), [z, y, -x], atol=1e-9)
            np.testing.assert_allclose(getattr(back, name), [x, y, z], atol=1e-9)


def test_reset_brings_everything_back_but_the_help():
    assert after("H", "N", "]", "]", "TAB", "UP", ".", "L", "R") == after("H")
    assert any("this help" in line for line in overlay(after("H"), SCENE, 1.0))


def test_a_key_without_a_meaning_changes_nothing():
    assert after("F12") is START
