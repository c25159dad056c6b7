"""Two bakes compared: lobe by lobe, whatever their sizes, with a picture."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.exr import Part, read_parts, rgb_channels, write_parts
from skinbake.io.image import read_map
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from tests.cli.test_bad_input import save
from tests.cli.test_faults import LOOK
from tests.preview.bakes import write_bake
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


@pytest.mark.slow
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
    a = bake("a", *wide, "--set", "diffusion.tolerance=1e-4")
    b = bake("b", *wide, "--set", "diffusion.tolerance=0.5")
    sizes = [[lobe["size"][0] for lobe in read_manifest(f)["lobes"]] for f in (a, b)]
    assert sizes[0][1] > sizes[1][1]
    assert run(["compare", a, b, "--relative", "0.5", "--absolute", "0.3", "--allowed", "0.1", "--worst", "100"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"lobe_1\.exr irradiance +rms \d", said)
    assert "shape" not in said


def image(path, value=0.5, shape=(8, 9, 3)):
    return save(path, np.full(shape, value, np.float32))


def strict_json(text):
    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("option", ["--absolute", "--relative", "--allowed", "--worst"])
@pytest.mark.parametrize("value", ["nan", "inf", "-1"])
def test_a_limit_is_a_finite_number(tmp_path, capsys, option, value):
    """Any image would be the same as any other."""
    assert run(["compare", image(tmp_path / "a.exr", 0.2), image(tmp_path / "b.exr", 0.8), option, value]) == 2
    said = capsys.readouterr()
    assert f"Invalid value for '{option}'" in said.err
    assert not said.out


def test_what_has_nothing_in_common_cannot_be_compared(tmp_path, capsys):
    """Another size, or other names: one line and exit code 2, which is not that of a difference."""
    a, wider = image(tmp_path / "a.exr"), image(tmp_path / "wider.exr", shape=(8, 10, 3))
    assert run(["compare", a, wider, "--picture", str(tmp_path / "difference.png")]) == 2
    said = capsys.readouterr()
    assert said.err == f"skinbake: {a} and {wider}: expected images of one name and shape, " + (
        "got shape (8, 9, 3) against (8, 10, 3)\n"
    )
    assert not said.out
    assert run(["compare", a, wider, "--json"]) == 2
    assert strict_json(capsys.readouterr().out)["images"][""]["rms"] is None
    assert run(["compare", a, str(write_bake(tmp_path))]) == 2
    assert capsys.readouterr().err.endswith("got none of one name\n")


def test_the_verdict_comes_first(tmp_path, capsys):
    """One line, and in JSON one value: the same; or how much differs, and what most."""
    a, b = image(tmp_path / "a.exr"), image(tmp_path / "b.exr", 0.8)
    assert run(["compare", a, a]) == 0
    assert capsys.readouterr().out.startswith("same: 1 image within the limits\n")
    assert run(["compare", a, b]) == 1
    assert re.match(r"differs: 1 of 1 images; most the image: 0\.5 against 0\.8 at ", capsys.readouterr().out)
    for other, same in ((a, True), (b, False)):
        run(["compare", a, other, "--json"])
        assert next(iter(strict_json(capsys.readouterr().out).items())) == ("same", same)


def test_colours_are_shown_by_their_channels_names(tmp_path):
    """A light's part: R, G, B and how much of it is visible; a warm sun is warm, and equal images are black."""
    warm = np.broadcast_to(np.float32([1.0, 0.4, 0.05]), (30, 30, 3))
    part = Part("light.sun", rgb_channels(warm.copy()) | {"visibility": np.full((30, 30), 0.7, np.float32)})
    write_parts(tmp_path / "a.exr", [part])
    picture = tmp_path / "difference.png"
    assert run(["compare", str(tmp_path / "a.exr"), str(tmp_path / "a.exr"), "--picture", str(picture)]) == 0
    pixels = read_map(picture, 3, "linear")
    row = pixels[pixels.shape[0] // 2]
    panels = [row[round(at * len(row))] for at in (0.15, 0.5, 0.8)]
    for shown in panels[:2]:
        np.testing.assert_allclose(shown, np.array([1.0, 0.4, 0.05]) ** (1 / 2.2), atol=0.02)
    np.testing.assert_allclose(panels[2], 0, atol=0.02)


def test_a_picture_shows_the_images_that_differ_most(tmp_path, capsys):
    """A bake with tiles has more images than a picture has room for."""
    for name, off in (("a", 0), ("b", 1)):
        parts = [Part(f"p{k:03}", rgb_channels(np.full((4, 6, 3), 1 + off * k / 512, np.float32))) for k in range(160)]
        write_parts(tmp_path / f"{name}.exr", parts, precision="float")
    picture = tmp_path / "difference.png"
    files = [str(tmp_path / "a.exr"), str(tmp_path / "b.exr")]
    assert run(["compare", *files, "--picture", str(picture)]) == 1
    assert "difference.png: the 16 of 160 images that differ most" in capsys.readouterr().err
    assert cv2.imread(str(picture)).shape[0] < 8000


def test_folders_with_something_in_common_differ(tmp_path, capsys):
    """A file too few, or one of another size, is a difference where others could be compared; so is NaN."""
    for folder in "ab":
        (tmp_path / folder).mkdir()
        image(tmp_path / folder / "same.exr")
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    assert run(["compare", a, b]) == 0
    image(tmp_path / "a" / "other.exr")
    assert run(["compare", a, b]) == 1
    image(tmp_path / "b" / "other.exr", shape=(3, 3, 3))
    assert run(["compare", a, b]) == 1
    capsys.readouterr()
    image(tmp_path / "b" / "other.exr", np.nan)
    assert run(["compare", a, b, "--json"]) == 1
    assert strict_json(capsys.readouterr().out)["images"]["other.exr"]["max_absolute"] is None


@pytest.mark.parametrize(
    "key", ["version", "inputs", "plan", "error", "timings", "peak_memory_mib", "lights", "terms", "irradiance"]
)
def test_info_of_an_older_bake_leaves_out_what_it_lacks(tmp_path, capsys, key):
    """Keys that came later are not asked for; one of another kind is told in one line."""
    out = write_bake(tmp_path)
    manifest = read_manifest(out)
    (out / "bake.json").write_text(json.dumps({k: value for k, value in manifest.items() if k != key}))
    assert run(["info", str(out)]) == 0
    assert run(["info", str(out), "--json"]) == 0
    assert capsys.readouterr().out.startswith("skinbake ?, lights")
    (out / "bake.json").write_text(json.dumps(manifest | {key: 5 if key != "peak_memory_mib" else "5"}))
    assert run(["info", str(out)]) == 2
    assert re.fullmatch(rf"skinbake: \S+bake\.json: {key}: expected .*\n", capsys.readouterr().err)


def test_a_lobe_without_its_total_differs(bake, tmp_path, capsys):
    """As another tool may have written it: the rest is compared, but not what the lobes sum to."""
    first, second = bake("a"), bake("b")
    lobe = tmp_path / "b" / "lobe_0.exr"
    write_parts(lobe, [Part("light.key", rgb_channels(read_parts(lobe)["light.key"].rgb))])
    assert run(["compare", first, second]) == 1
    assert re.search(r"lobe_0\.exr irradiance +only in ", capsys.readouterr().out)


def test_info_of_a_path_that_cannot_be_one(tmp_path, capsys):
    """A NUL byte in a damaged manifest."""
    out = write_bake(tmp_path)
    manifest = read_manifest(out)
    manifest["config"]["mesh"]["path"] = "a\0b.obj"
    (out / "bake.json").write_text(json.dumps(manifest))
    assert run(["info", str(out)]) in (0, 2)
    assert "Traceback" not in capsys.readouterr().err


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
    said = capsys.readouterr().out
    assert said.count("skinbake:variance_mm2") == said.count("skinbake:diffusion") == 1  # not once for each light
    assert max(map(len, said.splitlines())) < 300
    assert said.partition("\nlight.lamp\n")[2].split()[:2] == ["name", "light.lamp"]
    assert run(["info", str(tmp_path)]) == 2


def test_bakes_of_other_texture_sizes_are_compared_on_the_skin(bake, capsys):
    """What is carried on beyond the charts is no difference; the light itself is read at the larger size, too."""
    soft = ["--set", "skin.variance_mm2=[40, 300]"]
    a, b = bake("a", *soft, "--set", "texture.size=96"), bake("b", *soft, "--set", "texture.size=48")
    run(["compare", a, b, "--json"])
    found = json.loads(capsys.readouterr().out)["images"]
    light = np.asarray(read_parts(a + "/irradiance.exr")["irradiance"].channels["G"], np.float32)
    assert 0 < found["irradiance.exr irradiance"]["rms"] < 0.1 * light.max()
    lobes = np.asarray(read_parts(a + "/lobe_1.exr")["irradiance"].channels["G"], np.float32)
    assert 0 < found["sum of lobes"]["rms"] < 0.03 * lobes.max()


def test_lobes_of_other_sizes_are_compared_on_the_skin(bake, tmp_path, capsys):
    """Around a chart that fills a quarter of the texture, a smaller size carries light on further: no difference."""
    mesh = relief(segments=24)
    write_obj(tmp_path / "mesh.obj", replace(mesh, corner_uv=0.25 + 0.5 * mesh.corner_uv))
    wide = ["--set", "texture.size=96", "--set", "skin.variance_mm2=[0.05, 30]", "--set", "texture.reduce=off"]
    a = bake("a", *wide, "--set", "diffusion.tolerance=1e-4")
    b = bake("b", *wide, "--set", "diffusion.tolerance=0.5", "--set", "terms.interreflection=off")
    sizes = [[lobe["size"][0] for lobe in read_manifest(f)["lobes"]] for f in (a, b)]
    assert sizes[0][1] > sizes[1][1]
    run(["compare", a, b, "--json"])
    found = json.loads(capsys.readouterr().out)["images"]
    beyond = [np.asarray(read_parts(f + "/lobe_1.exr")["irradiance"].channels["G"], np.float32) > 0 for f in (a, b)]
    assert beyond[1].mean() > 1.1 * beyond[0].mean()  # so that there is something to leave out
    assert found["lobe_1.exr irradiance"]["relative_rms"] < 0.02
