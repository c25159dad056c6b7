"""A bake of a ball with every map, for all exports."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.shapes import sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
maps: {albedo: albedo.png, normal: normal.png, roughness: rough.png}
texture: {size: [64, 48], gutter: 4}
skin: {model: gaussians, variance_mm2: [1.0e-9, 2.0e-9, 300.0],
  weight_rgb: [[0.2, 0.3, 0.4], [0.3, 0.3, 0.3], [0.5, 0.4, 0.3]]}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
  - {name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}
diffusion: {method: texture, tolerance: 0.9, probes: 50}
terms: {transmission: on}
output: {dir: out}
"""


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    """Folder of a bake of a ball with all maps."""
    folder = tmp_path_factory.mktemp("export")
    write_obj(folder / "mesh.obj", sphere(30.0, "latlong", 24))
    ramp = np.linspace(90, 230, 48 * 64 * 3).reshape(48, 64, 3).astype(np.uint8)
    write_png(folder / "albedo.png", ramp)
    write_png(folder / "normal.png", np.full((48, 64, 3), (140, 120, 250), np.uint8))
    write_png(folder / "rough.png", np.full((48, 64, 3), 64, np.uint8))
    (folder / "me.yaml").write_text(LOOK)
    assert run(["bake", str(folder / "me.yaml"), "--no-preview", "--quiet"]) == 0
    return folder / "out"
