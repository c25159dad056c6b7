"""State of our own that is damaged counts as missing, and the next bake heals it."""

from __future__ import annotations

import json

import pytest

from skinbake.cli import run
from skinbake.io.mesh import write_obj
from skinbake.preview.setup_gl import renderer_name
from tests.cli.test_faults import contents
from tests.shapes import quad

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

LOOK = """\
mesh: {path: mesh.obj, unit: mm}
texture: {size: 16}
skin: {model: gaussians, variance_mm2: [4.0, 60.0], weight_rgb: [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: sky, type: environment, radiance: [1, 2, 3], samples: 16}
diffusion: {probes: 20, tolerance: 0.5}
terms: {interreflection: off, transmission: off}
output: {dir: out}
preview: {size: [24, 30]}
"""


@pytest.fixture
def bake(tmp_path):
    """Bake, with a picture or without, and give every file's digest."""
    write_obj(tmp_path / "mesh.obj", quad(240, 200))
    (tmp_path / "look.yaml").write_text(LOOK)

    def go(*more):
        assert run(["bake", str(tmp_path / "look.yaml"), "--quiet", *more]) == 0
        return contents(tmp_path / "out")

    return go


def replaced(path, start, old, new):
    """Replace, once, what follows `start`; headers have lengths, which stay."""
    data = path.read_bytes()
    at = data.index(old, data.index(start))
    assert len(old) == len(new)
    path.write_bytes(data[:at] + new + data[at + len(old) :])


@pytest.mark.parametrize(
    ("file", "attribute", "old", "new"),
    [
        ("irradiance.exr", b"skinbake:plan\0", b"[", b"{"),
        ("irradiance.exr", b"skinbake:plan\0", b'"kept": ', b'"kept": 5'[:8]),
        ("irradiance.exr", b"skinbake:plan\0", b'"why"', b'"who"'),
        ("lobe_0.exr", b"skinbake:diffusion\0", b'"plan"', b'"plot"'),
        ("lobe_0.exr", b"skinbake:diffusion\0", b'"term"', b'"turm"'),
        ("lobe_0.exr", b"skinbake:diffusion\0", b"{", b"["),
        ("lobe_1.exr", b"skinbake:key\0", b"string\0", b"double\0"),
    ],
)
def test_a_damaged_header_is_made_anew(bake, tmp_path, file, attribute, old, new):
    """Of the same bytes as before, also where another light is stale meanwhile."""
    want = bake("--no-preview")
    replaced(tmp_path / "out" / file, attribute, old, new)
    bake("--no-preview", "--set", "lights.key.irradiance=[2, 2, 2]")
    replaced(tmp_path / "out" / file, attribute, old, new)
    assert bake("--no-preview") == want


@pytest.mark.parametrize("damaged", ["", "5", "[[[", '{"key": []}', "[" * 20000, "null"])
def test_a_damaged_fit_is_made_anew(bake, tmp_path, damaged):
    """Of every kind."""
    want = bake("--no-preview")
    (tmp_path / "out" / "profile.json").write_text(damaged)
    assert bake("--no-preview") == want
    record = json.loads((tmp_path / "out" / "profile.json").read_text())
    for key in ("variance_mm2", "weight_rgb", "relative_error_rgb", "energy_rgb"):
        for value in (None, [], "a", [None], [["a"]], {"a": 1}):
            (tmp_path / "out" / "profile.json").write_text(json.dumps(record | {key: value}))
            assert bake("--no-preview") == want, (key, value)
            if damaged:
                break


@pytest.mark.parametrize("note", [b"", b"\xff\xfe", b"one", b"a b c d", b"\0" * 100])
def test_a_damaged_note_of_the_picture_is_written_anew(bake, tmp_path, note):
    """`.preview` says what the picture was drawn of; else it is drawn again."""
    if renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    want = bake()
    (tmp_path / "out" / ".preview").write_bytes(note)
    assert bake() == want
