"""Pictures of what casts: for all of it, for some parts, or those of a glTF's own materials."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from skinbake.errors import ConfigError, InputError
from skinbake.io.config import load_look
from skinbake.io.fingerprint import input_files
from skinbake.io.manifest import portable_config, spec_of
from skinbake.io.mesh import read_look_mesh, write_obj
from skinbake.scene.casters import OPAQUE
from tests.gltf_files import Gltf, vertices_of
from tests.shapes import quad, sphere

LOOK = """\
mesh: {path: head.glb, unit: mm, skin: [Head], opacity: %s}
skin: {preset: gpugems3-six-gaussians}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""


def picture(alpha=None, grey=0):
    buffer = io.BytesIO()
    if alpha is None:
        Image.new("L", (2, 2), grey).save(buffer, "PNG")
    else:
        Image.fromarray(np.dstack([np.zeros((2, 2, 3), np.uint8), np.array(alpha, np.uint8)])).save(buffer, "PNG")
    return buffer.getvalue()


ALPHA = [[0, 51], [153, 255]]


def character(folder, bare=False, **materials):
    """head.glb: a head, and a card for each material, called after it; `bare` ones have no UVs."""
    made, nodes = Gltf(), []
    meshes = {"Head": sphere(120.0, "latlong", 12)} | {name: quad(z_mm=150.0 + k) for k, name in enumerate(materials)}
    for name, mesh in meshes.items():
        positions, uv, normals, faces = vertices_of(mesh)
        attributes = {"POSITION": made.accessor(positions), "NORMAL": made.accessor(normals)}
        if name == "Head" or not bare:
            attributes["TEXCOORD_0"] = made.accessor(uv)
        more = {"material": made.material(name=name, **materials[name](made))} if name in materials else {}
        nodes.append(
            {"name": name, "mesh": made.mesh(attributes, made.accessor(faces.ravel(), "I"), name=name, **more)}
        )
    made.tree["nodes"], made.tree["scenes"] = nodes, [{"nodes": list(range(len(nodes)))}]
    (folder / "head.glb").write_bytes(made.glb())


def casters(folder, opacity, *overrides):
    (folder / "look.yaml").write_text(LOOK % opacity)
    return read_look_mesh(load_look(folder / "look.yaml", overrides)).casters


def blended(made, **more):
    physical = {"baseColorTexture": made.image(picture(ALPHA)), **more.pop("physical", {})}
    return {"alphaMode": "BLEND", "pbrMetallicRoughness": physical, **more}


def test_alpha_of_materials(tmp_path):
    """BLEND as it is times its factor, MASK cut at its cutoff, OPAQUE whatever its picture holds."""
    character(
        tmp_path,
        Fringe=lambda made: blended(made, physical={"baseColorFactor": [1, 1, 1, 0.5]}),
        Lashes=lambda made: blended(made, alphaMode="MASK", alphaCutoff=0.6),
        Eyes=lambda made: blended(made, alphaMode="OPAQUE"),
        Veil=lambda made: {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 0.25]}},
    )
    found = casters(tmp_path, "file")
    assert found.image.tolist() == [0, 0, 1, 1, OPAQUE, OPAQUE, 2, 2]
    np.testing.assert_allclose(found.opacity[0], np.array(ALPHA) / 510, atol=1e-6)
    np.testing.assert_array_equal(found.opacity[1], [[0, 0], [1, 1]])
    np.testing.assert_allclose(found.opacity[2], [[0.25]])


@pytest.mark.parametrize("wrap", [{"wrapS": 33071}, {"wrapT": 33648}, {"wrapS": 10497, "wrapT": 10497}, {}])
@pytest.mark.parametrize("times", [1, 2])
def test_pictures_that_do_not_repeat_are_refused_outside(tmp_path, wrap, times):
    """A card whose UVs leave [0, 1] was lit as if its picture repeated there; within, all are alike."""

    def hair(made):
        material = blended(made)
        made.tree["samplers"] = [wrap]
        made.tree["textures"][-1]["sampler"] = 0
        texture = material["pbrMetallicRoughness"]["baseColorTexture"]
        texture["extensions"] = {"KHR_texture_transform": {"scale": [times, times]}}
        return material

    character(tmp_path, Hair=hair)
    name = {33071: "CLAMP_TO_EDGE", 33648: "MIRRORED_REPEAT"}.get(next(iter(wrap.values()), 0))
    if name and times > 1:
        with pytest.raises(InputError, match=rf"head\.glb: mesh\.opacity: file: Hair: expected .*REPEAT.* got {name}"):
            casters(tmp_path, "file")
    else:
        assert casters(tmp_path, "file").image.tolist() == [0, 0]


def test_glass_needs_no_uvs(tmp_path):
    """An alpha without a picture is the same everywhere."""
    character(
        tmp_path,
        bare=True,
        Glass=lambda made: {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}},
        Fringe=blended,
    )
    found = casters(tmp_path, "{Glass: file}")
    assert found.image.tolist() == [0, 0, OPAQUE, OPAQUE]
    np.testing.assert_allclose(found.opacity[0], [[0.25]])
    with pytest.raises(InputError, match=r"mesh\.opacity: expected UVs by which to look it up, Fringe has none"):
        casters(tmp_path, "file")


def test_a_picture_for_all_or_by_part(tmp_path):
    """One path for every caster; a mapping for those it names, others opaque; grey where there is no alpha."""
    character(tmp_path, Hair=blended, Hat=lambda made: {})
    (tmp_path / "a.png").write_bytes(picture(ALPHA))
    (tmp_path / "grey.png").write_bytes(picture(grey=102))
    found = casters(tmp_path, "a.png")
    assert found.image.tolist() == [0, 0, 0, 0]
    np.testing.assert_allclose(found.opacity[0], np.array(ALPHA) / 255, atol=1e-6)
    found = casters(tmp_path, '{"Ha?": grey.png}')
    assert found.image.tolist() == [OPAQUE, OPAQUE, 0, 0]
    np.testing.assert_allclose(found.opacity[0], np.full((2, 2), 0.4), atol=1e-6)
    found = casters(tmp_path, '{Hair: file, "Ha?": grey.png}')
    assert found.image.tolist() == [0, 0, 1, 1]


def test_an_occluder_s_own_alpha(tmp_path):
    """`opacity: file` of a hat from another file."""
    character(tmp_path, Hair=blended)
    write_obj(tmp_path / "skin.obj", sphere(120.0, "latlong", 12))
    hat = f"occluders=[{{path: {tmp_path}/head.glb, unit: mm, parts: [Hair], opacity: file}}]"
    found = casters(tmp_path, "{}", f"mesh.path={tmp_path}/skin.obj", "mesh.skin=[]", hat)
    assert found.image.tolist() == [0, 0]
    with pytest.raises(InputError, match=r"skin\.obj: occluders\.opacity: file: expected a glTF or GLB"):
        casters(
            tmp_path, "{}", "mesh.skin=[Head]", f"occluders=[{{path: {tmp_path}/skin.obj, unit: mm, opacity: file}}]"
        )


def test_slips_are_refused_by_name(tmp_path):
    """No such part, a part that is skin, a picture that is not there, casters without UVs."""
    character(tmp_path, Hair=blended)
    with pytest.raises(InputError, match=r"head\.glb: mesh\.opacity: no part is called 'Hat'; there are Head, Hair"):
        casters(tmp_path, "{Hat: file}")
    with pytest.raises(InputError, match=r"mesh\.opacity: expected parts that cast shadows, 'Head' names none"):
        casters(tmp_path, "{Head: file}")
    with pytest.raises(
        ConfigError, match=r"look\.yaml:1: mesh\.opacity\.Hair: expected a file, there is none at .*no\.png"
    ):
        casters(tmp_path, "{Hair: no.png}")
    with pytest.raises(ConfigError, match=r"mesh\.opacity: expected a mapping"):
        casters(tmp_path, "[a.png]")
    text = "o Head\nv 0 0 0\nv 99 0 0\nv 0 99 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\no Hair\nf 1 2 3\n"
    (tmp_path / "bare.obj").write_text(text)
    (tmp_path / "a.png").write_bytes(picture(ALPHA))
    with pytest.raises(InputError, match=r"mesh\.opacity: expected UVs by which to look it up, Hair has none"):
        casters(tmp_path, "a.png", f"mesh.path={tmp_path}/bare.obj")


def test_pictures_are_inputs_and_move_with_the_folder(tmp_path):
    """Their files are hashed, and paths in the manifest are relative; `file` stays what it is."""
    character(tmp_path, Hair=blended, Hat=blended)
    (tmp_path / "a.png").write_bytes(picture(ALPHA))
    (tmp_path / "look.yaml").write_text(LOOK % "{Hair: a.png, Hat: file}")
    spec = load_look(tmp_path / "look.yaml")
    assert input_files(spec)["occluder.mesh.0.opacity"] == (tmp_path / "a.png",)
    config = portable_config(spec, tmp_path / "out")
    assert config["mesh"]["opacity"] == {"Hair": "../a.png", "Hat": "file"}
    assert spec_of({"config": config}, tmp_path / "out") == spec
