"""What is printed steers no terminal, and fits any."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skinbake.cli import run
from skinbake.errors import printable
from skinbake.io.mesh import write_obj
from tests.conftest import ROOT
from tests.preview.bakes import write_bake
from tests.shapes import quad

SMALL = """\
mesh: {path: mesh.obj, unit: mm}
texture: {size: 16}
skin: {model: gaussians, variance_mm2: [4.0], weight_rgb: [[1, 1, 1]]}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""
RED = "\x1b[31mred\x1b]0;title\x07\x9b2J\u202etxt"


def test_control_characters_are_told_not_obeyed():
    """Escapes, C1 controls, overrides of direction, halves of characters; what people write stays as it is."""
    assert printable(RED) == r"\x1b[31mred\x1b]0;title\x07\x9b2J\u202etxt"
    assert printable("o\udcff") == r"o\udcff"
    assert printable("Zoë, 肌, 🙂\n\ttwo lines") == "Zoë, 肌, 🙂\n\ttwo lines"


@pytest.fixture
def report(tmp_path):
    """A batch's report whose names were made by somebody else."""
    jobs = [{"name": RED, "status": "failed", "error": f"{RED}: no such mesh"}, {"name": "Zoë", "status": "done"}]
    (tmp_path / "batch.json").write_text(json.dumps({"file": RED, "version": RED, "jobs": jobs}))
    return tmp_path


def test_names_in_files_are_printed_without_their_escapes(report, capfd):
    """`info` of a folder from elsewhere."""
    assert run(["info", str(report)]) == 0
    said = capfd.readouterr().out
    assert r"\x1b[31mred" in said
    assert not any(character in said for character in "\x1b\x07\x9b\u202e")


def test_faults_are_printed_without_the_escapes_of_their_keys(tmp_path, capfd):
    """A key of a look that is an escape sequence."""
    (tmp_path / "look.yaml").write_text('"\\e[2J\\e[1;31mok": 1\n')
    assert run(["check", str(tmp_path / "look.yaml")]) == 2
    said = capfd.readouterr().err
    assert r"\x1b[2J\x1b[1;31mok: unknown key" in said
    assert "\x1b" not in said


def test_an_ascii_terminal_is_written_to(report, monkeypatch):
    """What it has no letters for is escaped; no verb fails by it."""
    stdout = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict", write_through=True)
    monkeypatch.setattr(sys, "stdout", stdout)
    assert run(["info", str(report)]) == 0
    assert rb"Zo\xeb" in stdout.buffer.getvalue()


@pytest.mark.parametrize("verb", [["bake", "look.yaml", "--out"], ["info"], ["preview"], ["check"], ["batch"]])
def test_names_that_are_no_utf8_are_told(tmp_path, verb):
    """Exit 2 and the name, or it works: no traceback."""
    (tmp_path / "look.yaml").write_text(
        "mesh: {path: look.yaml, unit: mm}\nskin: {model: burley, d_mm: [1, 1, 1]}\noutput: {dir: out}\n"
        "lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-m", "skinbake", *verb, b"o\xff"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    said = done.stderr.decode()
    assert done.returncode == 2, said
    assert r"o\udcff" in said
    assert "Traceback" not in said


def test_an_output_folder_that_is_no_utf8_is_told_before_anything_is_computed(tmp_path):
    """The library that writes EXRs would end in a traceback, after minutes."""
    write_obj(tmp_path / "mesh.obj", quad(240, 200))
    (tmp_path / "look.yaml").write_text(SMALL)
    command = [sys.executable, "-m", "skinbake", "bake", "look.yaml", "--no-preview", "--out", b"o\xff"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert done.returncode == 2, done.stderr
    assert b"output.dir: expected text in UTF-8" in done.stderr
    assert sorted(os.listdir(tmp_path)) == ["look.yaml", "mesh.obj"]


def test_names_of_parts_and_notes_are_printed_without_their_escapes(tmp_path, capfd):
    """What a mesh calls its parts: in the report of `check` and in the log of a bake."""
    write_obj(tmp_path / "mesh.obj", quad(240, 200))
    text = (tmp_path / "mesh.obj").read_text()
    (tmp_path / "mesh.obj").write_text(text.replace("f ", f"usemtl {RED.split()[0]}\nf ", 1))
    (tmp_path / "look.yaml").write_text(SMALL.replace("mesh.obj", "mesh.obj, skin: '*', cast: '*red*'"))
    run(["check", str(tmp_path / "look.yaml")])
    run(["bake", str(tmp_path / "look.yaml"), "--no-preview"])
    found = capfd.readouterr()
    said = found.out + found.err
    assert r"\x1b[31mred" in said
    assert not any(character in said for character in "\x1b\x07\x9b\u202e")


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_a_stream_that_is_closed_leads_nowhere(tmp_path, closed):
    """What is said there is lost; nothing fails, and no file gets its number."""
    folder = write_bake(tmp_path)
    script = f"""
import os, sys
for number in {closed}:
    os.close(number)
python = [sys.executable, "-m", "skinbake"]
os.execv(sys.executable, python + ["export", {str(folder)!r}, "--sum", "--to", {str(tmp_path / "to")!r}])
"""
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False, cwd=ROOT)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "to" / "sum.exr").is_file()
    assert bool(found.stdout) == (1 not in closed)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("long", [False, True])
def test_what_cannot_be_printed_is_a_fault_of_stdout(report, unbuffered, long):
    """Of a text that fits into a buffer, too, which is written when all is done."""
    verb = ["schema"] if long else ["info", str(report)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "skinbake", *verb]
        done = subprocess.run(command, env=environment, stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 3
    assert done.stderr.decode().startswith("skinbake: stdout: No space left")
