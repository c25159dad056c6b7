"""`skinbake export`: what other programs read is what the bake holds, and nobody's file is lost."""

from __future__ import annotations

import json
import struct

import numpy as np
import OpenImageIO as oiio
import pytest
import trimesh

import skinbake
from skinbake.bilinear import magnify_bilinear
from skinbake.cli import run
from skinbake.errors import InputError
from skinbake.io.export_list import NAME, refuse_foreign
from skinbake.io.exr import read_parts
from skinbake.preview.tonemap import tonemap
from tests.shapes import sphere


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_layers_and_sum_are_what_the_bake_holds(bake, tmp_path):
    """One part a file, R G B in this order; the sum is M; the picture is M / pi, tone-mapped; the bake is untouched."""
    before = contents(bake)
    assert run(["export", str(bake), "--to", str(tmp_path / "x"), "--sum", "--layers", "--quiet"]) == 0
    assert contents(bake) == before
    baked = skinbake.open_bake(bake)
    lobes = range(len(baked.weight_rgb))
    images = {"irradiance": baked.irradiance(), "sum": baked.radiant_exitance()}
    images |= {f"irradiance.{light}": baked.irradiance(light) for light in baked.lights}
    names = [f"lobe_{i}" for i in lobes[:-1]] + ["transmission"]  # as the bake calls them
    images |= {names[i]: baked.lobe(i) for i in lobes}
    images |= {f"{names[i]}.{light}": baked.lobe(i, light) for i in lobes for light in baked.lights}
    assert {path.stem for path in (tmp_path / "x").glob("*.exr")} == set(images)
    for name, image in images.items():
        source = oiio.ImageInput.open(str(tmp_path / "x" / f"{name}.exr"))
        assert source.spec().channelnames == ("R", "G", "B")
        assert not source.seek_subimage(1, 0)
        np.testing.assert_allclose(source.read_image("float"), image, rtol=2**-11, atol=1e-7)
    m = images["sum"]
    total = sum(
        weight * magnify_bilinear(baked.lobe(i), m.shape[:2])
        for i, weight in enumerate(baked.weight_rgb.astype(np.float32))
    )
    np.testing.assert_allclose(m, total, rtol=1e-5, atol=1e-6)
    shown = oiio.ImageInput.open(str(tmp_path / "x" / "sum.png")).read_image("uint8")
    np.testing.assert_array_equal(shown, tonemap(m / np.float32(np.pi)))


def test_a_glb_holds_the_head_its_light_and_its_maps(bake, tmp_path):
    """In metres, v down, unlit; colours are the picture of M / pi, and normals and roughness the look's."""
    assert run(["export", str(bake), "--to", str(tmp_path), "--gltf", "--quiet"]) == 0
    (mesh,) = trimesh.load(tmp_path / "skin.glb").geometry.values()
    original = sphere(30.0, "latlong", 24)
    np.testing.assert_allclose(mesh.area, original.face_area_mm2.sum() * 1e-6, rtol=1e-5)
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), np.ptp(original.positions_mm, axis=0) / 1000, rtol=1e-6)
    m = skinbake.open_bake(bake).radiant_exitance()
    lit = m.any(axis=-1)
    picture = np.asarray(mesh.visual.material.baseColorTexture)[..., :3]
    np.testing.assert_array_equal(picture[lit], tonemap(m / np.float32(np.pi))[lit])
    assert picture[~lit].any(axis=-1).all()  # no black gutter for mip levels to mix in
    normal = np.asarray(mesh.visual.material.normalTexture)[..., :3].reshape(-1, 3)
    vector = np.array([140, 120, 250]) / 127.5 - 1
    np.testing.assert_allclose(
        normal, np.broadcast_to(127.5 + 127.5 * vector / np.linalg.norm(vector), normal.shape), atol=1
    )
    rough = np.asarray(mesh.visual.material.metallicRoughnessTexture)
    np.testing.assert_allclose(rough[..., 1], 255 * np.sqrt(64 / 255), atol=1)
    data = (tmp_path / "skin.glb").read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    assert document["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    assert document["asset"]["extras"]["skinbake"]["lights"] == ["key", "lamp"]
    position = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    np.testing.assert_allclose([position["min"], position["max"]], mesh.bounds, atol=1e-7)


def test_an_export_again_is_the_same_and_only_its_own_files_are_replaced(bake, tmp_path):
    """A file of that name that no export made is told and kept, and nothing is written beside it."""
    verb = ["export", str(bake), "--to", str(tmp_path / "x"), "--sum", "--gltf", "--quiet"]
    assert run(verb) == 0
    first = contents(tmp_path / "x")
    assert run(verb) == 0
    assert contents(tmp_path / "x") == first
    (tmp_path / "x" / "lobe_0.exr").write_bytes(b"mine")
    kept = contents(tmp_path / "x")
    assert run([*verb, "--layers"]) == 2
    assert contents(tmp_path / "x") == kept
    with pytest.raises(InputError, match=r"lobe_0\.exr: expected no file, or one of an earlier export"):
        refuse_foreign(tmp_path / "x", ["sum.exr", "lobe_0.exr"])
    (tmp_path / "x" / NAME).write_text("{damaged")
    with pytest.raises(InputError, match=r"sum\.exr: expected no file"):
        refuse_foreign(tmp_path / "x", ["sum.exr"])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--to", "x"], "expected one or more of --sum, --layers, --gltf, --blender and --web"),
        (["--to", "", "--sum"], "expected a path, got an empty text; is a variable not set?"),
        (["--to", "{bake}", "--sum"], "expected a folder of its own to export to, got one with a bake"),
        (["--to", "{bake}/bake.json", "--sum"], "expected a folder, got a file, "),
        (["--to", "x", "--sum", "nothing"], "nothing: expected a bake folder, found none; `skinbake bake CONFIG"),
    ],
)
def test_what_cannot_be_exported_is_said(bake, arguments, says, capsys, tmp_path, monkeypatch):
    """With exit code 2, before anything is written."""
    monkeypatch.chdir(tmp_path)
    before = contents(bake)
    source = [] if "nothing" in arguments else [str(bake)]
    assert run(["export", *source, *(a.replace("{bake}", str(bake)) for a in arguments)]) == 2
    assert says in capsys.readouterr().err
    assert contents(bake) == before
    assert not list(tmp_path.iterdir())


def test_a_bake_with_summed_lights_has_no_lobe_a_light(bake, tmp_path):
    """Irradiance is stored a light even then."""
    look = bake.parent / "me.yaml"
    assert (
        run(
            ["bake", str(look), "--set", "output.lights=total", "--out", str(tmp_path / "b"), "--no-preview", "--quiet"]
        )
        == 0
    )
    assert run(["export", str(tmp_path / "b"), "--to", str(tmp_path / "x"), "--layers", "--quiet"]) == 0
    names = {path.name for path in (tmp_path / "x").glob("*.exr")}
    assert {"irradiance.exr", "irradiance.key.exr", "lobe_0.exr", "lobe_1.exr"} <= names
    assert not [name for name in names if name.startswith("lobe_") and "key" in name]
    assert list(read_parts(tmp_path / "x" / "lobe_0.exr")) == [""]


def test_what_is_left_of_another_bake_goes(bake, tmp_path, capsys):
    """Exports of one bake add up, named by its folder, its manifest or its look; a changed one takes their place."""
    to = ["--to", str(tmp_path / "x"), "--quiet"]
    look = str(bake.parent / "me.yaml")
    assert run(["export", str(bake), *to, "--layers"]) == 0
    assert run(["export", str(bake / "bake.json"), *to, "--sum"]) == 0
    assert run(["export", look, *to, "--gltf"]) == 0
    assert {"lobe_0.exr", "sum.exr", "skin.glb"} <= set(contents(tmp_path / "x"))
    other = ["--set", "lights.key.irradiance=[3,2,1]", "--out", str(tmp_path / "b"), "--no-preview", "--quiet"]
    assert run(["bake", look, *other]) == 0
    capsys.readouterr()
    left = len(contents(tmp_path / "x")) - 3
    assert run(["export", str(tmp_path / "b"), *to[:2], "--sum"]) == 0
    assert f"removed {left} files of the earlier export of {bake}\n" in capsys.readouterr().err
    assert set(contents(tmp_path / "x")) == {"sum.exr", "sum.png", "export.json"}


def test_a_folder_of_bakes_names_them(bake, capsys):
    """A sequence or a batch is several bakes."""
    assert run(["export", str(bake.parent), "--to", "x", "--sum"]) == 2
    assert "expected one bake, got several: out ...; name one" in capsys.readouterr().err
