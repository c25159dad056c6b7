"""The pages on maps and on meshes name every key that there is, and their examples are understood."""

from __future__ import annotations

import re

import pytest

from skinbake.io.config import load_look
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.map_files import (
    DetailMapSpec,
    FileMapSpec,
    HeightMapSpec,
    MapSpec,
    MapsSpec,
    NormalMapSpec,
    RoughnessMapSpec,
)
from skinbake.scene.mesh_files import MeshSpec, OccluderSpec
from tests.conftest import ROOT

PAGES = {name: (ROOT / "skinbake" / "docs" / f"{name}.md").read_text() for name in ("maps", "meshes")}
WHOLE = {
    "mesh": "mesh: {path: head.glb, unit: m}\n",
    "skin": "skin: {preset: jensen-skin1}\n",
    "lights": "lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]\n",
    "output": "output: {dir: out}\n",
}
KEYS = {
    "maps": (MapsSpec, FileMapSpec, MapSpec, RoughnessMapSpec, HeightMapSpec, NormalMapSpec, DetailMapSpec,
             EnvironmentLight),
    "meshes": (MeshSpec, OccluderSpec),
}  # fmt: skip
ELSEWHERE = {"name", "type", "shadows", "samples", "radiance"}  # what all lights share, and a sky of one colour


@pytest.mark.parametrize("page", PAGES)
def test_every_key_is_described(page):
    """Of all models that the page is about."""
    keys = {key for model in KEYS[page] for key in model.model_fields} - ELSEWHERE
    assert not [key for key in sorted(keys) if not re.search(rf"\b{key}\b", PAGES[page])]


@pytest.mark.parametrize(
    "yaml", [block for text in PAGES.values() for block in re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S)]
)
def test_an_example_is_understood(tmp_path, yaml):
    """As a part of a look, which names what it is about."""
    about = set(re.findall(r"^(\w+):", yaml, re.M))
    (tmp_path / "look.yaml").write_text("".join(of for key, of in WHOLE.items() if key not in about) + yaml)
    look = load_look(tmp_path / "look.yaml", files=False, first_frame=True)
    assert about - {"frames"} <= look.model_fields_set
