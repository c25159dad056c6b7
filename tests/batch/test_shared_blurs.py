"""Looks of a batch that differ in their skin alone take each other's blurs where skin and light are near enough."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skinbake
from skinbake.baking.shared_blurs import share_blurs
from skinbake.cli import run
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from skinbake.profile.fit_onto import fit_onto
from tests.cli.test_batch import Here
from tests.shapes import relief

BATCH = """\
defaults:
  mesh: {path: mesh.obj, unit: mm, any_size: true}
  maps: {albedo_rgb: [0.8, 0.5, 0.4]}
  texture: {size: [40, 32], gutter: 2}
  lights:
    - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
    - {name: sky, type: environment, radiance: [0.3, 0.2, 0.1]}
  diffusion: {tolerance: 0.01, probes: 60}
  output: {dir: out, precision: float}
jobs:
  - {name: base, skin: {preset: jensen-skin1, eta: 1, fit: {gaussians: 8}}}
  - {name: near, skin: {preset: jensen-skin1, eta: 1, fit: {gaussians: 8}, sigma_a_per_mm: [0.03201, 0.17005, 0.48012]}}
  - {name: far, skin: {preset: jensen-skin2, eta: 1, fit: {gaussians: 8}}}
"""
NEAR = "skin={preset: jensen-skin1, eta: 1, fit: {gaussians: 8}, sigma_a_per_mm: [0.03201, 0.17005, 0.48012]}"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Jobs of batch.json by name, and the folder."""
    folder = tmp_path_factory.mktemp("shared")
    write_obj(folder / "mesh.obj", relief(60.0, 9.0, segments=12))
    (folder / "looks.yaml").write_text(BATCH)
    look = BATCH.partition("jobs:")[0].replace("defaults:\n", "").replace("\n  ", "\n").removeprefix("  ")
    (folder / "own.yaml").write_text(look)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skinbake.batch.batching.ProcessPool", Here)
        patch.setattr("skinbake.baking.session._LAST", {})
        patch.delenv("SKINBAKE_CACHE", raising=False)
        assert run(["batch", str(folder / "looks.yaml"), "--no-preview", "--quiet"]) == 0
        jobs = {job["name"]: job for job in json.loads((folder / "out" / "batch.json").read_text())["jobs"]}
    return jobs, folder


def test_a_near_skin_takes_every_blur(report):
    """With all terms on auto: not one blur is made anew, and the report says whose they are; a far one says why not."""
    jobs, folder = report
    assert jobs["base"]["blurs"] is None
    assert jobs["base"]["cache"]["misses"] > 20
    assert jobs["near"]["cache"]["misses"] == 0
    assert jobs["near"]["cache"]["hits"] > 20
    assert jobs["near"]["blurs"].startswith("blurs of base, fit 0.0")
    assert jobs["near"]["note"].endswith(jobs["near"]["blurs"])
    assert "on the Gaussians of base its fit is off by" in jobs["far"]["blurs"]
    assert "more than a tenth of the tolerance, 0.1 %" in jobs["far"]["blurs"]
    assert jobs["far"]["cache"]["misses"] > 20
    base, near, far = (skinbake.open_bake(folder / "out" / name) for name in ("base", "near", "far"))
    np.testing.assert_array_equal(near.variance_mm2, base.variance_mm2)
    assert not np.array_equal(near.weight_rgb, base.weight_rgb)
    assert not np.array_equal(far.variance_mm2, base.variance_mm2)


def test_its_light_is_that_of_a_bake_of_its_own(report, tmp_path):
    """Within a tenth of the tolerance."""
    _, folder = report
    own = skinbake.bake(load_look(folder / "own.yaml", [NEAR])).radiant_exitance()
    near = skinbake.open_bake(folder / "out" / "near").radiant_exitance()
    off = np.linalg.norm(near - own) / np.linalg.norm(own)
    assert 0 < off < 0.1 * 0.01


MEDIUM = "medium: {preset: jensen-"
OWN = "variance_mm2: [0.1, 2.0], weight_rgb: [[0.4, 0.5, 0.6], [0.6, 0.5, 0.4]]"


def test_given_gaussians_of_the_same_variances_are_kept_to_the_bit(report):
    """Other weights on them need no fit; without terms that read the medium it may be another."""
    _, folder = report
    other = OWN.replace("0.4, 0.5, 0.6", "0.6, 0.5, 0.4").replace("[0.6, 0.5, 0.4]]", "[0.4, 0.5, 0.6]]")
    off = ["terms.incidence=off", "terms.beam=off"]
    specs = [
        load_look(folder / "own.yaml", [f"skin={{{skin}, medium: {{preset: jensen-{name}}}}}", *off])
        for skin, name in ((OWN, "skin1"), (other, "apple"))
    ]
    found = share_blurs(specs[1], "base", specs[0])
    assert found.why == "blurs of base, fit 0 %"
    gaussians = fit_onto(specs[1].skin, found.base.gaussians.variance_mm2).gaussians
    np.testing.assert_array_equal(gaussians.weight_rgb, [[0.6, 0.5, 0.4], [0.4, 0.5, 0.6]])


@pytest.mark.parametrize(
    ("base", "other", "more", "why"),
    [
        ("preset: gpugems3-six-gaussians", "preset: donner-three-layer", "", "its fit is off by"),
        ("preset: jensen-skin1", "preset: jensen-skin1, normalise: none", "", "skin.normalise is another than of base"),
        ("preset: jensen-skin1", "preset: jensen-skin1, scatter: 0.5", "", "skin.scatter is another"),
        ("preset: jensen-skin1", "preset: jensen-skin1, fit: {gaussians: 4}", "", "skin.fit is another"),
        (OWN, OWN + ", medium: {preset: jensen-skin1}", "", "incidence: the skin says a medium, that of base none"),
        (f"{OWN}, {MEDIUM}skin1, eta: 1}}", f"{OWN}, {MEDIUM}apple, eta: 1}}", "", "incidence: slanted light comes"),
        (f"{OWN}, {MEDIUM}skin1}}", f"{OWN}, {MEDIUM}apple}}", "terms.incidence=off", "beam: free paths differ by"),
        (
            f"{OWN}, {MEDIUM}skin1}}",
            f"{OWN}, {MEDIUM}apple}}",
            "terms.incidence=off terms.beam=off terms.diffuse_profile=on",
            "diffuse_profile: lobes weigh otherwise by",
        ),
        (OWN, OWN, "relight={}", "relight has blurs of its own"),
    ],
)
def test_why_not(report, base, other, more, why):
    _, folder = report
    specs = [load_look(folder / "own.yaml", [f"skin={{{skin}}}", *more.split()]) for skin in (base, other)]
    found = share_blurs(specs[1], "base", specs[0])
    assert found.base is None
    assert why in found.why
