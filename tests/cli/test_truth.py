"""A bake against transport through the command line: files, groups, what is kept, what is refused."""

import json

import numpy as np
import pytest

from skinbake import open_bake
from skinbake.bilinear import read_bilinear
from skinbake.cli import run
from skinbake.cli.truth import _print
from skinbake.io.exr import Part, write_parts
from skinbake.io.mesh import write_obj
from skinbake.io.truth import WALKS, read_walks, write_walks
from skinbake.transport.model_error import rms_words
from tests.shapes import quad, sphere

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

LOOK = """\
mesh: {path: ball.obj, unit: mm, any_size: true}
texture: {size: 64, gutter: 2}
skin: {model: dipole, sigma_a_per_mm: [0.32, 1.7, 4.8], sigma_sp_per_mm: [7.4, 8.8, 10.1], eta: 1.0, normalise: none}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 2, 3]}
  - {name: sky, type: environment, radiance: [0.1, 0.1, 0.1]}
diffusion: {method: surface, tolerance: 1.0, probes: 50}
terms: {energy_conservation: off, incidence: on, beam: off, interreflection: off, transmission: off}
output: {dir: out}
"""


@pytest.fixture
def look(tmp_path):
    """A ball of 20 mm and a look of it."""
    write_obj(tmp_path / "ball.obj", sphere(20.0, "cube", 48))
    (tmp_path / "look.yaml").write_text(LOOK)
    return tmp_path / "look.yaml"


def test_a_ball_is_compared_and_taken_up_where_it_stopped(look, capsys):
    """truth.json has a record for each point and light, the manifest the distance; a second run walks no more."""
    command = ["truth", str(look), "--points", "16", "--walks", "96", "--json", "--quiet"]
    assert run(command) == 0
    said = json.loads(capsys.readouterr().out)
    out = look.parent / "out"
    truth = json.loads((out / "truth.json").read_text())
    assert len(truth["samples"]) == 32
    assert {"face", "barycentric", "light", "M", "stderr", "M_bake"} <= set(truth["samples"][0])
    assert {sample["light"] for sample in truth["samples"]} == {"key", "sky"}
    assert set(truth["split"]) == set(truth["without"]) == {"incidence"}
    assert truth["split"]["incidence"]["all"]["rms_rgb"][2] > 0
    # Lit skin of a large ball of dense medium: the bake is within the profile's and the slant's error of it
    lit = [s for s in truth["samples"] if "lit" in s["groups"] and s["light"] == "key"]
    ratio = [s["M_bake"][0] / s["M"][0] for s in lit]
    assert len(lit) >= 4
    assert 0.9 < np.median(ratio) < 1.05
    assert said["error"]["all"]["points"] == 16
    model = json.loads((out / "bake.json").read_text())["error"]["model"]
    assert set(model) >= {"rms", "rms_lit", "rms_edges", "stderr", "bias_rgb"}
    assert 0 <= model["rms"] < 0.15
    assert (out / "truth.png").stat().st_size > 5000
    assert list(model["taken_off_rgb"]) == ["incidence"]
    first = (out / "truth.json").read_bytes()

    # Half of the walks are lost: they are walked again to the same numbers
    with np.load(out / WALKS) as file:
        kept = {name: file[name] for name in file.files}
    key = str(kept["key"])
    done = np.arange(16) % 3 > 0
    blank = np.where(done[None, :, None, None], kept["mean"], 7.0)
    write_walks(out, key, done, blank, np.where(done[None, :, None, None], kept["stderr"], 7.0))
    assert run(command) == 0
    assert (out / "truth.json").read_bytes() == first
    found = read_walks(out, key)
    assert found is not None
    assert found["done"].all()
    assert read_walks(out, "another") is None

    # Walks know nothing of the Gaussians
    assert run([*command[:-1], "--set", "skin.fit={gaussians: 3}", "--set", "terms.incidence=off"]) == 0
    assert "16 points are there already" in capsys.readouterr().err
    assert read_walks(out, key) is not None


def test_maps_are_left_out_in_a_folder_of_their_own(look, capsys):
    """A white skin with a colour of its own is compared as its medium is, beside the look's own bake."""
    run(["truth", str(look), "--points", "2", "--walks", "16", "--quiet", "--set", "skin.normalise=white"])
    assert (look.parent / "out" / "truth" / "truth.json").is_file()
    assert not (look.parent / "out" / "bake.json").exists()
    baked = json.loads((look.parent / "out" / "truth" / "bake.json").read_text())
    assert baked["config"]["skin"]["normalise"] == "none"


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (["skin={preset: gpugems3-six-gaussians}"], "gives a profile and no medium"),
        (
            [
                "skin={layers: [{sigma_a_per_mm: 1, sigma_sp_per_mm: 9, thickness_mm: 0.2, eta: 1.3}, "
                "{sigma_a_per_mm: 1, sigma_sp_per_mm: 5}]}"
            ],
            "indices of refraction 1.3, 1.4",
        ),
        (["skin.scatter=0.5"], "got skin.scatter"),
        (["skin.sigma_sp_per_mm=0.001", "skin.sigma_a_per_mm=0.001"], "too clear"),
    ],
)
def test_what_cannot_be_walked_through_is_refused(look, capsys, overrides, reason):
    """Exit 2 and the reason, before anything is written."""
    assert run(["truth", str(look), "--quiet", *(f"--set={text}" for text in overrides)]) == 2
    assert reason in capsys.readouterr().err
    assert not (look.parent / "out").exists()


def test_a_skin_whose_width_varies_is_walked_and_baked(look, capsys):
    """A map that says the same everywhere is the key; of one with a step, points on both sides of it are told apart."""
    small = ["--points", "24", "--walks", "32", "--quiet", "--no-terms"]

    def measure(out, *more):
        assert run(["truth", str(look), *small, "--out", str(look.parent / out), *more]) == 0
        return json.loads((look.parent / out / "truth.json").read_text())

    write_parts(look.parent / "flat.exr", [Part("", {"Y": np.full((4, 4), 0.7, np.float32)})], precision="float")
    by_key, by_map = (
        measure("key", "--set", "skin.radius=0.7"),
        measure("map", "--set", f"maps.radius={look.parent / 'flat.exr'}"),
    )
    assert "skin changes" not in by_map["error"]
    for one, other in zip(by_key["samples"], by_map["samples"], strict=True):
        assert (one["face"], one["barycentric"]) == (other["face"], other["barycentric"])
        np.testing.assert_allclose(one["M"], other["M"], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(one["M_bake"], other["M_bake"], rtol=1e-3, atol=1e-5)

    widths = np.where(np.arange(64) < 32, 0.5, 1.5).astype(np.float32)
    write_parts(look.parent / "step.exr", [Part("", {"Y": np.tile(widths, (64, 1))})], precision="float")
    wide = "skin.sigma_a_per_mm=[0.064, 0.34, 0.96]", "skin.sigma_sp_per_mm=[1.5, 1.8, 2.0]"
    step = measure("step", *(f"--set={each}" for each in (f"maps.radius={look.parent / 'step.exr'}", *wide)))
    error = step["error"]
    assert error["skin changes"]["points"] >= 3
    assert error["skin even"]["points"] >= 1
    assert max(error["skin changes"]["rms_rgb"]) < 0.5
    # What the bake is taken to give off is what it says itself, by the weights of each place
    mesh, image = sphere(20.0, "cube", 48), open_bake(look.parent / "step").radiant_exitance()
    for sample, other in zip(step["samples"][::2], step["samples"][1::2], strict=True):
        b1, b2 = sample["barycentric"]
        u, v = np.array([1 - b1 - b2, b1, b2]) @ mesh.corner_uv[sample["face"]]
        want = read_bilinear(image[None], np.array([[1 - v, u]]))[0]
        np.testing.assert_allclose(np.add(sample["M_bake"], other["M_bake"]), want, rtol=0.01, atol=0.01)


def test_a_folder_that_cannot_be_written_to_is_told_before_the_walks(look, monkeypatch, capsys):
    """An open mesh makes no folder at all (below)."""
    monkeypatch.setattr("skinbake.baking.truth.light_leaving", lambda *_: pytest.fail("walked"))
    (look.parent / "out").mkdir()
    (look.parent / "out" / ".lock").symlink_to("elsewhere")
    assert run(["truth", str(look), "--quiet"]) == 2
    assert "expected a lock file, got a symbolic link" in capsys.readouterr().err


def test_an_open_mesh_is_refused_with_its_name(look, capsys):
    """Where the light would leave is told."""
    write_obj(look.parent / "ball.obj", quad(columns=4, rows=4))
    assert run(["truth", str(look), "--quiet"]) == 2
    assert "ball.obj: expected a closed mesh" in capsys.readouterr().err
    assert not (look.parent / "out").exists()


def test_what_shadows_the_skin_is_refused(look, capsys):
    """A bake is dark under a hat that no walk meets."""
    write_obj(look.parent / "hat.obj", quad(z_mm=40.0))
    assert run(["truth", str(look), "--quiet", f"--set=occluders=[{{path: {look.parent}/hat.obj, unit: mm}}]"]) == 2
    said = capsys.readouterr().err
    assert "ball.obj: truth: expected skin alone, got 2 triangles that only cast shadows" in said
    assert not (look.parent / "out").exists()


def test_the_model_s_error_stays_with_its_lobes(look, capsys):
    """A bake of the same look says it again, whatever its stages did; one of another skin does not know it."""
    run(["truth", str(look), "--points", "2", "--walks", "16", "--quiet", "--no-terms"])
    measured = json.loads((look.parent / "out" / "bake.json").read_text())["error"]["model"]
    capsys.readouterr()
    assert run(["bake", str(look), "--no-preview"]) == 0
    (verdict,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("verdict")]
    assert verdict.endswith(" % from light transport")
    assert run(["bake", str(look), "--no-preview", "--verbose"]) == 0
    said = capsys.readouterr().err
    assert (
        f"the model's error, against light transport, 2 points: rms {rms_words(measured['rms'], measured['stderr'])}"
        in said
    )
    assert "the blur's error, against the surface integral" in said
    assert json.loads((look.parent / "out" / "bake.json").read_text())["error"]["model"] == measured
    assert run(["info", str(look.parent / "out")]) == 0
    assert f"model    rms {rms_words(measured['rms'], measured['stderr'])}" in capsys.readouterr().out
    assert run(["bake", str(look), "--no-preview", "--force", "--set", "texturing.mode=post-scatter"]) == 0
    assert json.loads((look.parent / "out" / "bake.json").read_text())["error"]["model"] == measured
    assert run(["bake", str(look), "--no-preview", "--set", "skin.eta=1.1", "--set", "diffusion.probes=0"]) == 0
    assert "light transport not measured" in capsys.readouterr().err
    assert json.loads((look.parent / "out" / "bake.json").read_text())["error"] is None


def test_a_bake_is_not_told_the_error_of_another_skin(look):
    """A white skin is compared by its medium, beside the bake; one of another index leaves what the bake knows."""
    small = ["--points", "2", "--walks", "16", "--quiet", "--no-terms", "--set", "skin.normalise=white"]
    assert run(["bake", str(look), "--no-preview", "--quiet", "--set", "skin.normalise=white"]) == 0
    manifest = look.parent / "out" / "bake.json"
    run(["truth", str(look), *small, "--set", "skin.eta=1.2"])
    assert "model" not in json.loads(manifest.read_text())["error"]
    run(["truth", str(look), *small])
    assert json.loads(manifest.read_text())["error"]["model"]["points"] == 2


def test_a_bake_without_probes_has_the_model_s_error_alone(look, capsys):
    """Its manifest can be read again."""
    run(["truth", str(look), "--points", "2", "--walks", "16", "--quiet", "--no-terms", "--set", "diffusion.probes=0"])
    assert set(json.loads((look.parent / "out" / "bake.json").read_text())["error"]) == {"model"}
    assert run(["info", str(look.parent / "out")]) == 0
    said = capsys.readouterr().out
    assert "model    rms" in said
    assert "blur     rms" not in said


def test_tables_fit_a_terminal_and_say_where_few_points_are(capsys):
    """At most 100 letters with all terms and long figures; a group of 12 points is flagged, one of 40 is not."""
    wide = [-0.123, 0.234, 1.234]
    group = {"rms_rgb": wide, "stderr_rgb": [0.011, 0.1, 0.2], "bias_rgb": wide, "noise_rgb": wide}
    error = {"all": group | {"points": 1000}, "cast edges": group | {"points": 12}, "thin": group | {"points": 40}}
    share = {name: {"rms_rgb": wide, "stderr_rgb": wide} for name in error}
    terms = ("incidence", "beam", "curvature", "interreflection", "transmission", "diffuse_profile")
    _print(error, dict.fromkeys(terms, share))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    (flagged,) = (line for line in lines if "few: 12" in line)
    assert "cast edges" in flagged
    assert not any("few: 40" in line for line in lines)
    assert all(sum(term in line for line in lines) == len(error) for term in terms)
