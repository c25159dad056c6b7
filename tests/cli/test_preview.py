"""`skinbake preview` writes the pictures asked for, the same each time, and says what it cannot do."""

import cv2
import numpy as np
import pytest
import yaml

from skinbake.baking.warnings import EMPTY_PICTURE
from skinbake.cli import run
from skinbake.cli.preview import render_still
from skinbake.cli.preview_arguments import parse_lights, parse_size
from skinbake.errors import InputError
from skinbake.io.exr import read_parts
from skinbake.io.manifest import read_manifest
from skinbake.preview.setup_gl import renderer_name
from tests.preview.bakes import write_bake

pytestmark = pytest.mark.slow  # processes, waits, or many bakes


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    if renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    return write_bake(tmp_path_factory.mktemp("look"))


def picture(path):
    return cv2.imread(str(path))[..., ::-1].astype(int)


def test_without_a_display_the_still_of_the_look_is_written_into_the_bake(bake, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert run(["preview", str(bake)]) == 0
    assert picture(bake / "preview.png").shape == (80, 60, 3)
    assert str(bake / "preview.png") in capsys.readouterr().err


def test_the_same_bytes_again(bake, tmp_path):
    (first,) = render_still(bake, png=tmp_path / "a.png", exr=True)
    (second,) = render_still(bake, png=tmp_path / "b.png", exr=True)
    assert first.read_bytes() == second.read_bytes()
    assert first.with_suffix(".exr").read_bytes() == second.with_suffix(".exr").read_bytes()


def test_views_turntable_and_compare_name_their_files(bake, tmp_path):
    assert run(["preview", str(bake), "--out", str(tmp_path / "v"), "--views", "front,left", "--size", "32x40"]) == 0
    assert sorted(p.name for p in (tmp_path / "v").iterdir()) == ["preview_front.png", "preview_left.png"]
    assert run(["preview", str(bake), "--out", str(tmp_path / "o"), "--views", "left", "--size", "32x40"]) == 0
    assert [p.name for p in (tmp_path / "o").iterdir()] == ["preview_left.png"]
    assert run(["preview", str(bake), "--out", str(tmp_path / "t"), "--turntable", "3", "--size", "24"]) == 0
    film = ["--turntable", "3", "--size", "24", "--movie", str(tmp_path / "turn.gif")]
    before = sorted(bake.iterdir())
    assert run(["preview", str(bake), *film]) == 0
    assert (tmp_path / "turn.gif").read_bytes().startswith(b"GIF89a")
    assert sorted(bake.iterdir()) == before  # one file, no pictures beside it
    frames = sorted((tmp_path / "t").iterdir())
    assert [p.name for p in frames] == ["preview_0000.png", "preview_0001.png", "preview_0002.png"]
    assert np.abs(picture(frames[0]) - picture(frames[1])).max() > 10
    assert run(["preview", str(bake), "--png", str(tmp_path / "c.png"), "--compare", "--size", "40x30"]) == 0
    both = picture(tmp_path / "c.png")
    assert both.shape == (30, 80, 3)
    render_still(bake, png=tmp_path / "n.png", mode="none", size=(40, 30))
    render_still(bake, png=tmp_path / "f.png", size=(40, 30))
    np.testing.assert_array_equal(
        both, np.concatenate([picture(tmp_path / "n.png"), picture(tmp_path / "f.png")], axis=1)
    )


def test_another_skin_is_refitted_onto_the_lobes(bake, tmp_path, capsys):
    """It changes the picture, says how far its fit is off, and is refused by name where there is none."""
    own = tmp_path / "own.yaml"
    own.write_text("sigma_a_per_mm: 0.05\nsigma_sp_per_mm: [1, 2, 3]\n")
    (first,) = render_still(bake, png=tmp_path / "a.png", size=(40, 30))
    for name in ("jensen-skin1", str(own)):
        assert run(["preview", str(bake), "--png", str(tmp_path / "b.png"), "--size", "40x30", "--skin", name]) == 0
        assert np.abs(picture(first) - picture(tmp_path / "b.png")).max() > 2
        said = capsys.readouterr().err
        assert f"skin {name.rpartition('/')[2].removesuffix('.yaml')}: its fit on these lobes is off by" in said
        assert "bake again for this one" in said
    for name, got in (("nobody", "got nobody"), ("", "got nothing")):
        assert run(["preview", str(bake), "--png", str(tmp_path / "b.png"), "--skin", name]) == 2
        said = capsys.readouterr().err
        assert "expected a file, or one of donner-three-layer" in said
        assert got in said


def test_a_picture_without_the_head_is_warned_of(bake, tmp_path, capsys):
    """By the bake, also where its picture is as it was; by its stills; no longer once the camera sees it."""
    verb = ["bake", str(bake.parent / "look.yaml"), "--out", str(tmp_path / "b"), "--set", "diffusion.tolerance=1"]
    away = ["--set", "preview.camera={target_mm: [5000, 0, 0], distance_mm: 80}"]
    for _ in range(2):
        assert run([*verb, *away]) == 0
        assert capsys.readouterr().err.count(EMPTY_PICTURE) == 1
    assert read_manifest(tmp_path / "b")["warnings"].count(EMPTY_PICTURE) == 1
    assert run(["preview", str(tmp_path / "b"), "--png", str(tmp_path / "a.png")]) == 0
    assert EMPTY_PICTURE in capsys.readouterr().err
    assert run(verb) == 0
    assert EMPTY_PICTURE not in capsys.readouterr().err
    for camera in ("target_mm: [1e300, 0, 0], distance_mm: 80", "target_mm: [0, 0, 0], distance_mm: 1e6"):
        assert run([*verb, "--set", f"preview.camera={{{camera}}}"]) == 2
        assert "100000; got 1e+" in capsys.readouterr().err


def test_lights_scale_the_float_picture(bake, tmp_path):
    def linear(name, *options):
        assert run(["preview", str(bake), "--exr", "--size", "50x40", "--png", str(tmp_path / name), *options]) == 0
        return read_parts((tmp_path / name).with_suffix(".exr"))["preview"]

    off = linear("off.png", "--lights", "key=0,rim=0")
    one = linear("one.png", "--lights", "rim=0")
    two = linear("two.png", "--lights", "key=2/1/0,rim=0")
    assert off.rgb.max() == 0
    assert off.channels["A"].max() == 1
    np.testing.assert_allclose(two.rgb, one.rgb * [2, 1, 0], rtol=1e-6)


def test_exposure_brightens_the_skin_and_leaves_the_background(bake, tmp_path):
    render_still(bake, png=tmp_path / "a.png")
    render_still(bake, png=tmp_path / "b.png", exposure=1.0)
    dark, bright = picture(tmp_path / "a.png"), picture(tmp_path / "b.png")
    np.testing.assert_array_equal(dark[0, 0], bright[0, 0])
    assert (bright[40, 30] > dark[40, 30]).all()


@pytest.mark.parametrize(("precision", "own_thread"), [("half", True), ("float", True), ("half", False)])
def test_the_picture_of_a_bake_is_the_one_its_folder_gives(tmp_path, monkeypatch, precision, own_thread):
    """Drawn from memory while the files are written, or read from them afterwards: the same bytes."""
    if renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    monkeypatch.setattr("skinbake.baking.preview_worker.any_thread", lambda: own_thread)
    write_bake(tmp_path)
    key = "{name: key, type: directional, direction: [-1, -1, -1], irradiance: [3, 2, 1]}"
    lights = f"lights=[{key}, {{name: sky, type: environment, radiance: [0.1, 0.2, 0.3]}}]"
    options = ["--set", f"output.precision={precision}", "--set", lights, "--set", "diffusion.tolerance=1"]
    assert run(["bake", str(tmp_path / "look.yaml"), *options, "--quiet"]) == 0
    drawn = (tmp_path / "out" / "preview.png").read_bytes()
    assert picture(tmp_path / "out" / "preview.png").max() > 100
    assert run(["preview", str(tmp_path / "out"), "--png", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").read_bytes() == drawn


def test_without_opengl_everything_but_the_picture_is_there(tmp_path, monkeypatch, capsys):
    """The fault is told once, after the bake, with what to install."""
    write_bake(tmp_path)
    monkeypatch.setattr("skinbake.preview.platform._candidates", lambda chosen: [])
    options = ["--set", "diffusion.tolerance=1", "--force", "--quiet"]
    assert run(["bake", str(tmp_path / "look.yaml"), *options]) == 3
    assert capsys.readouterr().err.count("install Mesa's EGL") == 1
    assert (tmp_path / "out" / "bake.json").exists()
    assert (tmp_path / "out" / "lobe_0.exr").exists()
    assert not (tmp_path / "out" / "preview.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mode", "lobe:2"], "lobe:0 ... lobe:1, got lobe:2"),
        (["--views", "top"], "--views: expected front"),
        (["--lights", "kicker=1", "--exr"], "expected names among key, rim, got kicker"),
        (["--lights", "key"], "expected NAME=GAIN"),
        (["--lights", "key=-1", "--exr"], "each >= 0"),
        (["--size", "0x10"], "--size: expected WIDTHxHEIGHT"),
        (["--exposure", "nan"], "-100<=x<=100"),
        (["--exposure", "-2000"], "-100<=x<=100"),
        (["--png", "a.jpg"], "ends in .png"),
        (["--movie", "a.xyz"], "--movie a.xyz: expected a name that ends in .mp4 or .gif, got .xyz"),
        (["--quiet", "--verbose"], "expected --quiet or --verbose, got both"),
        (["--png", "a.png", "--views", "front,left"], "give --out DIR for several"),
    ],
)
def test_bad_options_are_refused_in_words(bake, monkeypatch, capsys, options, message):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert run(["preview", str(bake), *options]) == 2
    assert message in capsys.readouterr().err


def test_of_a_look_its_preview_is_as_it_stands(tmp_path, monkeypatch, capsys):
    """A camera that was edited is seen at once; a light that was edited is told to want another bake."""
    if renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    monkeypatch.delenv("DISPLAY", raising=False)
    folder, look = write_bake(tmp_path), tmp_path / "look.yaml"
    assert run(["preview", str(look), "--png", str(tmp_path / "before.png")]) == 0
    assert "warning" not in capsys.readouterr().err
    changed = yaml.safe_load(look.read_text())
    changed["preview"] = {"size": [50, 70], "view": "left"}
    look.write_text(yaml.safe_dump(changed))
    assert run(["preview", str(look), "--png", str(tmp_path / "after.png")]) == 0
    assert "warning" not in capsys.readouterr().err
    assert run(["preview", str(folder), "--png", str(tmp_path / "left.png"), "--views", "left", "--size", "50x70"]) == 0
    np.testing.assert_array_equal(picture(tmp_path / "after.png"), picture(tmp_path / "left.png"))
    changed["lights"][0]["irradiance"] = [1, 1, 1]
    changed["texture"]["size"] = 64
    look.write_text(yaml.safe_dump(changed))
    for verb in (
        ["preview", str(look), "--png", str(tmp_path / "a.png")],
        ["export", str(look), "--to", str(tmp_path)],
    ):
        run([*verb, *(["--sum"] if verb[0] == "export" else [])])
        assert "look.yaml: its bake is of another texture.size, lights; bake it again" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--views", "top"], "--views: expected front"),
        (["--lights", "kicker=1"], "expected names among key, rim, got kicker"),
        (["--mode", "lobe:2"], "lobe:0 ... lobe:1, got lobe:2"),
    ],
)
def test_names_that_there_are_not_are_refused_before_textures_are_read(tmp_path, capsys, options, message):
    folder = write_bake(tmp_path)
    (folder / "lobe_0.exr").unlink()
    assert run(["preview", str(folder), "--png", str(tmp_path / "a.png"), *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("verb", "name", "hint"),
    [
        (["preview", "--out"], "p.png", "; --png names one picture"),
        (["export", "--gltf", "--to"], "head.glb", ""),
    ],
)
def test_a_folder_does_not_get_a_files_name(tmp_path, capsys, verb, name, hint):
    """Unless there is one already."""
    there = str(tmp_path / name)
    assert run([*verb, there, str(tmp_path / "bake")]) == 2
    assert f"expected a folder, got a file's name, {there}{hint}" in capsys.readouterr().err
    (tmp_path / name).mkdir()
    assert run([*verb, there, str(tmp_path / "bake")]) == 2
    assert "expected a bake folder, found none" in capsys.readouterr().err


def test_a_folder_without_a_bake_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert run(["preview", str(tmp_path)]) == 2
    assert "bake.json" in capsys.readouterr().err


def test_options_are_read_as_people_write_them():
    assert parse_size("512") == (512, 512)
    assert parse_size("800x1000") == (800, 1000)
    assert parse_lights("key=1.5, rim=1/0.9/0.8") == {"key": [1.5] * 3, "rim": [1.0, 0.9, 0.8]}
    with pytest.raises(InputError):
        parse_size("12x13x14")
