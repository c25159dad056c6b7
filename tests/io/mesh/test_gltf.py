"""glTF is read as its specification says, whatever wrote the file: each way to say one head gives that head."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.mesh import mesh_files, read_mesh
from skinbake.numerics import normalized
from tests.gltf_files import Gltf, plain, vertices_of
from tests.shapes import quad, sphere

HEAD = sphere(100.0, "latlong", 10)


def read(folder, made, **options):
    path = folder / "head.glb"
    path.write_bytes(made.glb())
    return read_mesh(path, options.pop("mm_per_unit", 1.0), **options)


def assert_same(got, wanted=HEAD, position_mm=1e-3, uv=1e-6, normal=1e-5):
    assert got.faces.shape == wanted.faces.shape
    np.testing.assert_allclose(got.corner_position_mm, wanted.corner_position_mm, atol=position_mm)
    np.testing.assert_allclose(got.corner_uv, wanted.corner_uv, atol=uv)
    np.testing.assert_allclose(got.corner_normal, wanted.corner_normal, atol=normal)


def test_plain_floats(tmp_path):
    """Float attributes and an index give the mesh they were made from, UV seams welded in space."""
    got = read(tmp_path, plain(HEAD)[0])
    assert_same(got)
    assert got.positions_mm.shape == HEAD.positions_mm.shape


def test_uvs_without_material_and_of_any_set(tmp_path):
    """No material is needed for UVs; uv_set chooses a set, else the base colour's texCoord does."""
    made, attributes = plain(HEAD)
    other = vertices_of(HEAD)[1] * 0.5
    attributes["TEXCOORD_3"] = made.accessor(other)
    half = HEAD.corner_uv * [0.5, 0.5] + [0, 0.5]
    assert_same(read(tmp_path, made))
    np.testing.assert_allclose(read(tmp_path, made, uv_set=3).corner_uv, half, atol=1e-6)
    primitive = made.tree["meshes"][0]["primitives"][0]
    primitive["material"] = made.material(pbrMetallicRoughness={"baseColorTexture": {"index": 0, "texCoord": 3}})
    np.testing.assert_allclose(read(tmp_path, made).corner_uv, half, atol=1e-6)
    assert_same(read(tmp_path, made, uv_set=0))
    with pytest.raises(InputError, match=r"mesh\.uv_set: expected UVs of a set that the file has, got 1"):
        read(tmp_path, made, uv_set=1)


@pytest.mark.parametrize(("kind", "scale"), [("H", 65535), ("B", 255)])
def test_normalised_integers(tmp_path, kind, scale):
    """UVs as unsigned integers from 0 to 1, normals as signed bytes."""
    made, attributes = plain(HEAD)
    _, uv, normals, _ = vertices_of(HEAD)
    attributes["TEXCOORD_0"] = made.accessor(np.round(uv * scale), kind, normalized=True)
    attributes["NORMAL"] = made.accessor(np.round(normals * 127), "b", normalized=True)
    assert_same(read(tmp_path, made), uv=0.6 / scale, normal=0.01)


def test_quantised_positions(tmp_path):
    """KHR_mesh_quantization: positions as plain or normalised integers, undone by the node's scale."""
    made, attributes = plain(HEAD)
    positions = vertices_of(HEAD)[0]
    made.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    attributes["POSITION"] = made.accessor(np.round(positions * 100), "h")
    made.tree["nodes"][0]["scale"] = [0.01] * 3
    assert_same(read(tmp_path, made), position_mm=0.006)
    attributes["POSITION"] = made.accessor(np.round(positions / 128 * 32767), "h", normalized=True)
    made.tree["nodes"][0]["scale"] = [128.0] * 3
    assert_same(read(tmp_path, made), position_mm=0.003)


def test_interleaved_and_sparse(tmp_path):
    """A stride over interleaved attributes; a sparse accessor that moves a few vertices, with and without a base."""
    made, attributes = plain(HEAD)
    positions, uv, _, _ = vertices_of(HEAD)
    both = np.concatenate([positions, uv], axis=1).astype("<f4")
    view = made.view(both.tobytes(), byteStride=20)
    attributes["POSITION"] = made.accessor(positions, view=view)
    attributes["TEXCOORD_0"] = made.accessor(uv, view=view, byteOffset=12)
    assert_same(read(tmp_path, made))
    moved = [3, 30, 31]
    broken = positions.copy()
    broken[moved] = 7.0
    attributes["POSITION"] = made.accessor(broken)
    sparse = {
        "count": 3,
        "indices": {"bufferView": made.view(np.array(moved, "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": made.view(positions[moved].astype("<f4").tobytes())},
    }
    made.tree["accessors"][-1]["sparse"] = sparse
    assert_same(read(tmp_path, made))
    del made.tree["accessors"][-1]["bufferView"]
    whole = np.arange(len(positions), dtype="<u2")
    sparse.update(count=len(positions), indices={"bufferView": made.view(whole.tobytes()), "componentType": 5123})
    sparse["values"] = {"bufferView": made.view(positions.astype("<f4").tobytes())}
    assert_same(read(tmp_path, made))


def test_strips_and_fans(tmp_path):
    """A strip alternates its turn, a fan shares its first vertex, no index counts up: same area, all facing up."""
    points = np.array([[0, 0, 0], [0, 100, 0], [100, 0, 0], [100, 100, 0], [200, 0, 0], [200, 100, 0]], float)
    strip, fan = [1, 0, 3, 2, 5, 4], [3, 1, 0, 2, 4, 5]
    for mode, order, indexed in ((5, strip, True), (5, strip, False), (6, fan, True), (6, fan, False)):
        made = Gltf()
        rows = points if indexed else points[order]
        attributes = {"POSITION": made.accessor(rows), "TEXCOORD_0": made.accessor(rows[:, :2] / 200)}
        made.mesh(attributes, made.accessor(order, "H") if indexed else None, mode=mode)
        got = read(tmp_path, made)
        assert got.face_area_mm2.sum() == pytest.approx(20000)
        np.testing.assert_allclose(got.face_normal, np.broadcast_to([0, 0, 1.0], got.face_normal.shape))
        np.testing.assert_allclose(got.corner_uv[..., 0], got.corner_position_mm[..., 0] / 200, atol=1e-6)


def test_texture_transform(tmp_path):
    """KHR_texture_transform: offset, rotation and scale as applied by the specification's own sample, T R S, v down."""
    made, _ = plain(HEAD)
    angle, scale, offset = 0.3, np.array([0.4, 0.2]), np.array([0.3, 0.4])
    extension = {"offset": offset.tolist(), "rotation": angle, "scale": scale.tolist()}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": extension}}
    made.tree["extensionsRequired"] = ["KHR_texture_transform"]
    made.tree["meshes"][0]["primitives"][0]["material"] = made.material(
        pbrMetallicRoughness={"baseColorTexture": texture}
    )
    u, v = (HEAD.corner_uv * [1, -1] + [0, 1]).reshape(-1, 2).T * scale[:, None]
    # Counter-clockwise as seen on the picture, whose v runs down: (1, 0) turns towards (0, -1)
    turned = np.stack([np.cos(angle) * u + np.sin(angle) * v, -np.sin(angle) * u + np.cos(angle) * v], axis=1) + offset
    got = read(tmp_path, made).corner_uv.reshape(-1, 2)
    np.testing.assert_allclose(got, np.stack([turned[:, 0], 1 - turned[:, 1]], axis=1), atol=1e-6)


def armature(made, attributes, matrices, joint_of, weights=None):
    """Add a skin: joints are nodes 1, 2, ... with the given inverse bind matrices."""
    count = len(joint_of)
    attributes["JOINTS_0"] = made.accessor(np.stack([joint_of, *[np.zeros(count)] * 3], axis=1), "B")
    weights = np.stack([np.ones(count), *[np.zeros(count)] * 3], axis=1) if weights is None else weights
    attributes["WEIGHTS_0"] = made.accessor(weights)
    columns = np.stack([np.asarray(m).T.ravel() for m in matrices])
    made.tree["skins"] = [{"joints": list(range(1, 1 + len(matrices))), "inverseBindMatrices": made.accessor(columns)}]
    made.tree["nodes"][0]["skin"] = 0
    made.tree["nodes"] += [{"name": f"bone {i}"} for i in range(len(matrices))]


def test_a_skinned_head_stands(tmp_path):
    """An Armature turned by 90 degrees that the inverse bind matrices undo: the node's own place does not count."""
    made, attributes = plain(HEAD)
    turn = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    armature(made, attributes, [np.linalg.inv(turn)], np.zeros(len(HEAD.faces) * 3))
    half = float(np.sqrt(0.5))
    made.tree["nodes"].append({"name": "Armature", "rotation": [0, 0, half, half], "children": [0, 1]})
    made.tree["nodes"][0]["translation"] = [500.0, 0, 0]
    made.tree["scenes"][0]["nodes"] = [2]
    got = read(tmp_path, made)
    assert_same(got)
    assert got.positions_mm.shape == HEAD.positions_mm.shape


def test_joints_move_what_they_hold(tmp_path):
    """Two joints that share vertices half and half: positions blend linearly, normals by the inverse transpose."""
    made, attributes = plain(HEAD)
    count = len(HEAD.faces) * 3
    armature(made, attributes, [np.eye(4), np.eye(4)], np.zeros(count))
    attributes["JOINTS_0"] = made.accessor(np.tile([0, 1, 0, 0], (count, 1)), "B")
    attributes["WEIGHTS_0"] = made.accessor(np.tile([32768, 32768, 0, 0], (count, 1)), "H", normalized=True)
    made.tree["nodes"][1]["scale"] = [2.0, 1, 1]
    made.tree["nodes"][2]["translation"] = [0, 50.0, 0]
    made.tree["scenes"][0]["nodes"] = [0, 1, 2]
    got = read(tmp_path, made)
    np.testing.assert_allclose(
        got.corner_position_mm, HEAD.corner_position_mm * [1.5, 1, 1] + [0, 25, 0], rtol=1e-5, atol=1e-3
    )
    np.testing.assert_allclose(got.corner_normal, normalized(HEAD.corner_normal / [1.5, 1, 1]), atol=1e-4)


def test_morph_weights(tmp_path):
    """Default weights of the mesh, or those of the node, add their targets' positions."""
    made, _ = plain(HEAD)
    up = np.tile([0, 10.0, 0], (len(HEAD.faces) * 3, 1))
    made.tree["meshes"][0]["primitives"][0]["targets"] = [
        {"POSITION": made.accessor(up)},
        {"POSITION": made.accessor(up * -3)},
    ]
    assert_same(read(tmp_path, made))
    made.tree["meshes"][0]["weights"] = [0.5, 0]
    rows = read(tmp_path, made).corner_position_mm
    np.testing.assert_allclose(rows, HEAD.corner_position_mm - [0, -5, 0], atol=1e-3)
    made.tree["nodes"][0]["weights"] = [0.5, 0.25]
    np.testing.assert_allclose(
        read(tmp_path, made).corner_position_mm, HEAD.corner_position_mm - [0, 2.5, 0], atol=1e-3
    )


def test_nodes_place_and_mirror(tmp_path):
    """Parents' transforms multiply; a mirrored node still has its triangles outside."""
    made, _ = plain(HEAD)
    made.tree["nodes"] = [
        {"children": [1], "translation": [10, 0, 0]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
    ]
    got = read(tmp_path, made)
    assert got.positions_mm.min(axis=0) == pytest.approx([-90, -200, -95], abs=1e-3)
    outwards = got.corner_position_mm.mean(axis=1) - [10, 0, 5]
    assert (np.einsum("ij,ij->i", got.face_normal, outwards) > 0).all()
    assert (np.einsum("ij,ij->i", got.corner_normal[:, 0], outwards) > 0).all()


def test_only_the_default_scene(tmp_path):
    """Nodes of other scenes are not read; without scenes every root is."""
    made, _ = plain(HEAD)
    made.tree["nodes"] += [{"mesh": 0, "translation": [400.0, 0, 0]}]
    made.tree["scenes"] += [{"nodes": [1]}]
    assert len(read(tmp_path, made).faces) == len(HEAD.faces)
    del made.tree["scenes"], made.tree["scene"]
    assert len(read(tmp_path, made).faces) == 2 * len(HEAD.faces)


def test_percent_encoded_and_data_uris(tmp_path):
    """A buffer in "my head.bin", by its encoded name or as it is, or inside the JSON; files it names are reported."""
    made, _ = plain(HEAD)
    path = tmp_path / "my head.gltf"
    path.write_bytes(made.gltf())
    assert_same(read_mesh(path, 1.0))
    assert mesh_files(path) == (path,)
    (tmp_path / "my head.bin").write_bytes(bytes(made.data))
    (tmp_path / "skin.png").write_bytes(b"x")
    made.tree["images"] = [{"uri": "skin.png"}, {"uri": "gone.png"}]
    for uri in ("my%20head.bin", "my head.bin"):
        path.write_bytes(made.gltf(uri))
        assert_same(read_mesh(path, 1.0))
        assert mesh_files(path) == (path, tmp_path / "my head.bin", tmp_path / "skin.png")
    (tmp_path / "my head.bin").unlink()
    with pytest.raises(InputError, match=r"my%20head\.bin|my head\.bin"):
        read_mesh(path, 1.0)


def draco(mesh, fallback=False):
    import DracoPy

    made = Gltf()
    positions, uv, _, faces = vertices_of(mesh)
    data = DracoPy.encode(
        positions, faces.astype(np.uint32), quantization_bits=20, tex_coord=uv, preserve_order=True, normals=None
    )
    ids = {a["attribute_type"]: a["unique_id"] for a in DracoPy.decode(data).attributes}
    attributes = {"POSITION": made.accessor(positions), "TEXCOORD_0": made.accessor(uv)}
    index = made.accessor(faces.ravel(), "I")
    if not fallback:
        for entry in made.tree["accessors"]:
            del entry["bufferView"]
    extension = {"bufferView": made.view(data), "attributes": {"POSITION": ids[0], "TEXCOORD_0": ids[3]}}
    made.mesh(attributes, index, extensions={"KHR_draco_mesh_compression": extension})
    made.tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    return made


def test_draco(tmp_path, monkeypatch):
    """Compressed by Draco: decoded; without the decoder refused by name, unless a plain copy is there."""
    pytest.importorskip("DracoPy")
    packed = draco(HEAD)
    assert_same(read(tmp_path, packed), position_mm=1e-3, uv=1e-4, normal=2.0)
    plain_copy = draco(HEAD, fallback=True)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(InputError, match=r"KHR_draco_mesh_compression.*skinbake\[draco\]") as failure:
        read(tmp_path, packed)
    assert "\n" not in str(failure.value)
    assert_same(read(tmp_path, plain_copy), normal=2.0)


def test_draco_that_cannot_be_decoded(tmp_path):
    """Draco data that is none is one line with the extension's name."""
    made, _ = plain(HEAD)
    extension = {"bufferView": made.view(b"DRACO\2\2" + b"\0" * 60), "attributes": {"POSITION": 0}}
    made.tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": extension}
    pytest.importorskip("DracoPy")
    with pytest.raises(InputError, match="KHR_draco_mesh_compression") as failure:
        read(tmp_path, made)
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_without_its_decoder(tmp_path, monkeypatch, name):
    """Compressed by meshopt: without its decoder refused by the extension's name with the way out."""
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    made, _ = plain(HEAD)
    made.tree["bufferViews"][0]["extensions"] = {name: {"buffer": 0, "byteLength": 9, "byteStride": 12, "count": 3}}
    with pytest.raises(InputError, match=rf"{name}.*skinbake\[meshopt\]"):
        read(tmp_path, made)


def test_meshopt(tmp_path):
    """Compressed by meshopt: vertices and indices decoded, an octahedral filter undone."""
    meshoptimizer = pytest.importorskip("meshoptimizer")
    made, attributes = plain(HEAD)
    positions, _, _, faces = vertices_of(HEAD)

    def packed(data, count, stride, mode, **more):
        entry = {"count": count, "byteStride": stride, "mode": mode, "buffer": 0, "byteLength": len(data), **more}
        made.data.extend(b"\0" * (-len(made.data) % 4))
        entry["byteOffset"] = len(made.data)
        made.data.extend(data)
        plain_view = {"buffer": 0, "byteLength": count * stride, "extensions": {"EXT_meshopt_compression": entry}}
        made.tree["bufferViews"].append(plain_view)
        return len(made.tree["bufferViews"]) - 1

    count = len(positions)
    rows = positions.astype(np.float32)
    view = packed(meshoptimizer.encode_vertex_buffer(rows, count, 12), count, 12, "ATTRIBUTES")
    attributes["POSITION"] = made.accessor(positions, view=view)
    index = faces.ravel().astype(np.uint32)
    view = packed(meshoptimizer.encode_index_buffer(index, len(index), count), len(index), 4, "TRIANGLES")
    made.tree["meshes"][0]["primitives"][0]["indices"] = made.accessor(index, "I", view=view)
    got = read(tmp_path, made)
    # meshopt may turn a triangle's corners
    key = lambda mesh: np.sort(mesh.corner_position_mm.mean(axis=1).round(3) + 0.0, axis=0)  # noqa: E731
    np.testing.assert_allclose(key(got), key(HEAD), atol=2e-3)


BAD = {
    "unknown required": (lambda tree: tree.update(extensionsRequired=["ACME_mesh"]), "requires ACME_mesh"),
    "version 1": (lambda tree: tree["asset"].update(version="1.0"), "expected glTF 2.0, got version 1.0"),
    "accessor past the end": (lambda tree: tree["accessors"][0].update(count=10**6), "reaches past its"),
    "no such accessor": (
        lambda tree: tree["meshes"][0]["primitives"][0]["attributes"].update(POSITION=-1),
        "expected one of 4 accessors, got -1",
    ),
    "cycle": (lambda tree: tree["nodes"][0].update(children=[0]), "its own ancestor"),
    "instances": (
        lambda tree: tree["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {}}),
        "EXT_mesh_gpu_instancing",
    ),
    "flat node": (lambda tree: tree["nodes"][0].update(scale=[1, 1, 0]), "expected a transform that can be undone"),
    "not JSON numbers": (lambda tree: tree["accessors"][0].update(count="many"), "damaged glTF"),
    "index past the vertices": (lambda tree: tree["accessors"][0].update(count=9), "a triangle names vertex"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_not_supported_or_damaged_is_named(tmp_path, case):
    """One line that names the file and the fault."""
    damage, message = BAD[case]
    made, _ = plain(HEAD)
    damage(made.tree)
    with pytest.raises(InputError, match=r"head\.glb") as failure:
        read(tmp_path, made)
    assert message in str(failure.value)
    assert "\n" not in str(failure.value)


def test_a_cut_off_glb(tmp_path):
    """A GLB that ends anywhere is refused, or, cut within its last padding, read."""
    whole = plain(sphere(100.0, "latlong", 4))[0].glb()
    path = tmp_path / "cut.glb"
    for length in range(0, len(whole) - 4, 97):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"cut\.glb"):
            read_mesh(path, 1.0)


def test_a_byte_order_mark_in_the_json(tmp_path):
    """Some programs begin the JSON with a mark."""
    path = tmp_path / "head.gltf"
    path.write_bytes(b"\xef\xbb\xbf" + plain(HEAD)[0].gltf())
    assert_same(read_mesh(path, 1.0))
    assert json.loads(path.read_bytes().decode("utf-8-sig"))["asset"]["version"] == "2.0"


def test_tangents_come_along(tmp_path):
    """Turned with the node; left out where they belong to other UVs, to a morphed shape, or to no normals."""
    from skinbake.io.mesh.gltf import read_gltf

    def tangent(spoil=lambda made, primitive: None):
        made, attributes = plain(quad())
        attributes["TANGENT"] = made.accessor(np.tile([1.0, 0, 0, 1], (6, 1)))
        made.tree["nodes"][0]["rotation"] = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # x becomes y
        spoil(made, made.tree["meshes"][0]["primitives"][0])
        (tmp_path / "a.glb").write_bytes(made.glb())
        return read_gltf(tmp_path / "a.glb").corner_tangent

    np.testing.assert_allclose(tangent(), np.tile([0, 1, 0], (2, 3, 1)), atol=1e-7)
    np.testing.assert_allclose(read_mesh(tmp_path / "a.glb", 1.0, front="x", any_size=True).corner_tangent,
                               np.tile([0, 1, 0], (2, 3, 1)), atol=1e-7)  # fmt: skip

    def other_uvs(made, primitive):
        texture = {"index": 0, "texCoord": 1}
        primitive["material"] = made.material(
            normalTexture=texture, pbrMetallicRoughness={"baseColorTexture": {"index": 0}}
        )

    def morphed(made, primitive):
        primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
        made.tree["meshes"][0]["weights"] = [0.5]

    for spoil in (other_uvs, morphed, lambda made, primitive: primitive["attributes"].pop("NORMAL")):
        assert tangent(spoil) is None


@pytest.mark.parametrize(
    "hides", [{"extensions": {"KHR_node_visibility": {"visible": False}}}, {"scale": [0, 0, 0]}], ids=str
)
def test_what_a_file_hides_is_not_there(tmp_path, hides):
    """A node that is not visible, or has no size, and all below it."""
    made, _ = plain(HEAD)
    made.tree |= {
        "extensionsUsed": ["KHR_node_visibility"],
        "extensionsRequired": ["KHR_node_visibility"],
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"children": [2], **hides}, {"mesh": 0, "name": "hidden", "translation": [9, 9, 9]}],
    }
    assert_same(read(tmp_path, made))
    with pytest.raises(InputError, match="no part is called 'hidden'"):
        read(tmp_path, made, ignore=["hidden"])
