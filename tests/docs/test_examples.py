"""The examples of architecture.md are complete: applied to a copy of the package, they work."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from skinbake.io.mesh import write_obj
from tests.conftest import ROOT
from tests.shapes import sphere

TEXT = (ROOT / "skinbake" / "docs" / "architecture.md").read_text()
EXAMPLES = {
    part.split("\n")[0]: re.findall(r"^```(diff|yaml)\n(.*?)^```", part, re.MULTILINE | re.DOTALL)
    for part in TEXT.split("\n## ")
    if "```diff" in part
}
LOOK = """\
mesh: {path: ball.obj, unit: mm, any_size: true}
texture: {size: 32}
skin: {preset: jensen-skin1}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
diffusion: {tolerance: 0.5, probes: 50}
output: {dir: out}
"""
LOAD = """
import sys
from skinbake.io.config import load_look
from skinbake.profile import fit_skin
look = load_look(sys.argv[1])
print([light.type for light in look.lights], fit_skin(look.skin).gaussians.model, look.diffusion.method, look.terms)
from skinbake.cli import run
for verb in (["check"], ["bake"], ["truth", "--points", "4", "--walks", "4"])[: int(sys.argv[2])]:
    assert run([*verb, "look.yaml"]) in (0, 1), verb  # 1: a tolerance was missed
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_applies_and_its_look_is_understood(name, tmp_path):
    """The diff fits the package of today, keeps its lint rules, and the YAML below it names what it adds."""
    shutil.copytree(ROOT / "skinbake", tmp_path / "skinbake", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    write_obj(tmp_path / "ball.obj", sphere(60.0, "latlong", 24))
    (diff,) = (block for kind, block in EXAMPLES[name] if kind == "diff")
    (yaml,) = (block for kind, block in EXAMPLES[name] if kind == "yaml")
    applied = subprocess.run(
        ["git", "apply", "--unidiff-zero", "--recount", "-C1", "-"],
        input=diff, text=True, capture_output=True, cwd=tmp_path,
        env=os.environ | {"GIT_CEILING_DIRECTORIES": str(tmp_path.parent)},  # else a repository above would be meant
    )  # fmt: skip
    assert applied.returncode == 0, applied.stderr
    linted = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--quiet", "skinbake"], capture_output=True, text=True, cwd=tmp_path
    )
    assert linted.returncode == 0, linted.stdout
    key = yaml.split(":")[0]
    kept = [line for line in LOOK.splitlines() if not line.startswith(f"{key}:")]
    (tmp_path / "look.yaml").write_text("\n".join(kept) + "\n" + yaml)
    loaded = subprocess.run(
        [sys.executable, "-c", LOAD, "look.yaml", str(3 if key == "diffusion" else 2)], capture_output=True, text=True,
        cwd=tmp_path, env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(tmp_path), "HOME": os.environ["HOME"]},
    )  # fmt: skip
    assert loaded.returncode == 0, loaded.stderr
    added = {"skin": "exponential", "lights": "fill", "diffusion": "mean", "terms": "powder='on'"}[key]
    assert added in loaded.stdout
