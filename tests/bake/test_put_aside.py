"""A bake whose arrays stand in temporary files and are let go all the time gives what one in memory gives."""

import numpy as np

import skinbake
from skinbake.cli import run
from skinbake.io import spool
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.shapes import sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
maps: {albedo: grey.png, melanin: {path: grey.png, scale: 0.2}}
texture: {size: [128, 96], gutter: 4}
skin: {model: physiology, melanin: 0.011, haemoglobin: 0.0055, fit: {gaussians: 4}}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
  - {name: sky, type: environment, radiance: [0.1, 0.2, 0.3]}
diffusion: {method: hybrid, probes: 100}
terms: {incidence: off, transmission: on}
output: {dir: out}
"""


def test_files_and_memory_give_the_same_bake(tmp_path, monkeypatch):
    """To the last bit: every array in a file, copied in pieces, and no more of them in memory than is read just now."""
    write_obj(tmp_path / "mesh.obj", sphere(30.0, "latlong", 24))
    write_png(tmp_path / "grey.png", np.linspace(90, 230, 48 * 64 * 3).reshape(48, 64, 3).astype(np.uint8))
    (tmp_path / "me.yaml").write_text(LOOK)
    ours = skinbake.bake(skinbake.load_look(tmp_path / "me.yaml"))
    monkeypatch.setattr(spool, "_SMALLEST", 1)
    monkeypatch.setattr(spool, "_AT_ONCE", 1 << 12)
    monkeypatch.setattr(spool, "MOST_READ", 0)
    assert run(["bake", str(tmp_path / "me.yaml"), "--no-preview", "--quiet"]) == 0
    theirs = skinbake.open_bake(tmp_path / "out")
    assert ours.plan == theirs.plan
    assert ours.error == theirs.error
    for light in ("key", "sky"):
        np.testing.assert_array_equal(ours.irradiance(light), theirs.irradiance(light))
        for lobe in range(4):
            np.testing.assert_array_equal(ours.lobe(lobe, light), theirs.lobe(lobe, light))
