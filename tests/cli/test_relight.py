"""A look for lights that come later: what its bake writes, and what the preview makes of it."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest
from PIL import Image

import skinbake
from skinbake.cli import run
from skinbake.cli.preview_arguments import parse_sun
from skinbake.errors import InputError
from skinbake.io.exr import read_parts
from skinbake.io.mesh import write_obj
from skinbake.relight import transfer
from tests.relight.conftest import LOOK, few_lights
from tests.shapes import relief


@pytest.fixture(scope="module")
def look(tmp_path_factory):
    """A look beside its mesh, baked by the command line."""
    folder = tmp_path_factory.mktemp("later")
    write_obj(folder / "mesh.obj", relief(60.0, 18.0, segments=12))
    (folder / "me.yaml").write_text(LOOK.replace("size: [60, 48]", "size: [30, 24]").replace("float", "half"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "unseen_lights", few_lights)
        assert run(["bake", str(folder / "me.yaml"), "--quiet"]) == 0
    return folder / "me.yaml"


def test_the_folder_says_what_it_is(look):
    """Textures by part, the projection and the errors in relight.json, no lobes; and nothing is stale."""
    folder = look.parent / "out"
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["bake.json", "profile.csv", "profile.json", "profile.png", "relight.exr", "relight.json",
                     "relight.visibility.exr"]  # fmt: skip
    manifest, use = (json.loads((folder / name).read_text()) for name in ("bake.json", "relight.json"))
    assert manifest["lobes"] == manifest["lights"] == manifest["irradiance"] == []
    assert manifest["relight"]["rms"] == {kind: error["rms"] for kind, error in use["error"].items()}
    assert list(read_parts(folder / "relight.exr")) == [f"basis.{k:02d}" for k in range(use["textures"])]
    assert set(use["error"]) == {"skies", "soft_boxes", "suns"}
    assert use["error"]["suns"]["worst_light"]["direction"]
    assert np.array(use["of_harmonics"]).shape == (use["textures"], (use["order"] + 1) ** 2)


def test_the_same_bytes_on_one_thread(look, tmp_path, monkeypatch):
    """A fresh bake on another number of threads writes the same files."""
    monkeypatch.setattr(transfer, "unseen_lights", few_lights)
    for threads in ("1", "3"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        fitted = ["--set", "relight.basis=fitted", "--set", "relight.textures=9"]
        assert run(["bake", str(look), "--out", str(tmp_path / threads), "--quiet", *fitted]) == 0
    for name in ("relight.exr", "relight.visibility.exr", "relight.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "3" / name).read_bytes()


def test_a_second_bake_has_nothing_to_do(look, capsys):
    """What is there stays; a look without `relight` takes the files away."""
    assert run(["bake", str(look)]) == 0
    assert re.search("light from everywhere +as it was", capsys.readouterr().err)
    other = look.parent / "copy"
    shutil.copytree(look.parent / "out", other)
    light = "lights=[{name: sky, type: environment, radiance: [1, 1, 1]}]"
    plain = ["--set", "relight=null", "--set", light, "--out", str(other), "--no-preview", "--quiet"]
    assert run(["bake", str(look), *plain]) == 0
    assert not list(other.glob("relight*"))


@pytest.mark.parametrize(
    "verb", [["irradiance"], ["tradeoff"], ["truth"], ["diffuse", "IRRADIANCE"]], ids=lambda v: v[0]
)
def test_verbs_of_lights_say_that_there_are_none(look, capsys, verb):
    """Each names what it expects, and ends as after bad input."""
    name, *others = verb
    assert run([name, str(look), *others]) == 2
    assert "lights: expected at least one" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "give --environment or --sun"),
        (["--environment", "nowhere.exr"], "nowhere.exr"),
        (["--environment", ""], "--environment: expected a file, studio or sunset, got an empty text"),
        (["--sun", "0,0,0=1/1/1"], "--sun 0,0,0=1/1/1: expected a direction in which its light travels"),
        (["--sun", "0,0,1"], "--sun 0,0,1: expected its irradiance, too, as in 0,0,1=3/3/2.8"),
        (["--sun", "0,0,1=-1"], "--sun 0,0,1=-1: expected X,Y,Z=R/G/B"),
        (["--rotate", "10"], "--rotate 10: expected --environment or --sun beside it"),
        (["--turn", "light"], "--turn light: expected --environment or --sun beside it"),
        (["--environment", "studio", "--turn", "light"], "--turn light: expected --turntable N beside it"),
        (["--environment", "studio", "--compare"], "expected neither --lights"),
    ],
)
def test_what_cannot_be_shown_is_refused(look, capsys, options, message):
    """In words, with exit code 2."""
    assert run(["preview", str(look.parent / "out"), "--out", str(look.parent / "p"), *options]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("lights=[]", "expected at least one light, or relight"),
        ("relight={size: 4096}", "expected a size of at most that of the texture, 30"),
        ("relight={textures: 100}", "relight.textures"),
        ("relight=always", "expected a mapping, or reuse, got always"),
        ("terms.beam=on", "expected terms.beam: auto or off beside relight"),
        ("terms.diffuse_profile=on", "expected terms.diffuse_profile: auto or off beside relight"),
    ],
)
def test_looks_that_contradict_themselves_are_refused(look, capsys, change, message):
    """By key, with exit code 2."""
    changes = ["--set", change] + (["--set", "relight=null"] if change == "lights=[]" else [])
    assert run(["bake", str(look), *changes]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert message in said
    assert "at least one light" not in said.replace(message, "")


def test_check_tells_of_the_textures(look, capsys):
    """How many and how large, and no size of files that are not written."""
    assert run(["check", str(look)]) == 0
    said = capsys.readouterr().out
    assert "relight: up to 16 textures of 30 x 24 for any sky and any sun" in said
    (expected,) = [line for line in said.splitlines() if line.startswith("expected")]
    assert re.search(r"on two cores, relight [\d.]+ MiB$", expected)
    assert run(["check", str(look), "--json"]) == 0
    cost = json.loads(capsys.readouterr().out)["expected"]
    assert cost["irradiance_mib"] == cost["lobes_mib"] == 0 < cost["relight_mib"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda use: use["of_harmonics"].pop(), "of_harmonics: expected 16 rows, one a light, got 15"),
        (lambda use: use | {"textures": 15, "in_colour": 15, "of_harmonics": use["of_harmonics"][1:]},
         "relight.exr: expected 15 parts"),
        (lambda use: use | {"textures": "many"}, "textures"),
        (lambda use: use | {"in_colour": 17}, "in_colour: expected 1 to 16, got 17"),
    ],
    ids=["rows", "parts", "number", "in colour"],
)  # fmt: skip
def test_too_few_rows_are_told(look, tmp_path, spoil, message):
    """Rows of the matrix, parts of the file and the number of textures go together."""
    shutil.copytree(look.parent / "out", tmp_path / "out")
    path = tmp_path / "out" / "relight.json"
    use = json.loads(path.read_text())
    changed = spoil(use)
    path.write_text(json.dumps(changed if isinstance(changed, dict) else use))
    with pytest.raises(InputError, match=re.escape(message)):
        skinbake.open_bake(path.parent).relight("studio")


def test_a_sun_is_read_from_text():
    """One number is white."""
    assert parse_sun("-0.6,-.5,-1=3/2.5/1") == ([-0.6, -0.5, -1.0], [3.0, 2.5, 1.0])
    assert parse_sun("0,0,-1=2") == ([0.0, 0.0, -1.0], [2.0, 2.0, 2.0])
    with pytest.raises(InputError):
        parse_sun("0,0,-1=1/nan/1")


def test_python_reads_what_the_command_line_wrote(look):
    """`open_bake(...).relight` gives what the same look gives in memory."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "unseen_lights", few_lights)
        memory = skinbake.bake(skinbake.load_look(look))
    ours = skinbake.open_bake(look.parent / "out")
    found, exact = (each.relight("sunset", 25, [((0, 0, -1), (1, 1, 1))]) for each in (ours, memory))
    assert found.tobytes() == exact.tobytes()
    assert "come later" in ours._repr_html_()


@pytest.mark.slow  # OpenGL
def test_the_light_goes_around(look, tmp_path):
    """A turntable of the light: other pictures from the same place; the first is that without a turn."""
    folder, size = str(look.parent / "out"), ["--size", "40x50", "--quiet"]
    assert run(["preview", folder, "--environment", "studio", "--turntable", "3", "--turn", "light", "--out",
                str(tmp_path), *size]) == 0  # fmt: skip
    assert run(["preview", folder, "--environment", "studio", "--png", str(tmp_path / "still.png"), *size]) == 0
    frames = [np.asarray(Image.open(tmp_path / f"preview_{k:04d}.png")) for k in range(3)]
    assert (frames[0] == np.asarray(Image.open(tmp_path / "still.png"))).all()
    assert all(np.abs(frames[0].astype(int) - other).max() > 10 for other in frames[1:])
