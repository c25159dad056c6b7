"""What a bake left is read as it was stored, and what is missing is named."""

import json
import shutil

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.bake_folder import read_bake_folder
from skinbake.io.exr import read_parts
from tests.preview.bakes import write_bake


def test_textures_keep_their_values_sizes_and_precision(tmp_path):
    out = write_bake(tmp_path)
    scene = read_bake_folder(out).scene
    assert [lobe.rgb[1001].shape for lobe in scene.lobes] == [(2, 32, 48, 3), (2, 16, 24, 3)]
    assert scene.lobes[0].rgb[1001].dtype == np.float16
    stored = read_parts(out / "lobe_1.exr")["light.rim"]
    np.testing.assert_array_equal(scene.lobes[1].rgb[1001][1], stored.rgb)
    seen = read_parts(out / "irradiance.exr")["light.key"].channels["visibility"]
    np.testing.assert_array_equal(scene.visibility[1001][0], seen)
    assert scene.lobes[1].weight_rgb == (0.6, 0.5, 0.3)
    assert [light.name for light in scene.lights] == ["key", "rim"]
    assert scene.maps.albedo[1001].shape == (16, 16, 3)
    assert scene.energy_conservation
    assert scene.separate


def test_summed_lights_have_one_layer(tmp_path):
    scene = read_bake_folder(write_bake(tmp_path, lights="total", precision="float", energy=False)).scene
    assert not scene.separate
    assert not scene.energy_conservation
    assert scene.lobes[0].rgb[1001].shape == (1, 32, 48, 3)
    assert scene.lobes[0].rgb[1001].dtype == np.float32
    assert scene.irradiance[1001].shape == (2, 32, 48, 3)


def test_only_the_sums_are_read_where_they_are_enough(tmp_path):
    """One layer a lobe, as it was stored; every light keeps its visibility."""
    out = write_bake(tmp_path)
    scene = read_bake_folder(out, summed=True).scene
    assert not scene.separate
    stored = read_parts(out / "lobe_1.exr", ["irradiance"])
    assert list(stored) == ["irradiance"]
    np.testing.assert_array_equal(scene.lobes[1].rgb[1001][0], stored["irradiance"].rgb)
    assert scene.visibility[1001].shape == (2, 32, 48)


def test_the_folder_its_manifest_and_a_moved_folder_are_the_same(tmp_path):
    out = write_bake(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    first, second = read_bake_folder(out / "bake.json"), read_bake_folder(tmp_path / "there" / "out")
    np.testing.assert_array_equal(first.scene.mesh.positions_mm, second.scene.mesh.positions_mm)
    assert second.spec.mesh.path == str(tmp_path / "there" / "ball.obj")


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match="skinbake bake CONFIG"):
        read_bake_folder(tmp_path / "nowhere")
    out = write_bake(tmp_path)
    (out / "lobe_1.exr").unlink()
    with pytest.raises(InputError, match=r"lobe_1\.exr: expected an EXR file"):
        read_bake_folder(out)
    out = write_bake(tmp_path)
    (out / "irradiance.exr").write_bytes((out / "lobe_0.exr").read_bytes())
    with pytest.raises(InputError, match=r"light\.key with channel visibility"):
        read_bake_folder(out)
    manifest = json.loads((out / "bake.json").read_text())
    (out / "bake.json").write_text(json.dumps(manifest | {"lights": ["key"]}))
    with pytest.raises(InputError, match="expected the lights of its look, key, rim, got"):
        read_bake_folder(out)
