"""`output.layout: single` is the same bake in other files, for every verb that reads a bake."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

import skinbake
from skinbake.cli import run
from skinbake.io.bake_folder import read_bake_folder
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from tests.cli.test_faults import LOOK
from tests.shapes import relief

SINGLE = ["--set", "output.layout=single"]


def bake(folder, *more, code=0, out="single"):
    """Its picture aside; names of the files that it has written, by their times."""
    verb = ["bake", str(folder / "look.yaml"), "--no-preview", "--quiet", "--out", str(folder / out)]
    assert run([*verb, *more]) == code
    return {path.name: path.stat().st_mtime_ns for path in (folder / out).iterdir() if path.suffix in (".exr", ".tx")}


@pytest.fixture(scope="module")
def bakes(tmp_path_factory):
    """Folder with the same look in both layouts."""
    folder = tmp_path_factory.mktemp("layout")
    write_obj(folder / "mesh.obj", relief(segments=24))
    (folder / "look.yaml").write_text(LOOK)
    bake(folder, out="multipart")
    bake(folder, *SINGLE)
    return folder


def test_every_file_has_one_part_and_plain_channels(bakes):
    """Named after its light, and R, G, B first."""
    files = {path.name for path in (bakes / "single").glob("*.exr")}
    assert files == {
        f"{stem}{light}.exr" for stem in ("irradiance", "lobe_0", "lobe_1") for light in ("", ".key", ".lamp")
    }
    for name in files:
        source = oiio.ImageInput.open(str(bakes / "single" / name))
        assert source.spec().channelnames[:3] == ("R", "G", "B")
        assert not source.spec().get_string_attribute("name")
        assert not source.seek_subimage(1, 0)
    assert {path.name for path in (bakes / "single").glob("*.tx")} == {
        path.name for path in (bakes / "multipart").glob("*.tx")
    }


def test_readers_find_the_same(bakes, tmp_path, capsys):
    """Arrays, the preview's textures, a comparison either way, `diffuse`, exports, `info`."""
    one, other = (skinbake.open_bake(bakes / name) for name in ("multipart", "single"))
    for light in (None, *one.lights):
        np.testing.assert_array_equal(one.irradiance(light), other.irradiance(light))
        np.testing.assert_array_equal(one.lobe(1, light), other.lobe(1, light))
    read, again = (read_bake_folder(bakes / name).scene for name in ("multipart", "single"))
    np.testing.assert_array_equal(read.visibility[1001], again.visibility[1001])
    np.testing.assert_array_equal(read.lobes[0].rgb[1001], again.lobes[0].rgb[1001])
    for pair in (("multipart", "single"), ("single", "multipart")):
        assert run(["compare", *(str(bakes / name) for name in pair), "--absolute", "0", "--relative", "0"]) == 0
    assert "light.lamp" in capsys.readouterr().out
    verb = ["diffuse", str(bakes / "look.yaml"), "--quiet", "--out"]
    for name in ("multipart", "single"):
        assert run([*verb, str(tmp_path / f"{name} lobes"), str(bakes / name / "irradiance.exr")]) == 0
        assert (
            run(["export", str(bakes / name), "--to", str(tmp_path / name), "--sum", "--layers", "--gltf", "--quiet"])
            == 0
        )
        exported = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir() if path.name != "export.json"}
        assert exported == {name: (tmp_path / "multipart" / name).read_bytes() for name in exported}
    np.testing.assert_array_equal(
        *(skinbake.open_bake(tmp_path / f"{n} lobes").lobe(0) for n in ("multipart", "single"))
    )
    capsys.readouterr()
    assert run(["info", str(bakes / "single" / "lobe_0.exr"), "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == ["irradiance", "light.key", "light.lamp"]


def test_what_is_there_stays_and_what_is_gone_is_made(bakes):
    """A file of one light that is missing or cut is made again; another layout leaves no file of the first."""
    first = bake(bakes, *SINGLE)
    assert bake(bakes, *SINGLE) == first
    for name in ("lobe_1.lamp.exr", "irradiance.key.exr"):
        path = bakes / "single" / name
        whole = path.read_bytes()
        path.unlink()
        bake(bakes, *SINGLE)
        assert path.read_bytes() == whole
        path.write_bytes(whole[:-7])
        bake(bakes, *SINGLE)
        assert path.read_bytes() == whole
    lights = "lights=[{name: sun, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]"
    assert {name for name in bake(bakes, *SINGLE, "--set", lights) if name.endswith(".exr")} == {
        f"{stem}{light}.exr" for stem in ("irradiance", "lobe_0", "lobe_1") for light in ("", ".sun")
    }
    bake(bakes, out="single")
    assert {path.name for path in (bakes / "single").glob("*.exr")} == {"irradiance.exr", "lobe_0.exr", "lobe_1.exr"}
    assert not [name for name in read_manifest(bakes / "single")["bytes"] if name.endswith(".key.exr")]
    bake(bakes, *SINGLE)
    bake(bakes, out="single")  # the lights are there, and the files of the other layout go with this bake all the same
    assert {path.name for path in (bakes / "single").glob("*.exr")} == {"irradiance.exr", "lobe_0.exr", "lobe_1.exr"}
    bake(bakes, *SINGLE)


def test_a_missing_light_is_said(bakes, capsys):
    """By the name of its file, with exit code 2."""
    path = bakes / "single" / "lobe_0.key.exr"
    kept = path.read_bytes()
    path.unlink()
    assert run(["export", str(bakes / "single"), "--to", str(bakes / "x"), "--layers", "--quiet"]) == 2
    assert "lobe_0.key.exr: expected an EXR file, found none" in capsys.readouterr().err
    path.write_bytes(kept)
