"""irradiance.exr, read again after somebody changed its header."""

import json

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.irradiance import plan_text, read_irradiance
from skinbake.scene.decision import Decision

PLAN = plan_text((Decision("sky", True, "64 directions"),))
DAMAGES = ["{" + PLAN[1:], "[1]", '[{"term": "sky"}]', "null", '"text"', json.dumps([{"other": 1}]), "[" * 100_000]


def write(path, plan):
    rgb = rgb_channels(np.ones((3, 5, 3), np.float32))
    write_parts(path, [Part("irradiance", rgb), Part("light.sky", rgb, {"skinbake:plan": plan})])


def test_a_plan_comes_back(tmp_path):
    """As it was told when the light was traced."""
    write(tmp_path / "irradiance.exr", PLAN)
    assert read_irradiance(tmp_path / "irradiance.exr", 1001).plan["sky"][0].why == "64 directions"


@pytest.mark.parametrize("plan", DAMAGES, ids=lambda plan: plan[:20])
def test_a_damaged_plan_is_told(tmp_path, plan):
    """Who takes the file up again then traces the light anew."""
    write(tmp_path / "irradiance.exr", plan)
    with pytest.raises(InputError, match=r"irradiance\.exr: part light\.sky, skinbake:plan: expected a plan, got"):
        read_irradiance(tmp_path / "irradiance.exr", 1001)
