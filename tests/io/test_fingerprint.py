"""What a look depends on is every file that it reads, and every file that those name."""

from __future__ import annotations

from skinbake.io.config import load_look
from skinbake.io.fingerprint import input_files, input_hashes
from tests.gltf_files import plain
from tests.shapes import sphere

LOOK = """\
mesh: {path: head.gltf, unit: mm}
skin: {preset: gpugems3-six-gaussians}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""


def test_files_that_a_gltf_names_are_inputs(tmp_path):
    """Another buffer or another picture beside the same .gltf is another mesh; what it does not name is not."""
    made, _ = plain(sphere(100.0, "latlong", 8))
    made.tree["images"] = [{"uri": "my%20skin.png"}]
    (tmp_path / "head.gltf").write_bytes(made.gltf("head.bin"))
    (tmp_path / "look.yaml").write_text(LOOK)
    named = (tmp_path / "head.bin", tmp_path / "my skin.png")
    for file in (*named, tmp_path / "other.bin"):
        file.write_bytes(bytes(made.data))
    spec = load_look(tmp_path / "look.yaml")
    assert input_files(spec)["mesh"] == (tmp_path / "head.gltf", *named)
    before = input_hashes(spec)
    (tmp_path / "other.bin").write_bytes(b"changed")
    assert input_hashes(spec) == before
    seen = {before["mesh"]}
    for file in named:
        file.write_bytes(bytes(made.data) + b"changed")
        seen.add(input_hashes(spec)["mesh"])
    assert len(seen) == 3


def test_tiles_are_told_by_their_number(tmp_path):
    """A tile that is alone and gets another number is another map; what its file is called besides is not."""
    (tmp_path / "head.gltf").write_bytes(plain(sphere(100.0, "latlong", 8))[0].gltf())
    (tmp_path / "look.yaml").write_text(LOOK + "texture: {udim: true}\nmaps: {albedo: 'skin.<UDIM>.png'}\n")
    (tmp_path / "skin.1001.png").write_bytes(b"picture")
    spec = load_look(tmp_path / "look.yaml")
    first = input_hashes(spec)["albedo"]
    (tmp_path / "skin.1001.png").rename(tmp_path / "skin.1002.png")
    assert input_hashes(spec)["albedo"] != first
    (tmp_path / "skin.1002.png").rename(tmp_path / "other.u1_v1.png")
    text = (tmp_path / "look.yaml").read_text().replace("skin.<UDIM>", "other.<UVTILE>")
    (tmp_path / "look.yaml").write_text(text)
    assert input_hashes(load_look(tmp_path / "look.yaml"))["albedo"] == first
