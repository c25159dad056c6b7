"""maps.md names every key that there is, and its examples are understood."""

from __future__ import annotations

import re

import pytest

from skinbake.io.config import load_look
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.spec import (
    DetailMapSpec,
    FileMapSpec,
    HeightMapSpec,
    MapSpec,
    MapsSpec,
    NormalMapSpec,
    RoughnessMapSpec,
)
from tests.conftest import ROOT

TEXT = (ROOT / "skinbake" / "docs" / "maps.md").read_text()
LOOK = """\
mesh: {path: head.glb, unit: m}
skin: {preset: jensen-skin1}
output: {dir: out}
"""
LIGHTS = "lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]\n"
MODELS = (MapsSpec, FileMapSpec, MapSpec, RoughnessMapSpec, HeightMapSpec, NormalMapSpec, DetailMapSpec)


def test_every_key_is_described():
    """Of all maps and of skies; `samples` and what all lights share are elsewhere."""
    keys = {key for model in MODELS for key in model.model_fields}
    keys |= set(EnvironmentLight.model_fields) - {"name", "type", "shadows", "samples", "radiance"}
    assert not [key for key in sorted(keys) if not re.search(rf"\b{key}\b", TEXT)]


@pytest.mark.parametrize("yaml", re.findall(r"^```yaml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL))
def test_an_example_is_understood(tmp_path, yaml):
    """As a part of a look."""
    (tmp_path / "look.yaml").write_text(LOOK + yaml + ("" if yaml.startswith("lights") else LIGHTS))
    look = load_look(tmp_path / "look.yaml", files=False)
    assert look.maps != MapsSpec() or look.lights[0].type == "environment"
