"""`skinbake check` says what a bake would meet, and refuses what would spoil it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.cli.check import readable
from skinbake.cli.child_process import in_child
from skinbake.cli.measuring import own_peak_mib
from skinbake.io.mesh import write_obj
from tests.conftest import ROOT
from tests.images import flat_png, save
from tests.shapes import joined, quad, sphere

LOOK = """
mesh: {{path: {mesh}, unit: mm}}
texture: {{size: [96, 64]}}
skin: {{model: gaussians, variance_mm2: [0.05, 2.0], weight_rgb: [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]}}
lights: [{{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}}]
output: {{dir: {out}}}
"""


def look(folder, mesh):
    write_obj(folder / "mesh.obj", mesh)
    path = folder / "look.yaml"
    path.write_text(LOOK.format(mesh=folder / "mesh.obj", out=folder / "out"))
    return str(path)


def test_the_report_of_a_quad_is_what_geometry_says(tmp_path, capsys):
    """A 240 x 120 mm quad at 96 x 64: texels of 2.5 x 1.875 mm, fully covered, sigmas in texels, nothing written."""
    assert run(["check", look(tmp_path, quad(240.0, 120.0, columns=4, rows=4)), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["mesh"]["extent_mm"] == [240, 120, 0]
    assert report["mesh"]["triangles"] == 32
    assert report["uv"]["coverage"] == pytest.approx(1)
    texel = np.sqrt(2.5 * 1.875)
    np.testing.assert_allclose(report["uv"]["mm_per_texel_5_50_95"], [texel] * 3, rtol=1e-3)
    # Stretch is of UV, not of texels: 240 mm by 120 mm over a unit square
    assert report["uv"]["stretch_95"] == pytest.approx(2, rel=1e-3)
    sigmas = [lobe["sigma_texels"] for lobe in report["lobes"]]
    np.testing.assert_allclose(sigmas, np.sqrt([0.05, 2.0]) / texel, rtol=1e-2)
    assert report["faults"] == []
    assert "), 95 % stretch of UV 2.00\n" in readable(report)
    assert set(report["expected"]) == {"memory_mib", "seconds", "irradiance_mib", "lobes_mib"}
    assert not (tmp_path / "out").exists()


def test_the_text_names_all_of_it(tmp_path, capsys):
    """Without --json: a line for mesh, texture, texels, charts, lobes, the albedo that is not there, and cost."""
    path = look(tmp_path, sphere(100.0, "cube", 16))
    assert run(["check", path, "--set", "texture.size=1024"]) == 0
    out = capsys.readouterr().out.splitlines()
    told = [line.split()[0] for line in out]
    assert told == ["mesh", "box", "texture", "texel", "charts", "lobes", "note", "expected"]
    assert "maps.albedo: none, the skin is of one colour, albedo_rgb [0.57, 0.34, 0.25]" in out[-2]
    assert run(["check", path, "--set", "skin.normalise=none"]) == 0
    assert "albedo_rgb [1.00, 1.00, 1.00]" in capsys.readouterr().out


def test_texels_that_are_too_coarse_and_lights_that_reach_nothing_are_told(tmp_path, capsys):
    """Texels of 2 mm for lobes of 0.22 and 1.41 mm; with the size that is proposed nothing is told."""
    path = look(tmp_path, quad(240.0, 240.0))
    behind = ["--set", "lights.key.direction=[0,0,1]"]
    assert run(["check", path, "--set", "texture.size=[120, 120]", *behind]) == 0
    out = capsys.readouterr().out
    said = "your texels are 2 mm; detail below 0.82 mm, which this skin shows, is lost; texture.size: 960 would keep it"
    assert f"warning  {said}" in out
    assert out.splitlines()[-1].startswith(
        "warning  light key: reaches no skin: all skin faces away; direction is where"
    )
    assert run(["check", path, "--set", "texture.size=960"]) == 0
    assert "your texels" not in (out := capsys.readouterr().out)
    assert "reaches no skin" not in out


def test_triangles_count_in_memory_and_time(tmp_path, capsys, monkeypatch):
    """Those of what only casts, too."""
    monkeypatch.setenv("SKINBAKE_CACHE", str(tmp_path / "cache"))  # no pace of this machine
    monkeypatch.setattr("skinbake.baking.pace._first_guess", lambda: 1.0)
    path, found = look(tmp_path, quad(240.0, 120.0)), []
    write_obj(tmp_path / "hat.obj", quad(50, 50, 100, columns=100, rows=100))
    hat = f"occluders=[{{path: {tmp_path}/hat.obj, unit: mm}}]"
    for more in ([], ["--set", hat]):
        assert run(["check", path, "--json", *more]) == 0
        found.append(json.loads(capsys.readouterr().out)["expected"])
    assert found[1]["memory_mib"] - found[0]["memory_mib"] == pytest.approx(0.02 * 1400, abs=1)
    assert found[1]["seconds"] - found[0]["seconds"] == pytest.approx(0.02 * 9, abs=0.1)


def test_tiles_without_a_map_are_named(tmp_path, capsys):
    """By `check` and by `bake`: which file is not there, and what is used instead."""
    save(tmp_path / "skin.1001.png", np.full((4, 4, 3), 128, np.uint8))
    path = look(tmp_path, joined(quad(100, 100), quad(100, 100, 30, uv_box=(1.01, 0.01, 1.99, 0.99))))
    more = ["--set", "texture.udim=true", "--set", f"maps.albedo={tmp_path}/skin.<UDIM>.png"]
    said = "maps.albedo: no skin.1002.png: maps.albedo_rgb is used there"
    assert run(["check", path, *more]) == 0
    assert f"warning  {said}" in capsys.readouterr().out
    assert run(["irradiance", path, *more, "--set", "texture.size=16"]) == 0
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_maps_count_in_the_memory(tmp_path, capsys):
    """A map of 8192 x 8192 grey texels, five bytes each while it is read."""
    path = look(tmp_path, quad(240.0, 120.0))
    flat_png(tmp_path / "r.png", 8192, 8192)
    needed = []
    for more in ([], ["--set", f"maps.roughness={tmp_path}/r.png"]):
        assert run(["check", path, "--json", *more]) == 0
        needed.append(json.loads(capsys.readouterr().out)["expected"]["memory_mib"])
    # The map is let go before the bake needs 2 MiB of its own, which it needs without the map too
    assert needed[1] - needed[0] == pytest.approx(8192**2 * 5 / 2**20, abs=3)


def test_a_sky_counts_in_the_memory(tmp_path, capsys):
    """A picture of 4096 x 2048 half floats: as stored, and as float32, while it is read."""
    path = look(tmp_path, quad(240.0, 120.0))
    save(tmp_path / "sky.exr", np.ones((2048, 4096, 3), np.float16))
    needed = []
    for keys in ("radiance: [1, 1, 1]", "path: sky.exr"):
        sky = f"{{name: sky, type: environment, shadows: false, {keys}}}"
        (tmp_path / "look.yaml").write_text(
            LOOK.format(mesh=tmp_path / "mesh.obj", out=tmp_path / "out").replace(
                "}]\noutput", f"}}, {sky}]\noutput", 1
            )
        )
        assert run(["check", path, "--json"]) == 0
        needed.append(json.loads(capsys.readouterr().out)["expected"]["memory_mib"])
    assert 2048 * 4096 * 3 * 4 / 2**20 < needed[1] - needed[0] < 2048 * 4096 * 3 * 16 / 2**20


def test_a_texture_that_no_machine_holds_is_refused_before_it_is_rasterised(tmp_path, capsys, monkeypatch):
    """With what it would need, exit 3."""
    monkeypatch.setattr("os.sysconf", lambda name: 1 << 10)  # a megabyte in all
    assert run(["check", look(tmp_path, quad(240.0, 120.0)), "--set", "texture.size=4096"]) == 3
    assert "4096 x 4096 texels" in capsys.readouterr().err


@pytest.mark.parametrize(("mib", "said"), [(100, "MiB (this machine has 100), "), (10**6, "MiB, ")])
def test_memory_beyond_the_machine_s_is_marked(tmp_path, capsys, monkeypatch, mib, said):
    """A bake of the smallest texture takes some hundreds of megabytes."""
    monkeypatch.setattr("os.sysconf", lambda name: mib * 256 if "PAGES" in name else 4096)
    assert run(["check", look(tmp_path, quad(240.0, 120.0))]) == 0
    (expected,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("expected")]
    assert said in expected


def test_overlaps_spoil_a_bake_and_are_pictured(tmp_path, capsys):
    """Two charts on one place: exit 2, both counted, red in the picture."""
    from skinbake.io.image import read_map

    stacked = joined(quad(240, 200, uv_box=(0, 0, 0.5, 1)), quad(240, 200, 30, uv_box=(0.25, 0, 0.75, 1)))
    path = look(tmp_path, stacked)
    assert run(["check", path, "--out", str(tmp_path / "report")]) == 2
    message = capsys.readouterr().err
    assert "share texels with others (25.0% of the skin is hidden)" in message
    assert_refused(path, tmp_path, capsys, message)
    picture = read_map(tmp_path / "report" / "uv_check.png", 3, "linear")
    assert picture.shape == (64, 96, 3)
    red = (picture[..., 0] > 0.8) & (picture[..., 1] < 0.2)
    assert red[:, 25:47].mean() > 0.95


def assert_refused(path, folder, capsys, message):
    """`bake` and `irradiance` end as `check` does, with the same words, before they have made so much as a folder."""
    for verb in (["bake", "--no-preview"], ["irradiance"]):
        assert run([*verb, path, "--quiet"]) == 2
        assert capsys.readouterr().err == message
        assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda m: type(m)(m.positions_mm, m.faces, m.corner_uv + 1.5, m.corner_normal), "set texture.udim: true"),
        (lambda m: type(m)(m.positions_mm, m.faces, m.corner_uv * [0, 1], m.corner_normal), "have no UV area"),
        (
            lambda m: type(m)(m.positions_mm, m.faces[:, ::-1].copy(), m.corner_uv[:, ::-1], -m.corner_normal[:, ::-1]),
            "face inwards",
        ),
    ],
)
def test_what_would_spoil_a_bake_is_refused(tmp_path, capsys, spoil, message):
    """Charts outside the texture, without area, and a mesh turned inside out: exit 2 with the remedy, `bake` too."""
    path = look(tmp_path, spoil(sphere(100.0, "cube", 16)))
    assert run(["check", path]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert_refused(path, tmp_path, capsys, said)


def test_charts_that_touch_by_a_texel_do_not_spoil(tmp_path, capsys):
    """Two big quads that overlap by a texel are counted whole but hide little, and are baked."""
    touching = joined(quad(120, 200, uv_box=(0, 0, 0.505, 1)), quad(120, 200, 30, uv_box=(0.495, 0, 1, 1)))
    path, wide = look(tmp_path, touching), ["--set", "texture.size=[300, 64]"]
    assert run(["check", path, "--json", *wide]) == 0
    uv = json.loads(capsys.readouterr().out)["uv"]
    assert uv["overlapping"] == 4
    assert 0 < uv["overlapping_share"] < 0.01
    assert run(["bake", path, "--quiet", "--no-preview", "--set", "diffusion.tolerance=1", *wide]) == 0


HEADS = {
    "sample head": ("data/head.obj", 1.0, False),
    "Lee Perry-Smith": ("../shared/assets/lee_perry_smith/head.obj", 50.35, False),
    "ICT": ("../shared/assets/ict_facekit/ict_face_head_two_tiles.obj", 10.0, True),
    "canonical face": ("../shared/assets/mediapipe_canonical_face/canonical_face_model.obj", 10.0, False),
}


@pytest.mark.parametrize("size", [64, 1024])
@pytest.mark.parametrize("head", HEADS)
def test_real_heads_are_not_refused(head, size):
    """Scans and templates have a few flips, slivers and touching charts: none of that spoils a bake, at any size."""
    from skinbake.atlas import rasterize
    from skinbake.atlas.report import uv_report
    from skinbake.io.mesh import read_mesh

    name, mm_per_unit, udim = HEADS[head]
    if not (ROOT / name).exists():
        pytest.skip(f"{name} is not here")
    mesh = read_mesh(ROOT / name, mm_per_unit)
    assert uv_report(mesh, rasterize(mesh, (size, size), 4, udim)).faults == ()


def test_flipped_triangles_are_only_reported(tmp_path, capsys):
    """A mirrored chart is counted but does not spoil the bake."""
    right = quad(120, 200, uv_box=(0, 0, 0.6, 1))
    left = quad(100, 200, 40, uv_box=(0.7, 0, 1, 1))
    uv = left.corner_uv.copy()
    uv[..., 0] = 1.7 - uv[..., 0]
    mesh = joined(right, type(left)(left.positions_mm, left.faces, uv, left.corner_normal))
    assert run(["check", look(tmp_path, mesh), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["uv"]["flipped"] == 2
    assert report["uv"]["overlapping"] == 0


def bake_and_weigh(config: str) -> float:
    """Peak memory of a bake with its picture, MiB; for a process of its own."""
    assert run(["bake", config, "--quiet"]) == 0
    return own_peak_mib()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Machine code is made in another process than the one whose memory is measured."""
    out = tmp_path_factory.mktemp("compiled")
    head = str(ROOT / "configs" / "head_plain.yaml")
    in_child(run, ["bake", head, "--out", str(out), "--quiet", "--set", "texture.size=384"])


@pytest.mark.slow
@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("output", ["half, lights: separate", "float, lights: total"])
def test_what_is_expected_comes_true(tmp_path, capsys, output):
    """A bake of the sample head takes the memory and leaves the bytes that `check` said, within a factor 1.5."""
    config = tmp_path / "head.yaml"
    text = (ROOT / "configs" / "head_plain.yaml").read_text().replace("../data", str(ROOT / "data"))
    text = text.replace("../out/head_plain", str(tmp_path / "out")).replace("{dir:", f"{{precision: {output}, dir:")
    config.write_text(text.replace("size: 2048", "size: 384"))
    assert run(["check", str(config), "--json"]) == 0
    expected = json.loads(capsys.readouterr().out)["expected"]
    found = {"memory_mib": in_child(bake_and_weigh, str(config))}
    manifest = json.loads((tmp_path / "out" / "bake.json").read_text())
    mib = {name: size / 2**20 for name, size in manifest["bytes"].items()}
    found["irradiance_mib"] = sum(size for name, size in mib.items() if name.startswith("irradiance"))
    found["lobes_mib"] = sum(mib.values()) - found["irradiance_mib"]
    for name, value in found.items():
        assert 1 / 1.5 < expected[name] / value < 1.5, (name, expected[name], value)
