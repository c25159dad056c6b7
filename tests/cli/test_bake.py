"""Whole bakes through the command line."""

from __future__ import annotations

import hashlib
import json
import shutil

import numpy as np
import pytest
from scipy.special import erf

from skinbake.api import open_bake
from skinbake.cli import run
from skinbake.io.exr import Part, read_attributes, read_parts, rgb_channels, write_parts
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from tests.shapes import joined, quad, relief, sphere

LOOK = """\
mesh: {{path: mesh.obj, unit: mm, any_size: true}}
maps: {{albedo_rgb: [1, 1, 1]}}
texture: {{size: {size}, gutter: 4}}
skin: {{preset: gpugems3-six-gaussians}}
lights:
  - {{name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}}
  - {{name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}}
diffusion: {{method: surface, tolerance: 1.0, probes: 100}}
terms: {{energy_conservation: off, transmission: off}}
output: {{dir: out}}
"""


@pytest.fixture
def scene(tmp_path):
    """Write a mesh and a look beside each other; give the look's path."""

    def write(mesh=None, size=64, text=LOOK):
        write_obj(tmp_path / "mesh.obj", relief(segments=24) if mesh is None else mesh)
        (tmp_path / "look.yaml").write_text(text.format(size=size))
        return tmp_path / "look.yaml"

    return write


def bake(look, *more, verb="bake"):
    """Run a verb without a picture and give the bake folder."""
    quiet = ["--quiet"] + (["--no-preview"] if verb == "bake" else [])
    assert run([verb, str(look), *more, *quiet]) == 0
    return look.parent / "out"


def digests(folder):
    return {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in sorted(folder.glob("*.exr"))}


def test_a_bake_leaves_what_the_readme_says(scene):
    """Files, parts, channels, coverage and headers, everything finite and not negative."""
    out = bake(scene(size="[96, 64]"))
    manifest = json.loads((out / "bake.json").read_text())
    assert [lobe["file"] for lobe in manifest["lobes"]] == [f"lobe_{i}.exr" for i in range(6)]
    assert [lobe["variance_mm2"] for lobe in manifest["lobes"]] == [0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41]
    assert manifest["error"]["probes"] == 100
    assert {"method", "storage", "fit", "rms", "p95", "max"} <= set(manifest["error"])
    irradiance = read_parts(out / "irradiance.exr")
    assert list(irradiance) == ["irradiance", "light.key", "light.lamp"]
    np.testing.assert_allclose(irradiance["irradiance"].channels["A"], 1)  # the relief's chart fills the texture
    for lobe in manifest["lobes"]:
        parts = read_parts(out / lobe["file"])
        assert list(parts) == ["irradiance", "light.key", "light.lamp"]
        total = parts["light.key"].rgb + parts["light.lamp"].rgb
        np.testing.assert_allclose(parts["irradiance"].rgb, total, rtol=2e-3, atol=1e-5)
        assert list(parts["irradiance"].rgb.shape[1::-1]) == lobe["size"]
        header = parts["irradiance"].attributes
        assert header["skinbake:variance_mm2"] == pytest.approx(lobe["variance_mm2"])
        assert header["skinbake:weight_rgb"] == pytest.approx(lobe["weight_rgb"])
        assert json.loads(header["skinbake:inputs"])["mesh"] == manifest["inputs"]["mesh"]
        assert header["oiio:ColorSpace"] == "lin_rec709"
        for part in parts.values():
            assert np.isfinite(part.rgb).all()
            assert part.rgb.min() >= 0
    assert {p.name for p in out.iterdir()} >= {"profile.json", "profile.csv", "profile.png"}


@pytest.mark.parametrize("degrees", [0, 30, 60, 85])
def test_a_flat_quad_gets_the_cosine(scene, degrees):
    """E = cos on a 100 x 100 mm quad, to 1e-4."""
    x, z = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    look = scene(quad(), size=17)
    out = bake(
        look, "--set", f"lights.key.direction=[{-x}, 0, {-z}]", "--set", "output.precision=float", verb="irradiance"
    )
    key = read_parts(out / "irradiance.exr")["light.key"].rgb
    np.testing.assert_allclose(key, np.broadcast_to(z * np.array([1, 2, 3]), key.shape), atol=1e-4)


def test_half_a_shadow_becomes_the_error_function(scene, tmp_path):
    """A straight edge of light blurred with sigma = 1 mm is an erf: to 1e-3 across the texture, to 2e-3 in space.

    Eight texels a millimetre: the discrete Gaussian's own kurtosis, 1/t, is worth 1.3e-3 at five.
    """
    look = scene(quad(100, 100), size=800)
    edge = np.zeros((800, 800, 3), np.float32)
    edge[:, 400:] = 1
    write_parts(tmp_path / "edge.exr", [Part("", rgb_channels(edge))], precision="float")
    skin = "skin={model: gaussians, variance_mm2: [1.0], weight_rgb: [[1, 1, 1]]}"
    for method, limit in (("texture", 1e-3), ("surface", 2e-3)):
        chosen = [skin, f"diffusion.method={method}", "diffusion.tolerance=0.0005", "output.precision=float"]
        options = [word for key in chosen for word in ("--set", key)]
        assert run(["diffuse", str(look), str(tmp_path / "edge.exr"), *options, "--quiet"]) == 0
        lobe = read_parts(look.parent / "out" / "lobe_0.exr")["irradiance"].rgb
        n = lobe.shape[1]
        x_mm = ((np.arange(n) + 0.5) / n - 0.5) * 100
        want = (1 + erf(x_mm / np.sqrt(2))) / 2
        inside = slice(n // 10, -n // 10)
        got = lobe[inside, inside]
        np.testing.assert_allclose(got, np.broadcast_to(want[inside, None], got.shape), atol=limit, err_msg=method)


def test_bytes_do_not_depend_on_the_run_or_the_threads(scene, monkeypatch):
    """Two bakes, and a bake on one thread, write the same bytes; tests/cli/test_faults.py has processes do it."""
    look = scene(size="[70, 50]")
    found = []
    for threads in ("1", "2", "2"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        found.append(digests(bake(look, "--force")))
    assert len(found[0]) == 7
    assert found[0] == found[1] == found[2]


def test_stages_that_have_not_changed_are_not_run_again(scene):
    """A second bake takes everything as it is; another light is traced alone; a new skin leaves the light."""
    look = scene()
    fresh = {}

    def reused(*more):
        fresh[more] = digests(bake(look, *more))
        return set(json.loads((look.parent / "out" / "bake.json").read_text())["reused"])

    assert reused() == set()
    before = {f: f.stat().st_mtime_ns for f in (look.parent / "out").glob("*.exr")}
    assert {"profile", "irradiance", "diffuse"} <= reused()
    assert {f: f.stat().st_mtime_ns for f in before} == before
    skin = ("--set", "skin.preset=jensen-skin1")
    assert "irradiance" in reused(*skin)
    assert "irradiance" not in reused("--set", "lights.lamp.intensity=[1, 2, 3]")
    reused()
    assert fresh[()] == digests(bake(look, "--force"))


@pytest.mark.slow
@pytest.mark.parametrize(("tiles", "name"), [(1, "irradiance.exr"), (2, "irradiance.exr"), (2, "irradiance.1002.exr")])
def test_each_stage_runs_alone_on_files(scene, capsys, tiles, name):
    """irradiance, then diffuse on its file or on any of its tiles, is what bake does in one go."""
    look = scene(sphere(90.0, "latlong", 24, tiles=tiles))
    # Light that is given has no directions: slanted light is left as it is
    udim = ("--set", f"texture.udim={str(tiles > 1).lower()}", "--set", "terms.incidence=off")
    whole = digests(bake(look, *udim))
    capsys.readouterr()
    out = bake(look, *udim, "--out", str(look.parent / "apart"), verb="irradiance").parent / "apart"
    assert capsys.readouterr().out.splitlines() == [str(path) for path in sorted(out.glob("irradiance*.exr"))]
    arguments = ["diffuse", str(look), str(out / name), "--out", str(out), "--quiet", *udim]
    assert run(arguments) == 0
    for name in whole:
        ours, theirs = read_parts(look.parent / "out" / name), read_parts(out / name)
        for part in ours:
            np.testing.assert_array_equal(ours[part].rgb, theirs[part].rgb)


def test_what_was_reused_keeps_its_seconds_and_memory(scene):
    """A run that did nothing tells those of the run that did it; one that did a part adds its own."""
    path = scene(size=32).parent / "out" / "bake.json"
    look = path.parent.parent / "look.yaml"
    bake(look)
    manifest = json.loads(path.read_text())
    earlier = dict.fromkeys(manifest["timings"], 100.0) | {"total": 5000.0}
    path.write_text(json.dumps(manifest | {"timings": earlier, "peak_memory_mib": 1e6}))
    bake(look)
    again = json.loads(path.read_text())
    assert again["timings"] == earlier
    assert again["peak_memory_mib"] == 1e6
    bake(look, "--set", "diffusion.probes=90")
    part = json.loads(path.read_text())
    seconds = part["timings"]
    assert seconds["irradiance"] == 100
    assert seconds["diffuse"] < 100
    assert sum(seconds.values()) - seconds["total"] <= seconds["total"] < 300
    assert part["peak_memory_mib"] == 1e6
    bake(look, "--force")
    fresh = json.loads(path.read_text())
    assert fresh["timings"]["total"] < 100
    assert fresh["peak_memory_mib"] < 1e6


def test_a_damaged_manifest_is_written_anew(scene):
    """Whatever it lacks or has of another kind, the next bake does not."""
    look = scene(size=16)
    path = bake(look) / "bake.json"
    whole = json.loads(path.read_text())
    for key in ("version", "inputs", "plan", "error", "timings", "peak_memory_mib", "bytes", "lobes"):
        lacking = {name: value for name, value in whole.items() if name != key}
        for damaged in (lacking, lacking | {key: [5]}, [lacking]):
            path.write_text(json.dumps(damaged))
            bake(look)
            assert json.loads(path.read_text()).keys() == whole.keys(), key


def test_lobes_of_given_light_are_no_whole_bake(scene, tmp_path, capsys):
    """Neither in a folder of their own nor in place of a bake's, whose picture and light would be of other lobes."""
    look = scene()
    out = bake(look)
    light = tmp_path / "light.exr"
    shutil.copy(out / "irradiance.exr", light)
    for folder in (tmp_path / "apart", shutil.copytree(out, tmp_path / "over")):
        assert run(["diffuse", str(look), str(light), "--out", str(folder), "--quiet"]) == 0
        assert not (folder / "preview.png").exists()
        assert read_manifest(folder)["irradiance"] == []
        for verb in (["preview", folder, "--png", tmp_path / "a.png"], ["export", folder, "--web", "--to", tmp_path]):
            assert run(list(map(str, verb))) == 2
            said = capsys.readouterr().err
            assert "expected a whole bake, got lobes without the light that arrives" in said
            assert "of these lobes alone there are export --sum and --gltf" in said
        assert open_bake(folder).tiles == open_bake(out).tiles
        assert run(["export", str(folder), "--sum", "--gltf", "--to", str(folder / "sum"), "--quiet"]) == 0


def test_a_picture_of_light_is_no_light_of_ours_in_any_folder(scene, tmp_path, capsys):
    """One of somebody else's that has our name and lies where its lobes go: no verb takes it for a bake's."""
    look, folder = scene(size=32), tmp_path / "given"
    folder.mkdir()
    write_parts(folder / "irradiance.exr", [Part("", rgb_channels(np.ones((32, 32, 3), np.float32)))])
    assert run(["diffuse", str(look), str(folder / "irradiance.exr"), "--out", str(folder), "--quiet"]) == 0
    verbs = [["preview", folder, "--png", tmp_path / "a.png"]]
    verbs += [["export", folder, kind, "--to", tmp_path / "to"] for kind in ("--layers", "--web", "--blender")]
    for verb in verbs:
        assert run(list(map(str, verb))) == 2
        assert "got lobes without the light that arrives, as `skinbake diffuse` leaves" in capsys.readouterr().err


def test_terms_that_need_directions_are_told_to_be_left_out_of_given_light(scene, tmp_path, capsys):
    """In the table, by `info` and in the sentence of the API: their error is in no sum."""
    look = scene(size=32)
    out, light = bake(look), tmp_path / "light.exr"
    shutil.copy(out / "irradiance.exr", light)
    uncounted = "incidence, beam, curvature, diffuse_profile left out and not counted"
    assert uncounted not in open_bake(out).verdict
    capsys.readouterr()
    assert run(["diffuse", str(look), str(light), "--out", str(tmp_path / "given")]) == 0
    assert "but fit and model (`skinbake truth`), and for the terms without directions" in capsys.readouterr().err
    assert run(["info", str(tmp_path / "given")]) == 0
    assert f"beside   {uncounted}, as the light was given without directions" in capsys.readouterr().out
    assert uncounted in open_bake(tmp_path / "given").verdict


def test_any_irradiance_exr_can_be_diffused(scene, tmp_path):
    """Constant light from elsewhere stays constant to 1e-5 on any coverage, by every method."""
    mesh = joined(quad(60, 40, uv_box=(0.05, 0.1, 0.45, 0.8)), quad(30, 50, z_mm=200, uv_box=(0.6, 0.3, 0.93, 0.9)))
    look = scene(mesh, size="[61, 47]")
    constant = np.full((47, 61, 3), 0.7, np.float32)
    write_parts(tmp_path / "constant.exr", [Part("", rgb_channels(constant))], precision="float")
    for method in ("texture", "stretch", "hybrid", "surface", "reference"):
        options = ["--set", f"diffusion.method={method}", "--set", "output.precision=float", "--quiet"]
        assert run(["diffuse", str(look), str(tmp_path / "constant.exr"), *options]) == 0
        for path in (look.parent / "out").glob("lobe_*.exr"):
            lit = read_parts(path)["irradiance"].rgb
            assert lit.max() > 0
            np.testing.assert_allclose(lit[lit > 0], 0.7, rtol=1e-5, err_msg=f"{method} {path.name}")


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.full((64, 64, 3), -1.0), "expected values >= 0, got -1 at column 0, row 0"),
        (np.full((32, 64, 3), 1.0), "expected texture.size 64 x 64, got 64 x 32"),
    ],
)
def test_irradiance_that_cannot_be_used_is_refused(scene, tmp_path, capsys, image, message):
    """Exit code 2, the file and the texel named, nothing written."""
    look = scene()
    write_parts(tmp_path / "bad.exr", [Part("", rgb_channels(image.astype(np.float32)))])
    assert run(["diffuse", str(look), str(tmp_path / "bad.exr"), "--quiet"]) == 2
    assert message in capsys.readouterr().err
    assert not list((look.parent / "out").glob("lobe_*"))


def test_a_missed_tolerance_ends_with_1_and_says_what_would_help(scene, capsys):
    """Everything is written all the same."""
    look = scene()
    missed = ["--set", "diffusion.method=texture", "--set", "diffusion.tolerance=1e-4"]
    assert run(["bake", str(look), *missed, "--no-preview", "--quiet"]) == 1
    assert "tolerance 0.0001 missed" in capsys.readouterr().err
    assert (look.parent / "out" / "lobe_0.exr").is_file()


def test_headers_can_be_read_without_pixels(scene):
    """Provenance is there for other tools, too."""
    out = bake(scene(size=32))
    header = read_attributes(out / "lobe_0.exr")["irradiance"]
    assert header["size"] == [32, 32]
    assert header["skinbake:version"]
    assert json.loads(header["skinbake:error"])["probes"] == 100
