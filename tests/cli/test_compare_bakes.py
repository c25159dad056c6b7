"""Two bakes compared: lobe by lobe, whatever their sizes, with a picture."""

from __future__ import annotations

import json
import re

import pytest

from skinbake.cli import run
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from tests.cli.test_faults import LOOK
from tests.shapes import relief


@pytest.fixture
def bake(tmp_path):
    write_obj(tmp_path / "mesh.obj", relief(segments=24))
    (tmp_path / "look.yaml").write_text(LOOK)

    def made(name, *more):
        arguments = ["bake", str(tmp_path / "look.yaml"), "--out", str(tmp_path / name), "--no-preview", "--quiet"]
        assert run([*arguments, *more]) in (0, 1)  # 1: a tolerance was missed
        return str(tmp_path / name)

    return made


def test_two_bakes_are_compared_lobe_by_lobe(bake, tmp_path, capsys):
    """The same twice is the same; a brighter key differs in its own parts and in the sums, not in the lamp's."""
    a, b = bake("a"), bake("b", "--set", "lights.key.irradiance=[2, 4, 6]")
    assert run(["compare", a, a]) == 0
    capsys.readouterr()
    assert run(["compare", a, b, "--json", "--picture", str(tmp_path / "difference.png")]) == 1
    found = json.loads(capsys.readouterr().out)["images"]
    differ = {name for name, figures in found.items() if not figures["same"]}
    assert {"lobe_0.exr light.key", "lobe_1.exr irradiance", "irradiance.exr light.key", "sum of lobes"} <= differ
    assert not {name for name in differ if "lamp" in name}
    assert (tmp_path / "difference.png").stat().st_size > 10_000


def test_lobes_of_other_sizes_are_read_bilinearly(bake, capsys):
    """A bake that stores its wide lobe small is close to one that does not."""
    wide = ["--set", "texture.size=96", "--set", "skin.variance_mm2=[0.05, 30]"]
    a = bake("a", *wide, "--set", "diffusion.tolerance=1e-5")
    b = bake("b", *wide, "--set", "diffusion.tolerance=0.5")
    sizes = [[lobe["size"][0] for lobe in read_manifest(f)["lobes"]] for f in (a, b)]
    assert sizes[0][1] > sizes[1][1]
    assert run(["compare", a, b, "--relative", "0.5", "--absolute", "0.3", "--allowed", "0.1", "--worst", "100"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"lobe_1\.exr irradiance +rms \d", said)
    assert "shape" not in said


def test_info_tells_where_a_bake_came_from(bake, tmp_path, capsys):
    """Inputs with what became of them, lobes, plan, error; a rule for make; headers of a file."""
    folder = bake("a")
    assert run(["info", folder]) == 0
    said = capsys.readouterr().out
    assert re.search(r"mesh +as baked +[0-9a-f]{12}  .*mesh\.obj", said)
    assert re.search(r"lobe_1\.exr +1 mm\^2  surface", said)
    with open(tmp_path / "mesh.obj", "a") as file:
        file.write("# edited\n")
    assert run(["info", folder]) == 0
    assert re.search(r"mesh +changed", capsys.readouterr().out)
    assert run(["info", folder, "--make"]) == 0
    rule = capsys.readouterr().out.splitlines()
    assert rule == [f"{folder}/bake.json {folder}/irradiance.exr: {tmp_path}/mesh.obj", f"{tmp_path}/mesh.obj:"]
    (tmp_path / "mesh.obj").unlink()
    assert run(["info", folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["input_states"]["mesh"]["state"] == "missing"
    assert run(["info", f"{folder}/lobe_0.exr"]) == 0
    assert "skinbake:variance_mm2" in capsys.readouterr().out
    assert run(["info", str(tmp_path)]) == 2
