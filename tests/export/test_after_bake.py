"""`output.export`: what a look asks for lies beside its bake, is that of the bake, and is not made twice."""

from __future__ import annotations

import json

import jsonschema
import pytest

from skinbake.cli import run
from skinbake.cli.export import command
from skinbake.export.after_bake import FOLDER
from skinbake.export.exports import EXPORTS
from skinbake.io.manifest import read_manifest
from skinbake.scene.output import EXPORT_KINDS
from skinbake.scene.schema import look_schema
from tests.cli.test_batch import Here


@pytest.fixture
def look(bake, tmp_path):
    """Bakes the ball into a folder of this test, with changes; gives the exports' times, by name."""

    def baked(*changes, code=0, more=()):
        sets = [word for change in changes for word in ("--set", change)]
        verb = ["bake", str(bake.parent / "me.yaml"), "--out", str(tmp_path / "out"), "--no-preview", "--quiet"]
        assert run([*verb, *sets, *more]) == code
        return {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out" / FOLDER).glob("*")}

    return baked


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "export.json"}


def test_a_bake_ends_with_its_exports(look, tmp_path):
    """The same bytes as the verb writes; bake.json names them; a second bake leaves them as they are."""
    first = look("output.export=[sum, gltf, blender]")
    assert {"sum.exr", "sum.png", "skin.glb", "skin_blender.py", "lobe_0.exr"} <= set(first)
    verb = ["export", str(tmp_path / "out"), "--to", str(tmp_path / "by hand"), "--sum", "--gltf", "--blender"]
    assert run([*verb, "--quiet"]) == 0
    assert contents(tmp_path / "by hand") == contents(tmp_path / "out" / FOLDER)
    assert set(read_manifest(tmp_path / "out")["export"]["files"]) == set(first) - {"export.json"}
    assert look("output.export=[sum, gltf, blender]") == first
    assert set(read_manifest(tmp_path / "out")["export"]["files"]) == set(first) - {"export.json"}
    forced = look("output.export=[sum, gltf, blender]", more=["--force"])
    assert all(forced[name] > first[name] for name in first)


def test_what_is_stale_missing_or_cut_is_written_again(look, tmp_path):
    """Another light, another exposure, a file that is gone or shorter; what is no longer asked for goes."""
    asked, folder = "output.export=sum", tmp_path / "out" / FOLDER
    first = look(asked)
    assert set(first) == {"sum.exr", "sum.png", "export.json"}
    (folder / "sum.exr").unlink()
    second = look(asked)
    assert second["sum.exr"] > first["sum.exr"]
    whole = (folder / "sum.png").read_bytes()
    (folder / "sum.png").write_bytes(whole[:-9])
    look(asked)
    assert (folder / "sum.png").read_bytes() == whole
    look(asked, "preview.exposure=2")
    assert (folder / "sum.png").read_bytes() != whole
    before = (folder / "sum.exr").read_bytes()
    look(asked, "lights.key.irradiance=[3, 2, 1]")
    assert (folder / "sum.exr").read_bytes() != before
    assert set(look("output.export=gltf")) == {"skin.glb", "export.json"}
    (folder / "mine.txt").write_text("mine")
    assert set(look()) == {"mine.txt"}
    assert "export" not in read_manifest(tmp_path / "out")
    (folder / "mine.txt").unlink()
    look(asked)
    look()
    assert not folder.exists()


def test_a_bake_that_missed_its_tolerance_is_exported(look):
    """It is whole; the exit code says that the tolerance was missed."""
    assert "sum.exr" in look("output.export=sum", "diffusion.tolerance=1e-4", code=1)


def test_what_cannot_be_exported_is_said(look, tmp_path, capsys):
    """By key and file, with exit code 2."""
    look("output.export=[sum, maya]", code=2)
    said = capsys.readouterr().err
    assert "output.export[1]" in said
    assert "'sum', 'layers', 'gltf', 'blender' or 'web'" in said
    (tmp_path / "out" / FOLDER).mkdir(parents=True)
    (tmp_path / "out" / FOLDER / "sum.png").write_text("mine")
    look("output.export=sum", code=2)
    assert "sum.png: expected no file, or one of an earlier export" in capsys.readouterr().err
    assert (tmp_path / "out" / FOLDER / "sum.png").read_text() == "mine"


def test_by_hand_nothing_goes_where_a_bake_removes(look, tmp_path, capsys):
    """Neither by its own name nor through a link, before or after there are exports."""
    look()
    (tmp_path / "link").symlink_to(tmp_path / "out" / FOLDER)
    for to in (tmp_path / "out" / FOLDER, tmp_path / "link"):
        assert run(["export", str(tmp_path / "out"), "--to", str(to), "--sum", "--quiet"]) == 2
        assert "got that of the bake's output.export" in capsys.readouterr().err
    assert not (tmp_path / "out" / FOLDER).exists()


def test_exports_are_told_of_before_the_verdict(bake, tmp_path, monkeypatch, capsys):
    """By a path as short as that of the picture."""
    monkeypatch.chdir(tmp_path)
    assert run(["bake", str(bake.parent / "me.yaml"), "--out", "b", "--no-preview", "--set", "output.export=sum"]) == 0
    lines = capsys.readouterr().err.splitlines()
    first, *rest = (n for n, line in enumerate(lines) if line.startswith(("done", "exports", "verdict", "warning")))
    assert [lines[n].split()[0] for n in (first, *rest[:2])] == ["done", "exports", "verdict"]
    assert lines[rest[0]].split() == ["exports", "b/export"]
    assert not [line for line in lines[rest[1] :] if "export" in line]


@pytest.mark.slow  # the page's pictures
def test_a_batch_gets_one_page_of_all(bake, tmp_path, monkeypatch, capsys):
    """With a frame a look; what its coding costs is in bake.json; a dry run knows what is there."""
    monkeypatch.setattr("skinbake.batch.batching.ProcessPool", Here)
    file = bake.parent / "two.yaml"
    file.write_text(
        "defaults: {base: me.yaml, texture: {size: 24}, output: {dir: two, export: [web]}}\n"
        "jobs: [{name: low}, {name: high, preview: {exposure: 1}}]\n"
    )
    assert run(["batch", str(file), "--out", str(tmp_path / "two"), "--no-preview", "--quiet"]) == 0
    page = (tmp_path / "two" / "batch.html").read_text()
    assert page.count("<iframe ") == 2
    for name in ("low", "high"):
        assert f'src="{name}/export/head.html#panel=0" title="{name}"' in page
        coding = read_manifest(tmp_path / "two" / name)["export"]["files"]["head.html"]["coding_rms"]
        assert 0 < coding["lobes together"] < 0.02
    verb = ["batch", str(file), "--out", str(tmp_path / "two"), "--no-preview", "--dry-run"]
    assert run(verb) == 0
    assert capsys.readouterr().out.count("as it was") == 2
    (tmp_path / "two" / "low" / "export" / "head.html").unlink()
    assert run(verb) == 0
    assert "export: to write web" in capsys.readouterr().out
    (tmp_path / "two" / "batch.html").write_text("mine")
    assert run(["batch", str(file), "--out", str(tmp_path / "two"), "--no-preview", "--quiet"]) == 2
    assert (tmp_path / "two" / "batch.html").read_text() == "mine"
    assert "got one that skinbake has not written" in capsys.readouterr().err
    assert json.loads((tmp_path / "two" / "batch.json").read_text())["jobs"][0]["status"] == "done"


def test_a_look_may_ask_for_every_kind_of_export():
    """And for no other, also by the schema; the verb has the same."""
    assert tuple(EXPORTS) == EXPORT_KINDS
    assert set(EXPORTS) < {parameter.name for parameter in command.params}
    schema = look_schema([])["$defs"]["OutputSpec"]["properties"]["export"]
    for value, taken in (("web", True), (["sum", "web"], True), ("maya", False), (["maya"], False)):
        assert jsonschema.Draft202012Validator(schema).is_valid(value) == taken


def test_an_export_that_cannot_be_is_refused_before_the_bake(bake, look, tmp_path, capsys):
    """Oil of varying reflectance in Blender: nothing is baked, and a batch that is only planned says so."""
    oil = f"maps.f0={bake.parent / 'rough.png'}"
    look("output.export=[sum, blender]", oil, "terms.energy_conservation=on", code=2)
    assert "expected oil of one specular.f0, got maps.f0" in capsys.readouterr().err
    assert not (tmp_path / "out" / "bake.json").exists()
    (bake.parent / "oily.yaml").write_text(
        "defaults: {base: me.yaml, output: {dir: oily, export: [blender]}, terms: {energy_conservation: on}}\n"
        "jobs: [{name: oil, maps: {f0: rough.png}}]\n"
    )
    assert run(["batch", str(bake.parent / "oily.yaml"), "--no-preview", "--dry-run"]) == 1
    assert "cannot be baked: export --blender: expected oil of one specular.f0" in capsys.readouterr().out
    assert "sum.exr" in look("output.export=[sum, blender]", oil, "terms.energy_conservation=off")
