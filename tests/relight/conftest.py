"""A small head and looks of it that are lit later."""

from __future__ import annotations

import pytest

import skinbake
from skinbake.io.mesh import write_obj
from skinbake.relight import transfer, unseen_lights
from tests.shapes import joined, relief, sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
maps: {albedo_rgb: [0.8, 0.5, 0.4]}
texture: {size: [60, 48], gutter: 4}
skin: {model: gaussians, variance_mm2: [0.5, 30.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
relight: {textures: 16, basis: harmonics}
lights: []
diffusion: {method: surface, tolerance: 0.02, probes: 0}
specular: {strength: 0}
terms: {transmission: off, interreflection: off}
output: {dir: out, precision: float}
"""


def few_lights(seed):
    """Three suns, a sky and a soft box in place of 96 lights."""
    every = unseen_lights.unseen_lights(seed)
    return (every[0], every[16], *every[32:35])


@pytest.fixture(scope="session")
def baked(tmp_path_factory):
    """Bakes looks that are `LOOK` with changes, in memory; judged by few lights."""
    folder = tmp_path_factory.mktemp("relight")
    write_obj(folder / "ball.obj", sphere(30.0, "cube", 48))
    write_obj(folder / "tiles.obj", sphere(30.0, "latlong", 24, tiles=2))
    write_obj(folder / "mesh.obj", joined(relief(60.0, 18.0, segments=24)))
    (folder / "look.yaml").write_text(LOOK)
    made = {}

    def bake(*changes):
        if changes not in made:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(transfer, "unseen_lights", few_lights)
                made[changes] = skinbake.bake(skinbake.load_look(folder / "look.yaml", list(changes)))
        return made[changes]

    bake.folder = folder
    return bake
