"""Baked small scenes against the EXRs in ref/. `make golden-update` writes them anew: look before committing."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from skinbake.compare import compare
from skinbake.io.exr import Part, write_parts
from skinbake.io.mesh import write_obj
from skinbake.io.pictures import false_colour_sheet, images_of
from tests.conftest import ROOT
from tests.shapes import relief, sphere
from tests.tolerances import PREVIEW, SAME_CODE, SHADOW_EDGES

HERE = Path(__file__).parent
FAILURES = ROOT / "tests" / "failures"
MESHES = {"nose": relief, "globe": lambda: sphere(30.0, "cube", 48)}
FILES = {
    "irradiance.exr": SHADOW_EDGES,
    "lobe_1.exr": SAME_CODE,
    "lobe_3.exr": SAME_CODE,
    "preview.exr": PREVIEW,
}


@pytest.fixture(scope="module", params=MESHES)
def baked(request, tmp_path_factory):
    """The case's name and its bake folder, with a float preview in it."""
    from skinbake.cli import run

    folder = tmp_path_factory.mktemp(request.param)
    config = shutil.copy(HERE / request.param / "config.yaml", folder)
    write_obj(folder / "mesh.obj", MESHES[request.param]())
    assert run(["bake", str(config), "--quiet", "--no-preview"]) == 0
    assert run(["preview", str(folder / "out"), "--png", str(folder / "out" / "preview.png"), "--exr", "--quiet"]) == 0
    return request.param, folder / "out"


@pytest.mark.parametrize("file", FILES)
def test_bake_matches_its_golden_image(baked, file, request):
    """The same scene gives the same light as when somebody last looked at it."""
    case, out = baked
    golden = HERE / case / "ref" / file
    if request.config.getoption("--golden-update"):
        golden.parent.mkdir(exist_ok=True)
        shutil.copy(out / file, golden)
        return
    ours, theirs = images_of(out / file), images_of(golden)
    assert list(ours) == list(theirs)
    for name in ours:
        found = compare(ours[name], theirs[name], FILES[file])
        if not found.same:
            left = leave_for_the_reader(case, file, name, ours[name], theirs[name], out, golden)
            pytest.fail(
                f"{case}/{file}, part {name}: {found.why}; rms {found.rms:.3g}; image, reference, difference: {left}"
            )


def leave_for_the_reader(case, file, name, image, reference, out, golden) -> Path:
    """Both files, their difference as EXR, and all three as a picture, under tests/failures."""
    folder = FAILURES / case
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(out / file, folder / file)
    shutil.copy(golden, folder / f"golden_{file}")
    if image.shape == reference.shape:
        difference = np.nan_to_num(np.abs(image - reference), nan=1e30, posinf=1e30)
        channels = {f"c{i}": np.ascontiguousarray(difference[..., i]) for i in range(difference.shape[-1])}
        write_parts(folder / f"difference_{file}", [Part(name or "image", channels)], precision="float")
        false_colour_sheet(folder / f"{Path(file).stem}.png", {name: (image, reference)})
    return folder


def test_a_golden_image_that_differs_is_caught(tmp_path):
    """The harness can fail: one NaN, or one texel off by more than its limit, is not the same image."""
    image = np.full((8, 9, 3), 0.5, np.float32)
    write_parts(tmp_path / "a.exr", [Part("irradiance", {c: image[..., i] for i, c in enumerate("RGB")})])
    read = images_of(tmp_path / "a.exr")["irradiance"]
    for value in (np.nan, 0.6):
        broken = read.copy()
        broken[3, 4, 1] = value
        assert not compare(broken, read, SAME_CODE).same
        assert not compare(read, broken, SAME_CODE).same
    assert compare(read, read, SAME_CODE).same
