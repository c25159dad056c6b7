"""Lights that light nothing are told, each with the slip that makes it so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from skinbake.irradiance.unreached import unreached
from skinbake.scene.casters import OPAQUE, Casters
from skinbake.scene.lights import LightSpec
from tests.shapes import quad, sphere

HEAD = sphere(100.0, "latlong", 12)
FRONT = {"name": "k", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}
SPOT = {"name": "k", "type": "spot", "position_mm": [0, 0, 900], "intensity": [1e6, 1e6, 1e6], "axis": [0, 0, -1]}
SOFT = {"name": "k", "type": "rectangle", "position_mm": [0, 0, 400], "edge_u_mm": [-90, 0, 0], "edge_v_mm": [0, 90, 0],
        "radiance": [1, 1, 1]}  # fmt: skip
POINT = {"name": "k", "type": "point", "position_mm": [0, 0, 400], "intensity": [1e5, 1e5, 1e5]}
SKY = {"name": "k", "type": "environment", "radiance": [1, 1, 1]}


def told(*lights, mesh=HEAD, skies=None):
    """Sentences about lights given as their YAML."""
    return unreached([TypeAdapter(LightSpec).validate_python(light) for light in lights], mesh, (64, 64), skies or {})


@pytest.mark.parametrize("light", [FRONT, SPOT, SOFT, POINT, SKY])
def test_a_light_that_shines_on_the_head_is_not_told(light):
    """Of every type."""
    assert told(light) == []


@pytest.mark.parametrize(
    ("light", "said"),
    [
        (FRONT | {"irradiance": [0, 0, 0]}, "it is black"),
        (SKY | {"radiance": [0, 0, 0]}, "it is black"),
        (SKY | {"scale": 0}, "it is black"),
        (POINT | {"position_mm": [0, 0, 10]}, "all skin faces away from position_mm, .* inside the head"),
        (SPOT | {"axis": [0, 0, 1]}, "its cone passes by; axis is the way"),
        (SOFT | {"edge_u_mm": [90, 0, 0]}, r"it shines the other way, .* \[0, 0, 1\]; swap the two edges"),
    ],
)
def test_a_slip_is_told(light, said):
    """By name, with what to look at."""
    (sentence,) = told(light)
    assert sentence.startswith("light k: reaches no skin: ")
    assert __import__("re").search(said, sentence)


def test_a_mask_lit_from_behind():
    """An open mesh whose skin faces away."""
    (sentence,) = told(FRONT | {"direction": [0, 0, 1]}, mesh=quad())
    assert "all skin faces away; direction is where the light travels to" in sentence


def test_metres_for_millimetres():
    """A lamp at 40 cm given as 0.4: inside the head. One whose power is of metres beside a sun: next to nothing."""
    assert told(POINT | {"position_mm": [0, 0, 0.4]})
    sun = FRONT | {"name": "sun", "irradiance": [3, 3, 3]}
    (sentence,) = told(sun, POINT | {"intensity": [10, 10, 10]})
    assert "light k: reaches no skin: at most 4e-05 of the brightest light" in sentence


def test_what_stands_in_the_way_everywhere():
    """A wall between head and light; with `shadows: false` it is none, and a small one leaves some skin lit."""

    def behind(side_mm):
        wall = quad(side_mm, side_mm, 150.0)
        image = np.full(2, OPAQUE, np.int32)
        return replace(HEAD, casters=Casters(wall.positions_mm, wall.faces, wall.corner_uv, image))

    (sentence,) = told(FRONT, mesh=behind(900.0))
    assert "what casts shadows stands in its way everywhere" in sentence
    assert told(FRONT | {"shadows": False}, mesh=behind(900.0)) == []
    assert told(FRONT, mesh=behind(50.0)) == []
