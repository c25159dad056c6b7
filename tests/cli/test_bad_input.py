"""Bad input ends as one line that says what to do, with exit code 2 and nothing written."""

from __future__ import annotations

import os

import numpy as np
import OpenImageIO as oiio
import pytest
import yaml

from skinbake.cli import run
from skinbake.io.mesh import write_obj
from tests.shapes import quad


def save(path, pixels, kind=oiio.FLOAT):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.ascontiguousarray(pixels))
    out.close()
    return str(path)


def good(folder) -> dict:
    """A look that bakes."""
    write_obj(folder / "head.obj", quad(240.0, 200.0, columns=3, rows=3))
    return {
        "mesh": {"path": str(folder / "head.obj"), "unit": "mm"},
        "maps": {"albedo_rgb": [0.6, 0.4, 0.3]},
        "texture": {"size": 32},
        "skin": {"model": "gaussians", "variance_mm2": [0.5, 40.0], "weight_rgb": [[0.5] * 3, [0.5] * 3]},
        "lights": [{"name": "key", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
        "output": {"dir": str(folder / "out")},
    }


def put(look, dotted, value):
    *path, last = dotted.split(".")
    for key in path:
        look = look[int(key)] if key.isdigit() else look.setdefault(key, {})
    look[int(last) if last.isdigit() else last] = value


def obj(text):
    def change(look, folder):
        (folder / "head.obj").write_text(text)

    return change


def keyed(dotted, value):
    return lambda look, folder: put(look, dotted, value)


def image(dotted, name, pixels):
    return lambda look, folder: put(look, dotted, save(folder / name, np.asarray(pixels, np.float32)))


def as_file(dotted, name, data):
    def change(look, folder):
        (folder / name).write_bytes(data)
        put(look, dotted, str(folder / name))

    return change


def cut(look, folder):
    path = save(folder / "cut.exr", np.random.default_rng(0).random((64, 64, 3), dtype=np.float32))
    with open(path, "r+b") as file:
        file.truncate(os.path.getsize(path) // 2)
    put(look, "maps.albedo", path)


def metres(look, folder):
    write_obj(folder / "head.obj", quad(0.24, 0.2))


def other_uvs(change):
    def write(look, folder):
        mesh = quad(240.0, 200.0, columns=3, rows=3)
        write_obj(folder / "head.obj", type(mesh)(mesh.positions_mm, mesh.faces, change(mesh), mesh.corner_normal))

    return write


def off_the_tiles(look, folder):
    other_uvs(lambda mesh: mesh.corner_uv - [0.6, 0])(look, folder)
    put(look, "texture.udim", True)


def inside_a_file(look, folder):
    (folder / "taken").write_text("a file")
    put(look, "output.dir", str(folder / "taken" / "out"))


def no_sky(look, folder):
    look["lights"].append({"name": "sky", "type": "environment", "path": str(folder / "sky.exr")})


def black_nan(shape, where, value=np.nan):
    pixels = np.full(shape, 0.5, np.float32)
    pixels[where] = value
    return pixels


TRIANGLE = "v 0 0 0\nv 240 0 0\nv 0 200 0\n"
UVS = "vt 0 0\nvt 1 0\nvt 0 1\n"
LIGHT = {"name": "l", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}

# what is wrong: (change to the look, what the message must hold)
CASES = {
    "mesh missing": (keyed("mesh.path", "/nowhere/head.obj"), "mesh.path: expected a file, there is none at /nowhere"),
    "mesh is a text": (obj("dear diary"), "expected triangles, got none"),
    "mesh has no triangles": (obj(TRIANGLE), "expected triangles, got none"),
    "mesh has no uvs": (obj(TRIANGLE + "f 1 2 3\n"), "set texture.unwrap: xatlas"),
    "mesh has a nan vertex": (obj(TRIANGLE.replace("240", "nan") + UVS + "f 1/1 2/2 3/3\n"), "NaN or Inf"),
    "mesh has a nan uv": (obj(TRIANGLE + UVS.replace("vt 1 0", "vt nan 0") + "f 1/1 2/2 3/3\n"), "expected finite UVs"),
    "mesh names a vertex it lacks": (obj(TRIANGLE + UVS + "f 1/1 2/2 9/3\n"), "head.obj:7: f: expected a vertex"),
    "mesh in metres read as millimetres": (metres, "set mesh.unit: m (240 mm)"),
    "mesh in millimetres read as metres": (keyed("mesh.unit", "m"), "set mesh.unit: mm (240 mm)"),
    "mesh of an unknown kind": (as_file("mesh.path", "head.blend", b"BLENDER"), "expected a mesh file (.obj"),
    "uvs outside the texture": (other_uvs(lambda m: m.corner_uv + np.array([1.5, 0])), "set texture.udim: true"),
    "uvs off the tiles": (off_the_tiles, "head.obj: texture.udim: expected UVs on tiles 1001 to 9999"),
    "uvs without area": (other_uvs(lambda m: m.corner_uv * [1, 0]), "have no UV area"),
    "stacked charts": (other_uvs(lambda m: m.corner_uv[:1].repeat(len(m.faces), axis=0)), "share texels with others"),
    "unit unknown": (keyed("mesh.unit", "furlong"), "mesh.unit"),
    "unit twice": (keyed("mesh.mm_per_unit", 10), "exactly one of unit"),
    "unit zero": (keyed("mesh", {"path": "head.obj", "mm_per_unit": 0}), "mm_per_unit"),
    "map missing": (keyed("maps.albedo", "/nowhere/skin.png"), "maps.albedo: expected a file, there is none at /"),
    "map is text": (as_file("maps.albedo", "skin.exr", b"not an image"), "skin.exr: not an image that can be read"),
    "map is empty": (as_file("maps.roughness", "r.png", b""), "r.png"),
    "map is cut": (cut, "cut.exr: the image is cut or damaged"),
    "map holds nan": (image("maps.albedo", "a.exr", black_nan((8, 9, 3), (3, 5, 0))), "column 5, row 3"),
    "map holds inf": (image("maps.roughness", "r.exr", black_nan((8, 9, 1), (2, 7, 0), np.inf)), "column 7, row 2"),
    "albedo above 1": (image("maps.albedo", "a.exr", black_nan((4, 4, 3), (1, 2, 1), 3.0)), "from 0 to 1, got 3"),
    "albedo below 0": (image("maps.albedo", "a.exr", black_nan((4, 4, 3), (1, 2, 1), -1.0)), "from 0 to 1, got -1"),
    "constant albedo above 1": (keyed("maps.albedo_rgb", [1.5, 0, 0]), "maps.albedo_rgb"),
    "environment missing": (no_sky, "lights[1].path: expected a file, there is none at"),
    "negative light": (keyed("lights.0.irradiance", [-1, 0, 0]), "lights[0].irradiance"),
    "light without direction": (keyed("lights.0.direction", [0, 0, 0]), "a direction that is not zero"),
    "light whose direction underflows": (keyed("lights.0.direction", [1e-200, 0, 0]), "a direction that is not zero"),
    "light beyond single precision": (keyed("lights.0.irradiance", [1e39, 1, 1]), "lights[0].irradiance"),
    "view unknown": (keyed("preview.view", "topp"), "preview.view"),
    "picture too large": (keyed("preview.size", [32768, 512]), "preview.size"),
    "exposure too large": (keyed("preview.exposure", 1e9), "preview.exposure"),
    "background too bright": (keyed("preview.background_rgb", [1e39, 0, 0]), "preview.background_rgb"),
    "oil too bright": (keyed("specular.strength", 1e39), "specular.strength"),
    "light of unknown type": (keyed("lights.0.type", "laser"), "lights[0]"),
    "no lights": (keyed("lights", []), "lights"),
    "two lights of one name": (keyed("lights", [LIGHT, LIGHT]), "light names that differ"),
    "spot inside out": (
        keyed("lights.0", {"name": "s", "type": "spot", "position_mm": [0, 0, 9], "axis": [0, 0, -1],
                           "intensity": [1, 1, 1], "inner_deg": 40, "outer_deg": 30}),
        "inner_deg < outer_deg",
    ),
    "rectangle without area": (
        keyed("lights.0", {"name": "r", "type": "rectangle", "position_mm": [0, 0, 9], "edge_u_mm": [1, 1, 0],
                           "edge_v_mm": [2, 2, 0], "radiance": [1, 1, 1]}),
        "lights[0]: expected edges that span an area",
    ),
    "unknown key": (keyed("texture.sise", 512), "did you mean size"),
    "size zero": (keyed("texture.size", 0), "texture.size"),
    "size of text": (keyed("texture.size", "large"), "texture.size"),
    "negative variance": (keyed("skin.variance_mm2", [-1.0, 2.0]), "variance_mm2"),
    "layer without scattering": (
        keyed("skin", {"model": "dipole", "sigma_a_per_mm": [0, 0, 0], "sigma_sp_per_mm": [0, 0, 0]}),
        "sigma_sp_per_mm",
    ),
    "tolerance zero": (keyed("diffusion.tolerance", 0), "diffusion.tolerance"),
    "not finite": (keyed("specular.roughness", float("nan")), "specular.roughness"),
    "output inside a file": (inside_a_file, "taken"),
}  # fmt: skip


def cases():
    both = [(case, verb) for case in CASES for verb in ("check", "bake")]
    return [each for each in both if each != ("output inside a file", "check")]  # check writes nothing


def files_of(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(("case", "verb"), cases())
def test_bad_input_is_refused_in_one_line(tmp_path, capfd, case, verb):
    """Exit 2, one line that names what is wrong, no traceback, no file more than before."""
    change, message = CASES[case]
    look = good(tmp_path)
    change(look, tmp_path)
    (tmp_path / "look.yaml").write_text(yaml.safe_dump(look))
    before = files_of(tmp_path)
    options = ["--quiet"] + (["--no-preview"] if verb == "bake" else [])
    assert run([verb, str(tmp_path / "look.yaml"), *options]) == 2
    said = capfd.readouterr()
    assert message.lower() in said.err.lower()
    assert "Traceback" not in said.err
    assert len(said.err.strip().splitlines()) == 1
    assert files_of(tmp_path) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file"),
        ("", "look.yaml"),
        ("mesh: [unclosed", "look.yaml"),
        ("- a list", "look.yaml"),
        (b"\xff\xfe\x00binary", "look.yaml"),
    ],
)
def test_an_unreadable_look_is_refused(tmp_path, capfd, text, message):
    """No file, an empty one, broken YAML, a list, bytes: one line with the file's name."""
    path = tmp_path / "look.yaml"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert run(["check", str(path)]) == 2
    said = capfd.readouterr().err
    assert message.lower() in said.lower()
    assert "Traceback" not in said


def test_the_good_look_is_good(tmp_path):
    """The table's starting point bakes: its cases fail for what they change and for nothing else."""
    (tmp_path / "look.yaml").write_text(yaml.safe_dump(good(tmp_path)))
    assert run(["check", str(tmp_path / "look.yaml"), "--quiet"]) == 0
