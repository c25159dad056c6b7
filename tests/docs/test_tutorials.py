"""The tutorials are run as they stand, at a small size: files are written, commands end as the page says."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from skinbake.preview.setup_gl import renderer_name
from tests.cli.test_batch import Here
from tests.conftest import ROOT
from tests.shapes import sphere

PAGES = ROOT / "skinbake" / "docs" / "tutorials"
ORDER = ("own_head", "light_study", "measured_skin", "sequence")
# What makes a run small, by verb
SMALL = {
    verb: ["--set", "texture.size=32", "--set", "texture.reduce=off", "--set", "diffusion.probes=50",
           "--set", "preview.size=[60,75]"]
    for verb in ("check", "bake", "batch")
} | {
    "truth": ["--set", "texture.size=32", "--points", "4", "--walks", "4"], "preview": ["--size", "60x75"],
}  # fmt: skip
LEFT = {
    "own_head": ["me.yaml", "skinbake.schema.json", "out/me/bake.json", "out/me/preview.png", "handed/head.html",
                 "handed/skin.glb", "handed/lobe_0.key.exr", "pictures/preview_nose.png", "pictures/scattering.png"],
    "light_study": ["out/study/batch.html", "out/study/batch.png", "out/study/hard-dim/bake.json", "warm.png",
                    "difference.png"],
    "measured_skin": ["fit/profile.json", "fit/profile.csv", "out/measured/bake.json"],
    "sequence": ["out/blush/0001/bake.json", "out/blush/0003/preview.png", "blush.0003.preview.png", "handed/sum.exr"],
}  # fmt: skip


def test_every_tutorial_is_run():
    """None is left out."""
    assert {path.stem for path in PAGES.glob("*.md")} == set(ORDER)


def blocks(page):
    """Files of a page with their text, and its commands with the exit code that they should end with."""
    text = (PAGES / f"{page}.md").read_text()
    for name, kind, body in re.findall(r"(?:`([\w.]+)`:\n\n)?^```(\w+)\n(.*?)^```", text, re.M | re.S):
        if kind == "yaml":
            assert name, body
            yield name, body
        else:
            for line in body.splitlines():
                command, _, comment = line.partition("  # ")
                code = re.search(r"exit code (\d)", comment)
                yield shlex.split(command), int(code[1]) if code else 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scan, as the tutorials say it lies there."""
    folder = tmp_path_factory.mktemp("tutorial")
    write_obj(folder / "me.obj", sphere(100.0, "latlong", 16))
    for frame, red in ((1, 200), (2, 210), (3, 220)):
        write_png(folder / f"blush.{frame:04d}.png", np.full((8, 8, 3), (red, 150, 130), np.uint8))
    write_png(folder / "me_albedo.png", np.full((8, 8, 3), (200, 150, 130), np.uint8))
    return folder


@pytest.mark.slow  # a dozen bakes
@pytest.mark.skipif(renderer_name() is None, reason="no headless OpenGL here")
@pytest.mark.parametrize("page", ORDER)
def test_a_tutorial_works_as_it_stands(page, folder, monkeypatch, capsys):
    """In the order of the pages, in one folder, as somebody would who reads them one after another."""
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("skinbake.batch.batching.ProcessPool", Here)
    for first, second in blocks(page):
        if isinstance(first, str):
            (folder / first).write_text(second)
            continue
        program, verb, *rest = first
        assert program == "skinbake"
        capsys.readouterr()
        code = run([verb, *rest, *SMALL.get(verb, [])])  # of an option that is given twice, the last one counts
        said = capsys.readouterr()
        assert code == second, (first, said.out, said.err)
    assert [name for name in LEFT[page] if not (folder / name).is_file()] == []
