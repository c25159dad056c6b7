"""`make` does what is stale and nothing else: its rules run in a copy of the project with one small look."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

import pytest

from skinbake.cli.info import make_name
from skinbake.errors import InputError
from skinbake.io.mesh import write_obj
from tests.cli.test_batch import BATCH
from tests.conftest import ROOT
from tests.shapes import relief

pytestmark = [pytest.mark.slow, pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")]

LOOK = (
    BATCH.partition("matrix:")[0].replace("defaults:\n", "").replace("\n  ", "\n").removeprefix("  ")
    + "skin: {model: gaussians, variance_mm2: [1.0], weight_rgb: [[1, 1, 1]]}\npreview: {size: [40, 50]}\n"
)


@pytest.fixture
def project(tmp_path):
    """Makefile, code and a .venv that is this one."""
    for name in ("skinbake", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    script = tmp_path / ".venv" / "bin" / "skinbake"
    script.write_text(f"#!/bin/sh\nexec env PYTHONPATH='{ROOT}' '{sys.executable}' -m skinbake \"$@\"\n")
    script.chmod(0o755)
    (tmp_path / ".venv" / ".ready").touch()
    (tmp_path / "data").mkdir()
    maps = ("albedo", "normal", "roughness", "melanin", "haemoglobin", "cavity")
    for name in ("head.obj", *(f"{each}.png" for each in maps)):
        (tmp_path / "data" / name).touch()
    (tmp_path / "configs" / "skins").mkdir(parents=True)
    write_obj(tmp_path / "configs" / "mesh.obj", relief(segments=24))
    output = "output: {dir: ../out/tiny}"
    (tmp_path / "configs" / "tiny.yaml").write_text(LOOK.replace("output: {dir: out}", output))
    text = BATCH.replace("output: {dir: out}", "output: {dir: ../out/looks}\n  preview: {size: [40, 50]}")
    (tmp_path / "configs" / "looks.yaml").write_text(text)
    for folder, _, names in os.walk(tmp_path):
        for name in names:
            os.utime(os.path.join(folder, name), (0, 10**9))
    os.utime(tmp_path / ".venv" / ".ready", (0, 10**9 + 1))

    def make(*targets):
        done = subprocess.run(["make", *targets], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout, done.stderr

    make.folder = tmp_path
    return make


NAMES = [
    "a b.obj",
    "a#b",
    "a:b",
    "$(shell touch PWNED).obj",
    "`touch PWNED`",
    "a$b",
    "[1] *?.obj",
    "~x",
    "Zoë & co",
    "it's",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_path_in_a_rule_stands_for_itself(tmp_path, name):
    """Make finds the file, notices its change and its loss, and runs nothing that its name says."""
    file = tmp_path / name
    file.touch()
    (tmp_path / "bake.json").touch()
    word = make_name(file)
    rules = f"all: bake.json\nbake.json:\n\t@echo built\nbake.json: {word}\n{word}:\n"
    (tmp_path / "Makefile").write_text(rules)
    os.utime(tmp_path / "bake.json", (10**9, 10**9))
    said = []
    for age in (9 * 10**8, 11 * 10**8, None):
        os.utime(file, (age, age)) if age else file.unlink()
        done = subprocess.run(["make", "all"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        said.append("built" in done.stdout)
    assert said == [False, True, True]
    assert not (tmp_path / "PWNED").exists()


@pytest.mark.parametrize(
    "name", ["a%b", "a;touch PWNED", "a=b", "a|b", "a\\b", "a&", "lib(x)", "a\tb", "a\nb", "a ", "\x1b[0m"]
)
def test_what_no_rule_can_quote_is_refused(tmp_path, name):
    """It would be a pattern, a recipe, a variable, a list or a member of an archive."""
    with pytest.raises(InputError, match="expected paths that a makefile can name, got"):
        make_name(tmp_path / name)


def test_only_what_is_stale_is_made(project):
    """A stage at a time, then nothing; a touched look is read and nothing is run; a changed mesh is."""
    said, _ = project("out/tiny/irradiance.exr")
    assert "skinbake irradiance" in said
    assert not (project.folder / "out" / "tiny" / "bake.json").exists()
    said, err = project("out/tiny/bake.json")
    assert "skinbake irradiance" not in said
    assert re.search("tracing light +as it was", err)
    assert "up to date" in project("out/tiny/bake.json")[0]
    (project.folder / "configs" / "tiny.yaml").touch()
    _, err = project("out/tiny/bake.json")
    assert re.search("scattering light +as it was", err)
    assert "up to date" in project("out/tiny/bake.json")[0]
    write_obj(project.folder / "configs" / "mesh.obj", relief(segments=20))
    _, err = project("out/tiny/bake.json")
    assert "as it was" not in err.partition("tracing light")[2].partition("\n")[0]
    assert "up to date" in project("out/tiny/bake.json")[0]


def test_of_tiles_only_what_a_verb_writes_is_there(project):
    """No empty irradiance.exr stands beside irradiance.1001.exr; what has not changed is as it was."""
    look = project.folder / "configs" / "tiny.yaml"
    look.write_text(look.read_text().replace("gutter: 4", "gutter: 4, udim: true"))
    project("out/tiny/bake.json")
    written = {path.name for path in (project.folder / "out" / "tiny").glob("irradiance*")}
    assert written == {"irradiance.1001.exr"}
    _, err = project("out/tiny/bake.json")
    assert re.search("scattering light +as it was", err)


def test_looks_of_a_batch_are_targets_and_can_be_made_side_by_side(project):
    """`make -j2` of two looks, then `make -j2 batch` for the rest."""
    targets = [f"out/looks/{name}/bake.json" for name in ("thin-day", "thick-day")]
    project("-j2", *targets)
    assert "up to date" in project(*targets)[0]
    said, err = project("-j2", "batch")
    assert "batch 'configs/looks.yaml' -j 2" in said
    assert err.count("as it was") == 2
    assert (project.folder / "out" / "looks" / "batch.png").stat().st_size > 1000


@pytest.mark.parametrize("folder", ["elsewhere", "my dir", "it's $(here)"])
def test_a_preview_follows_the_look_s_own_folder(project, folder):
    """`make bake CONFIG=x`, then `make preview CONFIG=x`: what that bake left, wherever the look and its output lie."""
    beside = project.folder / folder
    beside.mkdir()
    write_obj(beside / "mesh.obj", relief(segments=24))
    (beside / "look.yaml").write_text(LOOK.replace("output: {dir: out}", "output: {dir: own}"))
    config = "CONFIG=" + f"{folder}/look.yaml".replace("$", "$$")
    project("bake", config)
    (beside / "own" / "preview.png").unlink()
    _, err = project("preview", config, "DISPLAY=")
    assert (beside / "own" / "preview.png").exists(), err
    assert not (project.folder / "out").exists()
