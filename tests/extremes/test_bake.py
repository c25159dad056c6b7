"""Whole bakes at the edges, through the verbs: they end well, or in one message that names the fault."""

import json

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.exr import Part, read_parts, rgb_channels, write_parts
from skinbake.io.mesh import write_obj
from tests.shapes import relief

LOOK = """\
mesh: {path: bump.obj, unit: mm, any_size: true}
texture: {size: [24, 20], gutter: 2}
skin:
  variance_mm2: [0.05, 1.0, 20.0]
  weight_rgb: [[0.3, 0.3, 0.3], [0.3, 0.4, 0.5], [0.4, 0.3, 0.2]]
lights: [{name: key, type: directional, direction: [0.3, -0.2, -1], irradiance: [1, 0.8, 0.6]}]
diffusion: {probes: 100, tolerance: 0.2}
output: {dir: out}
"""


@pytest.fixture
def bake(tmp_path, capsys):
    """Bake with overrides; gives exit code, folder and what was said."""
    write_obj(tmp_path / "bump.obj", relief(segments=12))
    (tmp_path / "look.yaml").write_text(LOOK)

    def call(*overrides, verb="bake", more=()):
        options = [x for override in overrides for x in ("--set", override)]
        if verb == "bake":
            options += ["--no-preview", "--quiet"]
        code = run([verb, str(tmp_path / "look.yaml"), *options, *more])
        return code, tmp_path / "out", capsys.readouterr().err

    return call


def radiosity(folder):
    """M = sum of weighted lobes at their own sizes' means, and every value stored."""
    manifest = json.loads((folder / "bake.json").read_text())
    values = [
        np.concatenate([p.rgb.ravel() for p in read_parts(folder / lobe["file"]).values()])
        for lobe in manifest["lobes"]
    ]
    return manifest, np.concatenate(values)


@pytest.mark.parametrize(
    "overrides",
    [
        ["texture.size=1"],
        ["texture.size=[1, 17]"],
        ["texture.size=[33, 1]", "texture.gutter=0"],
        ["skin.variance_mm2=[1e-9, 1e-6, 1e-3]"],
        ["skin.variance_mm2=[1, 1e4, 1e5]"],
        ["lights.key.irradiance=[0, 0, 0]"],
        ["lights.key.irradiance=[1e-8, 1e-8, 1e-8]"],
        ["lights.key.irradiance=[1e5, 1e5, 1e5]"],
        ["lights.key.irradiance=[1e30, 1e30, 1e30]"],
        ["lights.key.direction=[0, 0, 1]"],
        ["lights.key.direction=[1, 0, 0]"],
        ["mesh={path: bump.obj, mm_per_unit: 1e-3, any_size: true}"],
        ["mesh={path: bump.obj, mm_per_unit: 1e4, any_size: true}"],
        ["specular.roughness=1e-4", "specular.f0=1", "specular.strength=10", "terms.energy_conservation=on"],
        ["maps.albedo_rgb=[0, 0, 0]"],
        ["texturing={mode: mix, mix: 0}"],
    ],
    ids=lambda overrides: overrides[0],
)
def test_ends_with_finite_values(bake, tmp_path, monkeypatch, overrides):
    """Exit 0 (or 1, where an error of one texel cannot meet the tolerance); everything stored is finite and >= 0."""
    monkeypatch.chdir(tmp_path)
    code, folder, said = bake(*overrides)
    assert code in (0, 1), said
    manifest, values = radiosity(folder)
    assert np.isfinite(values).all()
    assert (values >= 0).all()
    assert manifest["error"]["rms"] < 0.5


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["lights.key.irradiance=[1e39, 1, 1]"], "irradiance"),
        (["lights.key.irradiance=[.nan, 1, 1]"], "irradiance"),
        (["texture.size=0"], "texture.size"),
        (["skin.variance_mm2=[-1, 1, 2]"], "variance_mm2"),
        (["mesh.any_size=false", "mesh.unit=m"], "expected|measures"),
        (["specular.roughness=0"], "specular.roughness"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_is_refused_with_a_message(bake, overrides, message):
    """Exit 2 and one line that names the key or the file."""
    import re

    code, _, said = bake(*overrides)
    assert code == 2, said
    assert re.search(message, said)
    assert "Traceback" not in said


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_irradiance_that_is_no_light_is_refused_by_its_texel(bake, tmp_path, bad):
    """`diffuse` with an EXR that holds NaN, Inf or a negative value: part, channel, column and row are named."""
    light = np.ones((20, 24, 3), np.float32)
    path = tmp_path / "light.exr"
    write_parts(path, [Part("", rgb_channels(light))], precision="float")
    assert bake(verb="diffuse", more=[str(path), "--quiet"])[0] in (0, 1)
    import OpenImageIO as oiio

    light[3, 5, 1] = bad
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(24, 20, 3, oiio.FLOAT))
    out.write_image(light)
    out.close()
    code, _, said = bake(verb="diffuse", more=[str(path), "--quiet"])
    assert code == 2
    assert "channel G" in said
    assert "column 5, row 3" in said
