"""USD stages: units, axes, subsets, primvars, orientation, time."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.baking.inputs import BakeInputs
from skinbake.baking.inputs_roles import OCCLUDERS
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.errors import InputError
from skinbake.io.config import load_look
from skinbake.io.first_look import first_look
from skinbake.io.mesh import mesh_files, read_look_mesh, read_mesh
from skinbake.io.mesh.raw_file import read_raw
from tests.shapes import quad, sphere

pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'skinbake[usd]'")

HEAD = """\
#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "{up}"
)
"""
QUAD = """\
def Mesh "{name}" {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]
    uniform token subdivisionScheme = "none"
    {more}
}}
"""
ST = """texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "faceVarying" )"""


def stage(folder, *prims, up="Y", name="head.usda"):
    (folder / name).write_text(HEAD.format(up=up) + "\n".join(prims))
    return folder / name


def mesh(more=ST, name="Head"):
    return QUAD.format(name=name, more=more)


def test_a_quad_comes_in_millimetres_with_its_uvs(tmp_path):
    """Centimetres by the stage, z up by the stage: the quad that stands before one who looks along -z."""
    found = read_mesh(stage(tmp_path, mesh()), None, any_size=True)
    wanted = quad(100.0, 100.0)
    for ours, theirs, off in (
        (found.corner_position_mm, wanted.corner_position_mm, 1e-4),
        (found.corner_uv, wanted.corner_uv, 1e-6),
    ):
        np.testing.assert_allclose(ours, [theirs[0], np.roll(theirs[1], -1, axis=0)], atol=off)
    lying = read_mesh(stage(tmp_path, mesh(), up="Z"), None, any_size=True)
    np.testing.assert_allclose(lying.face_normal, [[0, 1, 0]] * 2, atol=1e-6)
    as_it_is = read_mesh(stage(tmp_path, mesh(), up="Z"), None, any_size=True, up="y")
    np.testing.assert_allclose(as_it_is.face_normal, [[0, 0, 1]] * 2, atol=1e-6)


def test_transforms_and_left_handed_meshes_keep_their_outside(tmp_path):
    """A parent that mirrors, an orientation that is left-handed, and both."""
    left = f'uniform token orientation = "leftHanded"\n    {ST}'
    parent = 'def Xform "Rig" {{\n    double3 xformOp:scale = ({}, 1, 1)\n    double3 xformOp:translate = (0, 0, 7)\n'
    parent += '    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n{}\n}}'
    for scale, more, z in ((1, ST, 1), (-1, ST, 1), (1, left, -1), (-1, left, -1)):
        raw = read_raw(stage(tmp_path, parent.format(scale, mesh(more))))
        np.testing.assert_allclose(raw.positions[:, 2], 7)
        a, b, c = (raw.positions[raw.faces[:, k]] for k in range(3))
        assert (np.sign(np.cross(b - a, c - a)[:, 2]) == z).all(), (scale, z)


def test_subsets_and_materials_are_parts(tmp_path):
    """By path, prim, subset and material; what is in no subset is a part of its own; holes are left out."""
    two = """\
def Mesh "Head" {
    int[] faceVertexCounts = [3, 3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3, 1, 2, 3]
    int[] holeIndices = [2]
    point3f[] points = [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:UVMap = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
    def GeomSubset "Lips" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
        uniform token elementType = "face"
        int[] indices = [1]
        rel material:binding = </Red>
    }
}
def Material "Red" {}
"""
    raw = read_raw(stage(tmp_path, two))
    assert raw.names == (("/Head", "Head"), ("/Head/Lips", "Head", "Lips", "Red"))
    assert raw.labels == ("/Head", "/Head/Lips")
    assert len(raw.faces) == 2
    assert raw.has_uv.all()
    found = read_mesh(stage(tmp_path, two), None, any_size=True, skin=["Lips"])
    assert len(found.faces) == 1


def test_sets_of_uvs_normals_and_colours(tmp_path):
    """st1 and any other by number; normals in world space; displayColor linear; a cage's normals are left alone."""
    other = ST.replace("primvars:st", "primvars:st1").replace("(1, 0)", "(0.5, 0)")
    more = f"""{ST}
    {other}
    normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0.6, 0.8), (0, 0, 1)] ( interpolation = "vertex" )
    color3f[] primvars:displayColor = [(0.5, 0.25, 0.125)] ( interpolation = "constant" )"""
    path = stage(tmp_path, mesh(more))
    assert read_raw(path).corner_uv[0, 1].tolist() == [1, 0]
    assert read_raw(path, 1).corner_uv[0, 1].tolist() == [0.5, 0]
    with pytest.raises(InputError, match=r"mesh\.uv_set: expected UVs of a set that the file has, got 2"):
        read_raw(path, 2)
    np.testing.assert_allclose(read_raw(path).corner_normal[0, 2], [0, 0.6, 0.8], atol=1e-6)
    np.testing.assert_allclose(read_raw(path).corner_rgb, np.tile([0.5, 0.25, 0.125], (2, 3, 1)))
    path.write_text(path.read_text().replace('subdivisionScheme = "none"', 'subdivisionScheme = "catmullClark"'))
    assert not read_raw(path).corner_normal.any()


def test_time_samples(tmp_path):
    """The earliest by default, between samples in between; `frames` move `time`."""
    moving = "point3f[] points = [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]"
    at = "(-5, -5, {0}), (5, -5, {0}), (5, 5, {0}), (-5, 5, {0})"
    samples = f"point3f[] points.timeSamples = {{ 1: [{at.format(1)}], 3: [{at.format(3)}] }}"
    path = stage(tmp_path, mesh().replace(moving, samples))
    for time, z in ((None, 1), (1, 1), (2, 2), (3, 3)):
        np.testing.assert_allclose(read_raw(path, time=time).positions[:, 2], z)
    (tmp_path / "look.yaml").write_text(
        'frames: 1-3\nmesh: {path: head.usda, unit: file, time: "####", any_size: true}\n'
        "skin: {preset: gpugems3-six-gaussians}\noutput: {dir: out}\n"
        "lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]\n"
    )
    looks = [load_look(tmp_path / "look.yaml", [f"frames={number}"]) for number in (2, 3)]
    assert [look.mesh.time for look in looks] == [2.0, 3.0]
    hats = [f"occluders=[{{path: {path}, unit: file, time: {time}}}]" for time in (1, 2)]
    looks += [load_look(tmp_path / "look.yaml", ["frames=2", hat]) for hat in hats]
    inputs = [BakeInputs(look, BakeSession(), StageLog()) for look in looks]
    assert len({each.key("mesh", OCCLUDERS) for each in inputs}) == 4


def test_a_first_look_of_a_stage(tmp_path):
    """Its unit and its axis are the file's own; lights stand about the head as it is placed."""
    ball = sphere(12.0, "latlong", 12)
    points = ball.positions_mm[:, [0, 2, 1]] * [1, -1, 1] + [0, 0, 100]  # upright where z is up, a metre high
    index = ball.faces.ravel()
    uv = ball.corner_uv.reshape(-1, 2)
    text = f"""def Mesh "Head" {{
    int[] faceVertexCounts = {[3] * len(ball.faces)}
    int[] faceVertexIndices = {index.tolist()}
    point3f[] points = {[tuple(p) for p in points.tolist()]}
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:st = {[tuple(p) for p in uv.tolist()]} ( interpolation = "faceVarying" )
}}"""
    look = first_look(stage(tmp_path, text, up="Z"), tmp_path / "me.yaml")
    assert "mesh: {path: head.usda, unit: file}" in look
    (tmp_path / "me.yaml").write_text(look)
    spec = load_look(tmp_path / "me.yaml")
    found = read_look_mesh(spec)
    np.testing.assert_allclose(found.positions_mm.mean(axis=0), [0, 1000, 0], atol=10)
    assert spec.lights[0].position_mm[1] > 1100


def test_what_is_not_drawn_and_layers_elsewhere(tmp_path):
    """Guides and invisible meshes are left out; layers that a stage is made of are inputs."""
    hidden = mesh(f'token visibility = "invisible"\n    {ST}', "Hidden")
    guide = mesh(f'uniform token purpose = "guide"\n    {ST}', "Guide")
    stage(tmp_path, mesh(), hidden, guide, name="body.usda")
    top = tmp_path / "top.usda"
    top.write_text("#usda 1.0\n(\n    metersPerUnit = 0.01\n    subLayers = [@./body.usda@]\n)\n")
    assert read_raw(top).names == (("/Head", "Head"),)
    assert mesh_files(top) == (top, tmp_path / "body.usda")


@pytest.mark.parametrize("content", [b"no stage", b"#usda 1.0\ndef Mesh {", b"PXR-USDC" + bytes(80), b""])
@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_damaged_stages_are_refused_in_one_line(tmp_path, capfd, content, suffix):
    """Without a word of the library's."""
    path = tmp_path / f"head.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"head\.usd.: (not a USD stage|expected triangles)"):
        read_raw(path)
    assert mesh_files(path) == (path,)
    assert capfd.readouterr() == ("", "")


def test_counts_that_do_not_fit_are_named(tmp_path):
    """Indices, and values of a primvar."""
    with pytest.raises(InputError, match=r"head\.usda: /Head: expected 4 indices of its faces, got 3"):
        read_raw(stage(tmp_path, mesh().replace("[0, 1, 2, 3]", "[0, 1, 2]")))
    with pytest.raises(InputError, match=r"head\.usda: a triangle names vertex 9, of 4 vertices"):
        read_raw(stage(tmp_path, mesh().replace("[0, 1, 2, 3]", "[0, 1, 2, 9]")))
    with pytest.raises(InputError, match=r"/Head: st: expected 4 values \(faceVarying\), got 3"):
        read_raw(stage(tmp_path, mesh(ST.replace("(0, 0), ", ""))))


def test_instances_are_refused_by_name(tmp_path):
    """Not shown once, where the prototype lies; invisible ones are nothing."""
    instancer = """def PointInstancer "Lashes" {{
    rel prototypes = </Lashes/Card>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 1), (0, 0, 2)]
    {more}
    {card}
}}"""
    card = mesh(name="Card")
    path = stage(tmp_path, mesh(), instancer.format(more="", card=card))
    with pytest.raises(InputError, match=r"head\.usda: /Lashes is a PointInstancer, which is not supported; export"):
        read_raw(path)
    unseen = instancer.format(more='token visibility = "invisible"', card=card)
    assert len(read_raw(stage(tmp_path, mesh(), unseen)).faces) == 2


@pytest.mark.parametrize("kind", ["Sphere", "Cube", "NurbsPatch"])
def test_surfaces_that_are_no_meshes_are_refused_by_name(tmp_path, kind):
    """An eye that is a sphere shadowed nothing, without a word; invisible ones, proxies and curves are nothing."""
    text = 'def {} "Eye" {{\n{}\n}}'
    with pytest.raises(InputError, match=rf"head\.usda: /Eye is a {kind}, which is not supported; export it as a mesh"):
        read_raw(stage(tmp_path, mesh(), text.format(kind, "")))
    unseen = [text.format(kind, more) for more in ('token visibility = "invisible"', 'uniform token purpose = "proxy"')]
    for other in (*unseen, text.format("BasisCurves", "")):
        assert len(read_raw(stage(tmp_path, mesh(), other)).faces) == 2


def matrix(rows):
    """A matrix of USD's, in its notation."""
    return "(" + ", ".join(str(tuple(row)) for row in rows.tolist()) + ")"


@pytest.mark.parametrize("in_the_world", [True, False])
@pytest.mark.parametrize("geom_bind", [True, False])
def test_skinned_points_lie_where_joints_hold_them(tmp_path, in_the_world, geom_bind):
    """As UsdSkel's own skinning has it in the bind pose: the mesh's own transform does not count."""
    from pxr import Gf, Usd, UsdGeom, UsdSkel

    arm, bind, rest = np.eye(4), np.eye(4), np.eye(4)
    arm[:3, :3], arm[3, 1] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) * 0.5, 7
    bind[:3, :3] *= 3
    rest[3, :3] = 1, 2, 3
    more = f"""
    rel skel:skeleton = </Root/Arm/Skeleton>
    int[] primvars:skel:jointIndices = [0, 0, 0, 0] (elementSize = 1; interpolation = "vertex")
    float[] primvars:skel:jointWeights = [1, 1, 1, 1] (elementSize = 1; interpolation = "vertex")
    {f"matrix4d primvars:skel:geomBindTransform = {matrix(bind)}" if geom_bind else ""}
    double3 xformOp:translate = (100, 200, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]"""
    head = mesh(more).replace('def Mesh "Head" {', 'def Mesh "Head" (prepend apiSchemas = ["SkelBindingAPI"]) {')
    skeleton = f"""def Xform "Arm" {{
    matrix4d xformOp:transform = {matrix(arm)}
    uniform token[] xformOpOrder = ["xformOp:transform"]
    def Skeleton "Skeleton" {{
        uniform token[] joints = ["a"]
        uniform matrix4d[] bindTransforms = [{matrix(rest @ arm if in_the_world else rest)}]
        uniform matrix4d[] restTransforms = [{matrix(rest)}]
    }}
}}"""
    path = stage(tmp_path, f'def SkelRoot "Root" {{\n{skeleton}\n{head}\n}}')
    got = read_raw(path).positions
    baked = Usd.Stage.Open(str(path))
    UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/Root")), Gf.Interval(1, 1))
    prim = baked.GetPrimAtPath("/Root/Head")
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    wanted = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(1)) @ to_world[:3, :3] + to_world[3, :3]
    np.testing.assert_allclose(got, wanted, atol=1e-5)
    assert np.ptp(got, axis=0).max() == pytest.approx((30 if geom_bind else 10) * (1 if in_the_world else 0.5))
