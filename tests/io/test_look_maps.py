"""Maps that a mesh's own file holds: materials of glTF, colours of vertices."""

from __future__ import annotations

import base64
import io

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image

from skinbake.atlas import rasterize
from skinbake.diffuse.light_entering import albedo_of
from skinbake.errors import ConfigError, InputError
from skinbake.io.colour import srgb_to_linear
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from skinbake.io.scene_files import read_scene
from tests.gltf_files import Gltf, plain, vertices_of
from tests.images import save
from tests.shapes import joined, quad

LOOK = """\
mesh: {path: head.glb, unit: mm, any_size: true}
maps: file
texture: {size: 32}
skin: {preset: gpugems3-six-gaussians}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""
RGB = np.array([200, 130, 100]) / 255


def picture(rgb, kind="PNG"):
    buffer = io.BytesIO()
    Image.new("RGB", (8, 8), tuple(rgb)).save(buffer, kind, **({"quality": 100} if kind == "JPEG" else {}))
    return buffer.getvalue()


def scene(folder, *overrides, text=LOOK):
    (folder / "look.yaml").write_text(text)
    return read_scene(load_look(folder / "look.yaml", overrides), rays=False)


def head(folder, material, mesh=None):
    """head.glb of one part; `material` is called with the Gltf and gives the material."""
    made, _ = plain(mesh or quad())
    made.tree["meshes"][0]["primitives"][0]["material"] = made.material(**material(made))
    (folder / "head.glb").write_bytes(made.glb())


def whole(made):
    """A material with all that is taken."""
    return {
        "name": "skin",
        "pbrMetallicRoughness": {
            "baseColorTexture": made.image(picture([200, 130, 100])),
            "baseColorFactor": [0.5, 1.0, 0.25, 1.0],
            "metallicRoughnessTexture": made.image(picture([7, 128, 255])),
            "roughnessFactor": 0.5,
        },
        "normalTexture": made.image(picture([168, 87, 230])) | {"scale": 0.5},
        "occlusionTexture": made.image(picture([0, 0, 0])),
    }


def test_a_material_is_taken_with_its_factors(tmp_path):
    """Base colour from sRGB times linear factors; r = G times its factor, as Beckmann m = r^2; x and y times scale."""
    head(tmp_path, whole)
    maps = scene(tmp_path).maps
    np.testing.assert_allclose(maps.albedo[1001][3, 4], srgb_to_linear(RGB) * [0.5, 1, 0.25], rtol=1e-6)
    np.testing.assert_allclose(maps.roughness[1001], np.full((8, 8), (128 / 255 * 0.5) ** 2), rtol=1e-6)
    x, y, z = np.array([168, 87, 230]) / 255 * 2 - 1
    np.testing.assert_allclose(maps.normal[1001][0, 0], [0.5 * x, 0.5 * y, z], atol=1e-6)
    assert maps.normal_strength == 1
    assert not maps.specular


def test_what_was_taken_is_said(tmp_path):
    """By map, with the material's name, the picture and the factor."""
    head(tmp_path, whole)
    notes = scene(tmp_path).notes
    assert notes[0].startswith("maps.albedo: of the material skin: head.glb: image 0, 8 x 8, times (0.5, 1.0, 0.25)")
    assert [note.split(":")[0] for note in notes] == ["maps.albedo", "maps.normal", "maps.roughness"]


@pytest.mark.parametrize("where", ["buffer png", "buffer jpeg", "data uri", "file"])
def test_pictures_wherever_they_lie(tmp_path, where):
    """Within the GLB, in the JSON, or beside it under a percent-encoded name."""
    kind = "JPEG" if where == "buffer jpeg" else "PNG"
    data, uri = picture([200, 130, 100], kind), None
    if where == "data uri":
        uri = "data:image/png;base64," + base64.b64encode(data).decode()
    elif where == "file":
        (tmp_path / "my skin.png").write_bytes(data)
        uri = "my%20skin.png"
    mime = f"image/{kind.lower()}"
    head(tmp_path, lambda made: {"pbrMetallicRoughness": {"baseColorTexture": made.image(data, mime, uri)}})
    atol = 0.01 if kind == "JPEG" else 1e-6
    np.testing.assert_allclose(scene(tmp_path).maps.albedo[1001][2, 2], srgb_to_linear(RGB), atol=atol)


@pytest.mark.parametrize("mode", [None, "OPAQUE", "MASK", "BLEND"])
def test_alpha_says_nothing_in_an_opaque_material(tmp_path, mode):
    """Clear texels on a chart keep their colour there; in other materials they are filled from around them."""
    pixels = np.full((8, 8, 4), [200, 130, 100, 255], np.uint8)
    pixels[2:4, 4:] = [40, 90, 20, 0]  # half of the chart's rows, and what lies beside it
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    entry = {"alphaMode": mode} if mode else {}
    head(
        tmp_path,
        lambda made: {"pbrMetallicRoughness": {"baseColorTexture": made.image(buffer.getvalue())}, **entry},
        quad(uv_box=(0.25, 0.25, 0.75, 0.75)),
    )
    albedo = scene(tmp_path).maps.albedo[1001]
    paint, clear = srgb_to_linear(RGB), srgb_to_linear(np.array([40, 90, 20]) / 255)
    np.testing.assert_allclose(albedo[4:, :], np.broadcast_to(paint, (4, 8, 3)), rtol=1e-6)
    on_chart = albedo[2:4, 4:6]
    if mode in (None, "OPAQUE"):
        np.testing.assert_allclose(on_chart, np.broadcast_to(clear, (2, 2, 3)), rtol=1e-6)
    else:
        np.testing.assert_allclose(on_chart, np.broadcast_to(paint, (2, 2, 3)), rtol=1e-5)


def test_constants_of_a_material(tmp_path):
    """Factors without pictures are constant maps; a material that says nothing leaves the look's own values."""
    factors = {"baseColorFactor": [0.6, 0.4, 0.3, 1], "roughnessFactor": 0.5}
    head(tmp_path, lambda made: {"pbrMetallicRoughness": factors})
    maps = scene(tmp_path).maps
    np.testing.assert_allclose(maps.albedo[1001], [[[0.6, 0.4, 0.3]]], rtol=1e-6)
    np.testing.assert_allclose(maps.roughness[1001], [[0.25]])
    head(tmp_path, lambda made: {"name": "bare"})
    found = scene(tmp_path)
    assert not found.maps.albedo
    assert not found.maps.roughness
    assert found.notes == ("maps: file: its materials hold neither base colour, normals nor roughness",)


def test_a_map_of_the_look_goes_before_the_material_s(tmp_path):
    """`--set maps.albedo=...` beside `maps: file`, and in the mapping's long form."""
    head(tmp_path, whole)
    (tmp_path / "own.png").write_bytes(picture([0, 0, 0]))
    maps = scene(tmp_path, f"maps.albedo={tmp_path}/own.png").maps
    assert maps.albedo[1001].max() == 0
    assert maps.roughness
    longer = LOOK.replace("maps: file", "maps: {source: file, albedo: own.png}")
    assert scene(tmp_path, text=longer).maps.albedo[1001].max() == 0


def two_materials(folder, same, tiles=False, samplers=()):
    """Two parts side by side, each with its material; of one picture or two."""
    made = Gltf()
    made.tree["nodes"] = [{"mesh": 0}, {"mesh": 1}]
    made.tree["scenes"] = [{"nodes": [0, 1]}]
    images = [made.image(picture([200, 130, 100])), made.image(picture([50, 50, 50]))]
    if samplers:
        made.tree["samplers"] = samplers
        made.tree["textures"] = [texture | {"sampler": 0} for texture in made.tree["textures"]]
    for k, box in enumerate(((0, 0, 0.5, 1), (1, 0, 1.5, 1) if tiles else (0.5, 0, 1, 1))):
        positions, uv, normals, faces = vertices_of(quad(z_mm=30.0 * k, uv_box=box))
        attributes = {
            "POSITION": made.accessor(positions),
            "TEXCOORD_0": made.accessor(uv),
            "NORMAL": made.accessor(normals),
        }
        texture = images[0] if same else images[k]
        material = made.material(name=f"m{k}", pbrMetallicRoughness={"baseColorTexture": texture})
        made.mesh(attributes, made.accessor(faces.ravel(), "I"), name=f"part{k}", material=material)
    (folder / "head.glb").write_bytes(made.glb())


def test_several_materials(tmp_path):
    """One picture serves both; two are refused by name on one tile, and fall each on its own tile."""
    two_materials(tmp_path, same=True)
    assert len(scene(tmp_path).maps.albedo) == 1
    two_materials(tmp_path, same=False)
    with pytest.raises(InputError, match=r"head\.glb: maps: file: expected one albedo .* got those of m0, m1; choose"):
        scene(tmp_path)
    assert len(scene(tmp_path, "mesh.skin=part1").maps.albedo) == 1
    two_materials(tmp_path, same=False, tiles=True)
    albedo = scene(tmp_path, "texture.udim=true").maps.albedo
    np.testing.assert_allclose(albedo[1001][0, 0], srgb_to_linear(RGB), rtol=1e-6)
    np.testing.assert_allclose(albedo[1002][0, 0], srgb_to_linear(np.full(3, 50 / 255)), rtol=1e-6)


def test_a_tile_s_picture_must_repeat(tmp_path):
    """Past [0, 1] a picture that is clamped shows its edge, not what the next tile is baked with."""
    two_materials(tmp_path, same=False, tiles=True, samplers=[{"wrapS": 33071}])
    with pytest.raises(InputError, match=r"head\.glb: maps: file: m1: expected textures that repeat .*CLAMP_TO_EDGE"):
        scene(tmp_path, "texture.udim=true")
    (tmp_path / "own.1001.png").write_bytes(picture([0, 0, 0]))
    assert list(scene(tmp_path, "texture.udim=true", f"maps.albedo={tmp_path}/own.<UDIM>.png").maps.albedo) == [1001]
    assert len(scene(tmp_path, "mesh.skin=part0").maps.albedo) == 1


def test_what_the_look_names_is_not_asked_of_the_material(tmp_path):
    """As the message on a picture that is not supported says: a look that names another one bakes."""
    head(tmp_path, basis)
    (tmp_path / "own.png").write_bytes(picture([0, 0, 0]))
    assert scene(tmp_path, f"maps.albedo={tmp_path}/own.png").maps.albedo[1001].max() == 0


def other_uvs(made):
    texture = made.image(picture([128, 128, 255])) | {"texCoord": 1}
    return {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": made.image(picture([9, 9, 9]))},
            "normalTexture": texture}  # fmt: skip


def basis(made):
    texture = made.image(picture([9, 9, 9]))
    made.tree["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    return {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": texture}}


def cut(made):
    return {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": made.image(picture([9, 9, 9])[:60])}}


@pytest.mark.parametrize(
    ("material", "said"),
    [
        (other_uvs, r"skin: its normalTexture is read by other UVs than the mesh \(TEXCOORD_1, the mesh by TEXCOORD_0"),
        (basis, r"skin: baseColorTexture: expected a PNG or JPEG, got KTX2 pictures, which is not supported"),
        (cut, r"head\.glb: image 0: "),
        (
            lambda made: {"name": "skin", "extensions": {"KHR_materials_pbrSpecularGlossiness": {}}},
            "skin uses KHR_materials_pbrSpecularGlossiness, which is not supported",
        ),
        (
            lambda made: {"name": "skin", "pbrMetallicRoughness": {"baseColorFactor": [2, 0, 0, 1]}},
            r"skin: expected factors from 0 to 1, got \(2\.0, 0\.0, 0\.0\)",
        ),
        (lambda made: {"pbrMetallicRoughness": {"baseColorTexture": {}}}, r"head\.glb: damaged material"),
    ],
)
def test_materials_that_cannot_be_taken_are_refused_by_name(tmp_path, material, said):
    """And nothing of them is guessed; without `maps: file` they do no harm."""
    head(tmp_path, material)
    with pytest.raises(InputError, match=said):
        scene(tmp_path)
    assert not scene(tmp_path, text=LOOK.replace("maps: file\n", "")).maps.albedo


def test_made_uvs_know_no_picture(tmp_path):
    """A layout of `texture.unwrap` alone cannot be what a material's picture was painted for; with UVs it is read."""
    head(tmp_path, whole)
    assert scene(tmp_path, "texture.unwrap=xatlas").maps.albedo[1001].shape == (32, 32, 3)
    made, attributes = plain(quad())
    del attributes["TEXCOORD_0"]
    made.tree["meshes"][0]["primitives"][0]["material"] = made.material(**whole(made))
    (tmp_path / "head.glb").write_bytes(made.glb())
    with pytest.raises(InputError, match=r"head\.glb: maps\.albedo: was painted for UVs that the mesh does not have"):
        scene(tmp_path, "texture.unwrap=xatlas")


PLY = """\
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float u
property float v
property {kind} red
property {kind} green
property {kind} blue
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0 {rgb}
9 0 0 1 0 {rgb}
0 9 0 0 1 {rgb}
3 0 1 2
"""
OBJ = "v 0 0 0 {0}\nv 9 0 0 {0}\nv 0 9 0 {0}\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def write_coloured(folder, kind):
    """A triangle whose vertices have the sRGB colour 200 130 100; the path."""
    if kind.startswith("ply"):
        rgb, named = {"float": " ".join(map(str, RGB))}.get(kind[4:], "200 130 100"), kind[4:]
        (folder / "head.ply").write_text(PLY.format(kind=named, rgb=rgb))
        return folder / "head.ply"
    if kind == "obj":
        (folder / "head.obj").write_text(OBJ.format(" ".join(map(str, RGB))))
        return folder / "head.obj"
    made, attributes = plain(quad())
    linear = np.tile(srgb_to_linear(RGB), (6, 1))
    if kind == "glb float":
        attributes["COLOR_0"] = made.accessor(linear)
    else:
        rgba = np.rint(np.column_stack([linear, np.ones(6)]) * 65535)
        attributes["COLOR_0"] = made.accessor(rgba, "H", normalized=True)
    (folder / "head.glb").write_bytes(made.glb())
    return folder / "head.glb"


VERTICES = LOOK.replace("maps: file", "maps: {vertex_colors: true}")


@pytest.mark.parametrize("kind", ["ply uchar", "ply int", "ply uint", "ply float", "obj", "glb float", "glb ushort"])
def test_colours_of_vertices(tmp_path, kind):
    """sRGB in PLY and OBJ, linear in glTF: the same linear colour at every texel of the skin."""
    path = write_coloured(tmp_path, kind)
    found = scene(tmp_path, f"mesh.path={path}", text=VERTICES)
    (raster,) = rasterize(found.mesh, (32, 32), 2)
    texels = albedo_of(found.maps, raster, found.mesh)[raster.addressed]
    np.testing.assert_allclose(texels, np.broadcast_to(srgb_to_linear(RGB), texels.shape), atol=2e-5)


def test_colours_run_between_the_vertices(tmp_path):
    """Linearly: half way along an edge of black and white, half of white's light."""
    made, attributes = plain(quad())
    u = vertices_of(quad())[1][:, :1]
    attributes["COLOR_0"] = made.accessor(np.repeat(u, 3, axis=1))
    (tmp_path / "head.glb").write_bytes(made.glb())
    albedo = scene(tmp_path, text=VERTICES).maps.albedo[1001]
    np.testing.assert_allclose(albedo[:, :, 0], np.tile((np.arange(32) + 0.5) / 32, (32, 1)), atol=1e-6)


def test_colours_of_vertices_multiply_the_base_colour(tmp_path):
    """As glTF has it, where both are asked for."""
    made, attributes = plain(quad())
    attributes["COLOR_0"] = made.accessor(np.full((6, 3), 0.5))
    made.tree["meshes"][0]["primitives"][0]["material"] = made.material(**whole(made))
    (tmp_path / "head.glb").write_bytes(made.glb())
    albedo = scene(tmp_path, text=LOOK.replace("maps: file", "maps: {source: file, vertex_colors: true}")).maps.albedo
    np.testing.assert_allclose(albedo[1001][9, 9], srgb_to_linear(RGB) * [0.25, 0.5, 0.125], rtol=1e-5)


def test_colours_that_are_not_there_are_refused(tmp_path):
    """A mesh without any (nobody knows what seven numbers are), colours in part, beyond 1, an albedo map as well."""
    obj = f"mesh.path={tmp_path}/head.obj"
    for numbers in ("", "1 0.5 0.2 0.1"):
        (tmp_path / "head.obj").write_text(OBJ.format(numbers))
        with pytest.raises(InputError, match=r"head\.obj: maps\.vertex_colors: expected vertices with .* got none"):
            scene(tmp_path, obj, text=VERTICES)
    (tmp_path / "head.obj").write_text(OBJ.format("1 0.5 2"))
    with pytest.raises(InputError, match=r"expected colours from 0 to 1, got 0\.\d+ to \d"):
        scene(tmp_path, obj, text=VERTICES)
    (tmp_path / "head.obj").write_text("g nose\n" + OBJ.format("1 0 0").replace("v 9 0 0 1 0 0", "v 9 0 0"))
    with pytest.raises(InputError, match="expected colours of all skin, nose has none in 1 triangles"):
        scene(tmp_path, obj, text=VERTICES)
    with pytest.raises(ConfigError, match=r"maps: expected albedo or vertex_colors, got both"):
        scene(tmp_path, f"maps.albedo={tmp_path}/look.yaml", text=VERTICES)


def test_a_file_without_materials_is_refused(tmp_path):
    """OBJ has none that hold maps; any other word than `file` is no mapping."""
    write_coloured(tmp_path, "obj")
    with pytest.raises(InputError, match=r"head\.obj: maps: file: expected a glTF or GLB, .* got \.obj"):
        scene(tmp_path, f"mesh.path={tmp_path}/head.obj")
    with pytest.raises(ConfigError, match=r"look\.yaml:2: maps: expected a mapping of maps, or file"):
        scene(tmp_path, text=LOOK.replace("maps: file", "maps: fiel"))


def test_joined_parts_keep_their_colours(tmp_path):
    """Of two parts only one has colours: the other's are not a number, and nobody is asked about it as a caster."""
    made = Gltf()
    made.tree["nodes"] = [{"mesh": 0}, {"mesh": 1}]
    made.tree["scenes"] = [{"nodes": [0, 1]}]
    for k in range(2):
        positions, uv, normals, faces = vertices_of(joined(quad(z_mm=40.0 * k)))
        attributes = {
            "POSITION": made.accessor(positions),
            "TEXCOORD_0": made.accessor(uv),
            "NORMAL": made.accessor(normals),
        }
        if k == 0:
            attributes["COLOR_0"] = made.accessor(np.full((6, 3), 0.25))
        made.mesh(attributes, made.accessor(faces.ravel(), "I"), name=f"part{k}")
    (tmp_path / "head.glb").write_bytes(made.glb())
    with pytest.raises(InputError, match="part1 has none in 2 triangles"):
        scene(tmp_path, text=VERTICES)
    albedo = scene(tmp_path, "mesh.skin=part0", text=VERTICES).maps.albedo[1001]
    np.testing.assert_allclose(albedo, np.full((32, 32, 3), 0.25), atol=1e-6)


@pytest.mark.parametrize(("keys", "direction"), [("", (1, 2, 3)), ("up: z", (1, 3, -2)), ("front: -z", (-1, 2, -3))])
def test_normals_in_object_space_turn_with_the_mesh(tmp_path, keys, direction):
    """The map lies along the axes of the file, as the mesh does."""
    write_obj(tmp_path / "head.obj", quad())
    image = np.broadcast_to(np.float32([1, 2, 3]) / np.float32(14**0.5), (4, 4, 3))
    save(tmp_path / "n.exr", image, oiio.FLOAT)
    text = LOOK.replace("head.glb", "head.obj").replace("any_size: true", f"any_size: true, {keys}")
    text = text.replace("maps: file", "maps: {normal: {path: n.exr, space: object}}")
    np.testing.assert_allclose(
        scene(tmp_path, text=text).maps.normal[1001][2, 1], np.array(direction) / 14**0.5, atol=1e-6
    )
