"""`import skinbake`: the same arrays as the files hold, without one being written."""

from __future__ import annotations

import base64
import io
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import skinbake
from skinbake.bilinear import magnify_bilinear, read_bilinear
from skinbake.cli import run
from skinbake.errors import InputError
from skinbake.io.exr import read_parts
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from skinbake.preview.tonemap import tonemap
from tests.conftest import ROOT
from tests.shapes import sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
maps: {albedo: albedo.png}
texture: {size: [64, 48], gutter: 4}
skin: {model: gaussians, variance_mm2: [0.5, 300.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
  - {name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}
diffusion: {method: surface, tolerance: 0.5, probes: 50}
terms: {energy_conservation: off, transmission: on}
output: {dir: out}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A look beside its mesh and its albedo."""
    folder = tmp_path_factory.mktemp("api")
    write_obj(folder / "mesh.obj", sphere(30.0, "latlong", 24))
    colour = np.linspace(90, 230, 48 * 64 * 3).reshape(48, 64, 3)
    write_png(folder / "albedo.png", colour.astype(np.uint8))
    (folder / "me.yaml").write_text(LOOK)
    return folder


@pytest.fixture(scope="module")
def both(folder):
    """The look baked in memory, and by the command line into a folder, in post-scatter mode."""
    post = "texturing.mode=post-scatter"
    before = sorted(path.name for path in folder.iterdir())
    ours = skinbake.bake(skinbake.load_look(folder / "me.yaml", [post]))
    assert sorted(path.name for path in folder.iterdir()) == before
    assert run(["bake", str(folder / "me.yaml"), "--set", post, "--no-preview", "--quiet"]) == 0
    return ours, skinbake.open_bake(folder / "out")


def test_a_bake_in_memory_is_the_bake_on_the_disk(both):
    """To the last bit: light, lobes, M, error, plan."""
    ours, theirs = both
    assert ours.lights == theirs.lights == ("key", "lamp")
    assert ours.error == theirs.error
    assert ours.error.probes == 50
    assert ours.plan == theirs.plan
    np.testing.assert_array_equal(ours.weight_rgb, theirs.weight_rgb)
    np.testing.assert_array_equal(ours.variance_mm2, theirs.variance_mm2)
    for light in (None, "key", "lamp"):
        np.testing.assert_array_equal(ours.irradiance(light), theirs.irradiance(light))
        for i in range(3):
            np.testing.assert_array_equal(ours.lobe(i, light), theirs.lobe(i, light))
    for gains in (None, {"key": 2.0}, {"lamp": (0.1, 0.2, 0.3), "key": 0}):
        np.testing.assert_array_equal(ours.radiant_exitance(gains), theirs.radiant_exitance(gains))


def test_m_is_the_weighted_sum_of_what_a_gpu_reads(both, folder):
    """Of the EXR files, bilinear at every texel centre, light through thin parts included, times the albedo."""
    _, theirs = both
    entries = json.loads((folder / "out" / "bake.json").read_text())["lobes"]
    assert [entry["method"] for entry in entries][-1] == "transmission"
    assert any(entry["size"] != [64, 48] for entry in entries)
    row, col = np.mgrid[:48, :64]
    place = np.stack([(row.ravel() + 0.5) / 48, (col.ravel() + 0.5) / 64], axis=1)
    m = np.zeros((48 * 64, 3))
    for entry in entries:
        image = read_parts(folder / "out" / entry["file"])["irradiance"].rgb
        m += np.array(entry["weight_rgb"]) * read_bilinear(image[None], place)
    got = theirs.radiant_exitance()
    assert got.shape == (48, 64, 3)
    assert got.dtype == np.float32
    skin = read_parts(folder / "out" / "irradiance.exr")["irradiance"].channels["A"] == 1
    ratio = (got.reshape(-1, 3) / np.maximum(m, 1e-9)).reshape(48, 64, 3)[skin]
    albedo = ((np.linspace(90, 230, 48 * 64 * 3).astype(np.uint8) / 255.0 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(ratio, albedo.reshape(48, 64, 3)[skin], rtol=2e-4)


def test_gains_are_linear(both):
    """M of both lights is M of each alone; the total's own rounding to halves is all that differs."""
    ours, _ = both
    key, lamp = ours.radiant_exitance({"lamp": 0}), ours.radiant_exitance({"key": 0})
    np.testing.assert_allclose(ours.radiant_exitance({"key": 3, "lamp": 0.5}), 3 * key + 0.5 * lamp, rtol=1e-5)
    np.testing.assert_allclose(ours.radiant_exitance(), key + lamp, rtol=2e-3, atol=1e-6)
    np.testing.assert_array_equal(ours.radiant_exitance({"key": 1}), ours.radiant_exitance())


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda of: of.irradiance("moon"), "light: expected one of key, lamp, got moon"),
        (lambda of: of.radiant_exitance({"moon": 2}), "light: expected one of key, lamp, got moon"),
        (lambda of: of.lobe(3), "lobe: expected 0 to 2, got 3"),
        (lambda of: of.lobe(-1), "lobe: expected 0 to 2, got -1"),
        (lambda of: of.irradiance(tile=1002), "tile: expected one of 1001, got 1002"),
    ],
)
def test_what_is_not_there_is_named(both, ask, message):
    """Each with what there is."""
    for baked in both:
        with pytest.raises(InputError, match=message):
            ask(baked)


def test_summed_lights_have_no_gains(folder):
    """Their irradiance is still there light by light."""
    baked = skinbake.bake(skinbake.load_look(folder / "me.yaml", ["output.lights=total", "diffusion.method=texture"]))
    assert baked.irradiance("lamp").any()
    assert baked.radiant_exitance().any()
    with pytest.raises(InputError, match=r"this bake summed its lights; bake with output\.lights: separate"):
        baked.radiant_exitance({"key": 2})


def test_magnifying_is_bilinear_reading():
    """At any pair of sizes, also of one texel and of odd ones; the same size is the same image."""
    rng = np.random.default_rng(3)
    for (h, w), (height, width) in (((5, 3), (17, 13)), ((1, 1), (4, 2)), ((1, 6), (3, 6)), ((8, 4), (9, 5))):
        image = rng.random((h, w, 3), dtype=np.float32)
        row, col = np.mgrid[:height, :width]
        place = np.stack([(row.ravel() + 0.5) / height, (col.ravel() + 0.5) / width], axis=1)
        want = read_bilinear(image[None], place).reshape(height, width, 3)
        np.testing.assert_allclose(magnify_bilinear(image, (height, width)), want, atol=1e-6)
    assert magnify_bilinear(image, image.shape[:2]) is image


def test_the_ten_lines_of_the_readme_run(folder, monkeypatch, capsys):
    """As they stand there."""
    monkeypatch.chdir(folder)
    code = re.search(r"## From Python\n\n```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    found = {}
    exec(code, found)
    assert found["m"].shape == (512, 512, 3)
    assert "MeasuredError" in capsys.readouterr().out


def test_import_loads_nothing_heavy():
    """Names are there, and typed; what they need is imported when they are used."""
    code = "import sys, skinbake; assert 'open_bake' in dir(skinbake); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not set(loaded.split()) & {
        "numpy",
        "numba",
        "pydantic",
        "skinbake.api",
        "importlib.metadata",
        "typing_extensions",
    }
    assert (ROOT / "skinbake" / "py.typed").exists()
    assert skinbake.bake.__module__ == "skinbake.api.in_memory"
    with pytest.raises(AttributeError, match="has no attribute 'bakes'"):
        _ = skinbake.bakes


def test_a_notebook_shows_the_light_and_the_verdict(both):
    """A PNG of M / pi as the preview tone-maps it, and a sentence."""
    for baked in both:
        shown = baked._repr_html_()
        data = re.search(r'src="data:image/png;base64,([^"]+)"', shown)[1]
        picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
        np.testing.assert_array_equal(picture, tonemap(baked.radiant_exitance() / np.float32(np.pi)))
        assert (
            f"the blur is off by {baked.error.rms:.2%} rms, all that is left wrong by {baked.left_wrong:.2%}, within "
            "the tolerance of 50.00%; lights key, lamp" in shown
        )
