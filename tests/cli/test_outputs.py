"""No command writes over what it reads, over other people's files, or into the folder it happens to be called from."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from skinbake.cli import run
from skinbake.io.png import write_png
from tests.cli.test_bad_input import good

SKIN = "{model: gaussians, variance_mm2: [0.5, 40.0], weight_rgb: [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]}"


@pytest.fixture
def look(tmp_path, monkeypatch):
    """A look that bakes into `out`, called from a folder of its own."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    mapping = good(tmp_path)
    write_png(tmp_path / "albedo.png", np.full((8, 8, 3), 128, np.uint8))
    mapping["maps"] = {"albedo": str(tmp_path / "albedo.png")}
    return write_look(tmp_path / "look.yaml", mapping)


def write_look(path, mapping):
    path.write_text(yaml.safe_dump(mapping))
    return path


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "command",
    [
        ["bake", "LOOK", "--out", ""],
        ["bake", "LOOK", "--cache", ""],
        ["bake", "LOOK", "--set", "output.dir=''"],
        ["irradiance", "LOOK", "--out", ""],
        ["diffuse", "LOOK", "x.exr", "--out", ""],
        ["fit", "LOOK", "--out", ""],
        ["check", "LOOK", "--out", ""],
        ["tradeoff", "LOOK", "--out", ""],
        ["truth", "LOOK", "--out", ""],
        ["watch", "LOOK", "--out", ""],
        ["batch", "LOOK", "--out", ""],
        ["init", "head.obj", "--out", ""],
        ["preview", "FOLDER", "--out", ""],
        ["preview", "FOLDER", "--png", ""],
        ["compare", "a.exr", "b.exr", "--picture", ""],
    ],
)
def test_an_empty_path_is_not_the_folder_one_is_in(look, capsys, command):
    """`--out "$OUT"` with OUT not set is refused, and nothing is written."""
    before = files(look.parent)
    assert run([str(look) if word == "LOOK" else word for word in command]) == 2
    assert "expected a path, got an empty text" in capsys.readouterr().err
    assert files(look.parent) == before


def test_an_empty_output_folder_is_refused_with_its_line(look, capsys):
    """In the file, and through a variable that is empty."""
    text = look.read_text()
    for empty in ("''", '"${NOWHERE_AT_ALL:-}"'):
        look.write_text(text.replace(f"dir: {look.parent / 'out'}", f"dir: {empty}"))
        assert run(["bake", str(look)]) == 2
        assert "output.dir: expected a path, got" in capsys.readouterr().err


def refused(capsys, arguments, name):
    """That a command refuses to write over a file, which keeps its bytes."""
    kept = name.read_bytes()
    assert run([str(argument) for argument in arguments]) == 2, arguments
    said = capsys.readouterr().err
    assert f"{name}: expected inputs that" in said, said
    assert name.read_bytes() == kept
    return said


def test_no_verb_writes_over_its_own_input(look, tmp_path, capsys):
    """Maps, tables, the look itself: whatever has the name of an output, also through a link."""
    mapping = yaml.safe_load(look.read_text())
    uv = tmp_path / "uv_check.png"
    uv.symlink_to(tmp_path / "albedo.png")
    refused(capsys, ["check", look, "--out", tmp_path], tmp_path / "albedo.png")

    table = tmp_path / "profile.csv"
    table.write_text("r_mm,R,G,B\n0,1,1,1\n0.5,0.25,0.2,0.1\n1,0.1,0.05,0.02\n10,1e-9,0,0\n")
    refused(capsys, ["fit", look, "--set", f"skin={{model: table, path: {table}}}", "--out", tmp_path], table)
    refused(capsys, ["fit", look, "--against", table, "--out", tmp_path], table)
    as_json = tmp_path / "profile.json"
    as_json.write_text(SKIN)
    refused(capsys, ["fit", as_json, "--out", tmp_path], as_json)

    for verb, name in (("tradeoff", "tradeoff.png"), ("truth", "truth/truth.png")):
        (tmp_path / "out" / "truth").mkdir(parents=True, exist_ok=True)
        picture = tmp_path / "out" / name
        picture.write_bytes((tmp_path / "albedo.png").read_bytes())
        other = write_look(tmp_path / "other.yaml", mapping | {"maps": {"albedo": str(picture)}})
        refused(capsys, [verb, other, "--out", tmp_path / "out"], picture)

    own = tmp_path / "bake.json"
    own.write_text(yaml.safe_dump(mapping | {"output": {"dir": str(tmp_path)}}))
    refused(capsys, ["bake", own], own)

    batch = tmp_path / "batch.json"
    batch.write_text(
        yaml.safe_dump({"defaults": mapping | {"output": {"dir": str(tmp_path)}}, "jobs": [{"name": "a"}]})
    )
    refused(capsys, ["batch", batch, "--quiet"], batch)


def test_pictures_are_not_written_over_the_images_they_are_made_of(look, tmp_path, capsys):
    """`preview --png`, its EXR, and `compare --picture`."""
    assert run(["bake", str(look), "--quiet", "--no-preview"]) == 0
    out = tmp_path / "out"
    albedo = tmp_path / "albedo.png"
    refused(capsys, ["preview", out, "--png", albedo], albedo)
    refused(capsys, ["preview", out, "--png", out / "irradiance.png", "--exr"], out / "irradiance.exr")
    refused(capsys, ["compare", albedo, tmp_path / "albedo.png", "--picture", albedo], albedo)
    refused(capsys, ["compare", out, out, "--picture", out / "profile.png"], out / "profile.png")
    lobe = out / "lobe_0.exr"
    assert run(["diffuse", str(look), str(lobe), "--out", str(out)]) == 2
    assert f"{lobe}: expected inputs that the bake does not write" in capsys.readouterr().err


def test_init_writes_over_no_file_that_is_there(look, tmp_path, capsys):
    """Not without --force, and with it only over a look."""
    mesh = tmp_path / "head.obj"
    kept = look.read_bytes(), mesh.read_bytes()
    assert run(["init", str(mesh), "--out", str(look)]) == 2
    assert run(["init", str(mesh), "--out", str(mesh), "--force"]) == 2
    assert "expected a YAML file for --force to write over" in capsys.readouterr().err
    assert (look.read_bytes(), mesh.read_bytes()) == kept


@pytest.mark.parametrize("name", ["irradiance.exr", "lobe_1.exr", "profile.csv", "preview.png", "bake.json"])
def test_somebody_elses_file_is_not_written_over(look, tmp_path, capsys, name):
    """Refused by name before anything is written; what our own header proves, or the manifest lists, is made anew."""
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_bytes(b"\x89PNG\r\n\x1a\n of somebody else")
    before = files(out)
    assert run(["bake", str(look), "--quiet"]) == 2
    assert f"{out / name}: expected a file of an earlier bake or none" in capsys.readouterr().err
    assert files(out) == before


def test_files_that_prove_themselves_ours_are_made_anew(look, tmp_path):
    """Without the manifest, cut short or empty: no reason to refuse."""
    arguments = ["bake", str(look), "--quiet", "--set", "output.tx=true", "--set", "preview.size=[32, 40]"]
    assert run(arguments) == 0
    out = tmp_path / "out"
    names = sorted(path.name for path in out.iterdir())
    (out / "bake.json").unlink()
    for name in ("irradiance.exr", "lobe_0.exr", "lobe_0.tx", "profile.json", "preview.png"):
        (out / name).write_bytes((out / name).read_bytes()[:-100])
    (out / "profile.csv").write_bytes(b"")
    assert run([*arguments, "--force"]) == 0
    assert sorted(path.name for path in out.iterdir()) == names


def test_an_unwrapped_mesh_is_not_written_over_somebody_elses(look, tmp_path, capsys):
    """mesh.obj is an output only where the UVs are our own."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mesh.obj").write_text("v 0 0 0\n")
    more = ["--set", "maps={albedo_rgb: [0.5, 0.5, 0.5]}", "--quiet", "--no-preview"]
    assert run(["bake", str(look), *more]) == 0
    text = (tmp_path / "head.obj").read_text()
    (tmp_path / "head.obj").write_text(_without_uvs(text))
    assert run(["bake", str(look), *more, "--set", "texture.unwrap=xatlas"]) == 2
    assert "mesh.obj: expected a file of an earlier bake or none" in capsys.readouterr().err
    assert (tmp_path / "out" / "mesh.obj").read_text() == "v 0 0 0\n"


def _without_uvs(text):
    """An OBJ's text with positions and faces only."""
    lines = [line for line in text.splitlines() if line.startswith(("v ", "f "))]
    return "\n".join(" ".join(word.split("/")[0] for word in line.split()) for line in lines) + "\n"
