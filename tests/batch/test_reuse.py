"""Looks of a batch that differ in lights only are shown by one transfer, where its stated error allows it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

import skinbake
from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.relight import transfer
from tests.cli.test_batch import Here
from tests.relight.conftest import few_lights
from tests.shapes import relief

BATCH = """\
defaults:
  mesh: {path: mesh.obj, unit: mm, any_size: true}
  maps: {albedo_rgb: [0.8, 0.5, 0.4]}
  texture: {size: [30, 24], gutter: 2}
  skin: {model: gaussians, variance_mm2: [0.5, 30.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
  tolerance: 0.05
  diffusion: {method: surface, probes: 20}
  terms: {transmission: off, interreflection: off, energy_conservation: off}
  relight: reuse
  output: {dir: out, precision: float}
jobs:
  - {name: even, lights: [{name: sky, type: environment, radiance: [1, 2, 3], scale: 0.5}]}
  - {name: dim, lights: [{name: sky, type: environment, radiance: [0.1, 0.2, 0.3]}]}
  - {name: loose, tolerance: 0.06, lights: [{name: sky, type: environment, radiance: [1, 1, 1]}]}
  - {name: tight, tolerance: 0.02, lights: [{name: sky, type: environment, radiance: [1, 1, 1]}]}
  - {name: sun, lights: [{name: sun, type: directional, direction: [0, -1, -1], irradiance: [1, 2, 3]}]}
  - {name: lamp, lights: [{name: lamp, type: point, position_mm: [0, 20, 60], intensity: [900, 800, 700]}]}
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Jobs of batch.json by name, and the folder; suns are stated to be far off, skies to be near."""
    folder = tmp_path_factory.mktemp("reuse")
    write_obj(folder / "mesh.obj", relief(60.0, 9.0, segments=12))
    (folder / "looks.yaml").write_text(BATCH)
    judged, calls = transfer.judge_basis, []

    def stated(*args):
        calls.append(args)
        error = judged(*args)
        return error | {"skies": replace(error["skies"], worst=0.04), "suns": replace(error["suns"], worst=0.06)}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skinbake.batch.batching.ProcessPool", Here)
        patch.setattr("skinbake.baking.session._LAST", {})
        patch.delenv("SKINBAKE_CACHE", raising=False)
        patch.setattr(transfer, "unseen_lights", few_lights)
        patch.setattr(transfer, "judge_basis", stated)
        assert run(["batch", str(folder / "looks.yaml"), "--no-preview", "--quiet"]) == 0
        jobs = {job["name"]: job for job in json.loads((folder / "out" / "batch.json").read_text())["jobs"]}
    return jobs, folder, len(calls)


def line_of(folder, name):
    plan = json.loads((folder / "out" / name / "bake.json").read_text())["plan"]
    return next(line for line in plan if line["term"] == "relight.reuse")


def test_one_transfer_serves_all(report):
    """It is made once, kept in the cache alone; skies within their tolerance are shown by it, and the report tells."""
    jobs, folder, made = report
    assert made == 1
    assert not list((folder / "out").glob("*/relight*"))
    for name, limit in (("even", "4.58%"), ("dim", "4.58%"), ("loose", "5.66%")):
        assert line_of(folder, name)["kept"]
        assert jobs[name]["note"] == line_of(folder, name)["why"]
        assert (
            f"state errors of up to skies 4.00%, within {limit}, what their blur, off by up to 2.00%"
            in jobs[name]["note"]
        )
        manifest = json.loads((folder / "out" / name / "bake.json").read_text())
        assert [lobe["method"] for lobe in manifest["lobes"]] == ["relight"]


def test_what_it_does_not_know_well_enough_is_baked(report):
    """A sun above the tolerance, a lamp, which is near, and what textures are not made for are blurred as ever."""
    jobs, folder, _ = report
    assert "suns 6.00%, above 4.58%" in line_of(folder, "sun")["why"]
    assert "made for an error of 2.00% each, together above 2.00%" in line_of(folder, "tight")["why"]
    assert "light lamp is near" in line_of(folder, "lamp")["why"]
    for name in ("sun", "lamp", "tight"):
        assert not line_of(folder, name)["kept"]
        manifest = json.loads((folder / "out" / name / "bake.json").read_text())
        assert [lobe["method"] for lobe in manifest["lobes"]] == ["surface", "surface"]
        assert jobs[name]["note"].startswith("off by ")


def test_its_light_is_that_of_the_lights(report):
    """A sky half as bright has half of M, to the bake's own error; and it is that which a bake blurs."""
    _, folder, _ = report
    even, dim = (skinbake.open_bake(folder / "out" / name).radiant_exitance() for name in ("even", "dim"))
    np.testing.assert_allclose(5 * dim, even, rtol=1e-5, atol=1e-6)
    look = yaml.safe_load(BATCH)
    light = {"lights": look["jobs"][0]["lights"], "relight": None}
    (folder / "direct.yaml").write_text(yaml.safe_dump(look["defaults"] | light))
    exact = skinbake.bake(skinbake.load_look(folder / "direct.yaml")).radiant_exitance()
    skin = exact[..., 0] > 0
    assert np.linalg.norm(even[skin] - exact[skin]) < 0.03 * np.linalg.norm(exact[skin])
