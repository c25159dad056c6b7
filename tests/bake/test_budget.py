"""What a bake says is left wrong holds: measured against one that leaves out almost nothing."""

from __future__ import annotations

import numpy as np
import pytest

import skinbake
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from tests.shapes import relief

pytestmark = pytest.mark.slow
TIGHT = 0.003
LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: 96, gutter: 4}
skin: {preset: gpugems3-six-gaussians}
lights: [%s]
output: {dir: out, precision: float}
diffusion: {probes: 2000}
"""
WIDE = "variance_mm2: [0.5, 4.0], weight_rgb: [[0.5, 0.6, 0.8], [0.5, 0.4, 0.2]]"
SUN = "{name: sun, type: directional, direction: [-0.6, -0.5, -0.6], irradiance: [3, 3, 3]}"
POINT = "{name: lamp, type: point, position_mm: [90, 60, 90], intensity: [30000, 30000, 20000]}"
SKY = "{name: sky, type: environment, radiance: [0.3, 0.4, 0.5]}"
BOX = (
    "{name: box, type: rectangle, position_mm: [-90, 30, 90], edge_u_mm: [60, 0, 30], edge_v_mm: [0, 50, 0], "
    "radiance: [2, 2, 2]}"
)


def leaving(path, *overrides):
    """Light leaving the skin, (H, W, 3), and the bake."""
    baked = skinbake.bake(load_look(path, overrides))
    return baked.radiant_exitance(), baked


@pytest.mark.parametrize("tolerance", [0.05, 0.02])
@pytest.mark.parametrize(
    ("lights", "skin"),
    [
        ([SKY], "skin.preset=gpugems3-six-gaussians"),
        ([POINT], "skin.preset=jensen-skin1"),
        ([SUN, POINT, SKY, BOX], "skin.preset=donner-three-layer"),
    ],
    ids=["sky", "point", "all"],
)
def test_the_whole_stays_within_the_tolerance(tmp_path, lights, skin, tolerance):
    """A hill that shades the plain and lights it, under lights of all kinds."""
    write_obj(tmp_path / "mesh.obj", relief(40.0, 14.0, 6.0, 32))
    (tmp_path / "look.yaml").write_text(LOOK % ", ".join(lights))
    got, baked = leaving(tmp_path / "look.yaml", skin, f"tolerance={tolerance}")
    want, _ = leaving(tmp_path / "look.yaml", skin, f"tolerance={TIGHT}")
    assert baked.left_wrong <= tolerance
    wrong = float(np.sqrt(np.mean((got - want) ** 2) / np.mean(want**2)))
    assert wrong <= tolerance
    assert wrong <= baked.left_wrong + TIGHT


def test_light_from_a_small_hill_is_looked_for_long_enough(tmp_path):
    """Few rays meet it: they leave more noise than coarse texels do, and would miss it from most of the plain."""
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    sun = "{name: sun, type: directional, direction: [0.4, -0.2, -1], irradiance: [1, 0.8, 0.6]}"
    text = (LOOK % sun).replace("size: 96", "size: [44, 36]").replace("preset: gpugems3-six-gaussians", WIDE)
    (tmp_path / "look.yaml").write_text(text + "terms: {interreflection: on}\n")
    want, _ = leaving(tmp_path / "look.yaml", "tolerance=0.0005", "diffusion.method=surface")
    for tolerance in (0.01, 0.005):
        got, baked = leaving(tmp_path / "look.yaml", f"tolerance={tolerance}")
        wrong = float(np.sqrt(np.mean((got - want) ** 2) / np.mean(want**2)))
        assert wrong <= tolerance
        assert wrong <= baked.left_wrong + 0.0005
