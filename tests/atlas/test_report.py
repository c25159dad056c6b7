"""The UV report counts what it says it counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import rasterize, report_picture, uv_report
from skinbake.scene.mesh import SkinMesh
from tests.shapes import joined, quad, sphere


def reported(mesh, size=(80, 60), udim=False):
    atlas = rasterize(mesh, size, udim=udim)
    return uv_report(mesh, atlas), atlas


@pytest.mark.parametrize("layout", ["latlong", "cube"])
def test_a_clean_sphere_has_no_faults(layout):
    """A closed sphere: size, area, no open edge, nothing flipped, overlapping or outside."""
    report, _ = reported(sphere(90.0, layout))
    assert report.extent_mm == pytest.approx((180, 180, 180), rel=1e-3)
    assert report.area_mm2 == pytest.approx(4 * np.pi * 90**2, rel=5e-3)
    assert (report.open_edges, report.inside_out) == (0, False)
    assert (report.overlapping, report.flipped, report.degenerate, report.outside) == (0, 0, 0, 0)
    assert report.faults == ()


def test_overlap_share_is_the_hidden_area():
    """Two quads that share a third of their UVs: all triangles count, a sixth of the skin has no texel of its own."""
    mesh = joined(quad(100, 100, uv_box=(0, 0, 0.6, 1)), quad(100, 100, 50, uv_box=(0.4, 0, 1, 1)))
    report, atlas = reported(mesh)
    assert report.overlapping == 4
    assert report.overlapping_share == pytest.approx(1 / 6)
    assert any("share texels" in fault for fault in report.faults)
    (picture,) = report_picture(report, atlas)
    assert picture.shape == (60, 80, 3)
    assert (picture[atlas[0].covered] == [214, 39, 40]).all()


def test_quads_that_only_touch_do_not_overlap():
    """A shared chart border, even through texel centres, is no overlap."""
    mesh = joined(quad(100, 100, uv_box=(0, 0, 0.5, 1)), quad(100, 100, 50, uv_box=(0.5, 0, 1, 1)))
    assert reported(mesh, (81, 61))[0].overlapping == 0
    assert reported(quad(columns=9, rows=7), (63, 63))[0].overlapping == 0


def test_tiles_are_inside_only_with_udim():
    """The second tile's charts lie outside a single texture, and inside a UDIM set."""
    mesh = sphere(90.0, "cube", tiles=2)
    single, _ = reported(mesh)
    assert 0.3 < single.outside_share < 0.7
    assert any("texture.udim" in fault for fault in single.faults)
    assert reported(mesh, udim=True)[0].faults == ()


def test_texel_size_and_stretch():
    """300 x 60 mm over 100 x 40 texels: 3 by 1.5 mm; a UV circle is stretched five to one."""
    report, _ = reported(quad(300, 60, columns=3, rows=3), (100, 40))
    assert report.mm_per_texel == pytest.approx((np.sqrt(4.5),) * 3)
    assert report.stretch_95 == pytest.approx(5)
    assert report.open_edges == 12


def test_inside_out_only_where_it_encloses():
    """A turned sphere faces inwards; a turned open quad cannot be told."""
    ball = sphere(90.0)
    turned = type(ball)(ball.positions_mm, ball.faces[:, ::-1].copy(), ball.corner_uv[:, ::-1], ball.corner_normal)
    assert reported(turned)[0].inside_out
    sheet = quad()
    turned = type(sheet)(sheet.positions_mm, sheet.faces[:, ::-1].copy(), sheet.corner_uv[:, ::-1], sheet.corner_normal)
    assert not reported(turned)[0].inside_out


def named(mesh, part, *names):
    return replace(mesh, part=np.asarray(part, np.int32), part_names=names)


def test_parts_that_lie_on_one_another_are_named():
    """Hair on skin in the UVs: the message names both and proposes the larger as the skin."""
    mesh = joined(quad(200, 200), quad(100, 50, 90))
    mesh = named(mesh, [0, 0, 1, 1], "skin", "hair")
    report = uv_report(mesh, rasterize(mesh, (64, 64)))
    assert {frozenset(pair[:2]) for pair in report.hidden_parts} == {frozenset(["skin", "hair"])}
    assert sum(pair[2] for pair in report.hidden_parts) == pytest.approx(report.overlapping_share)
    (fault,) = report.faults
    assert "hair" in fault
    assert "mesh.skin: ['skin']" in fault
    alone = named(joined(quad(200, 200), quad(200, 200, 9)), [0, 0, 0, 0], "skin")
    (fault,) = uv_report(alone, rasterize(alone, (64, 64))).faults
    assert "texture.unwrap: xatlas" in fault


def test_double_sided_exports_are_told_from_stacked_charts():
    """Every triangle once more, turned round: advice to export one side, and nothing about charts or turning."""
    ball = sphere(90.0, "latlong", 12)
    both = SkinMesh(
        ball.positions_mm,
        np.concatenate([ball.faces, ball.faces[:, ::-1]]),
        np.concatenate([ball.corner_uv, ball.corner_uv[:, ::-1]]),
        np.concatenate([ball.corner_normal, -ball.corner_normal[:, ::-1]]),
    )
    report = uv_report(both, rasterize(both, (64, 64)))
    assert report.doubled == len(ball.faces)
    assert report.doubled_share == pytest.approx(0.5)
    (fault,) = report.faults
    assert "exist twice" in fault
    assert uv_report(ball, rasterize(ball, (64, 64))).doubled == 0


@pytest.mark.parametrize("inwards", [False, True])
@pytest.mark.parametrize("kept", ["ball", "mask", "mask with eyes", "plane"])
def test_faces_that_look_inwards(kept, inwards):
    """Closed, as a mask open at the back, with holes: told in either; a plane has no inside."""
    mesh = quad(200.0, 200.0, columns=8, rows=8) if kept == "plane" else sphere(100.0, "latlong", 24)
    centre = mesh.corner_position_mm.mean(axis=1)
    keep = np.ones(len(centre), np.bool_)
    if kept.startswith("mask"):
        keep = centre[:, 2] > 20
    if kept.endswith("eyes"):
        keep &= np.linalg.norm(np.abs(centre[:, :2]) - [30, 20], axis=1) > 12
    faces, uv, normal = mesh.faces[keep], mesh.corner_uv[keep], mesh.corner_normal[keep]
    if inwards:
        faces, uv, normal = faces[:, ::-1], uv[:, ::-1], -normal[:, ::-1]
    turned = SkinMesh(mesh.positions_mm + 300, np.ascontiguousarray(faces), uv, normal)
    report = uv_report(turned, rasterize(turned, (64, 64)))
    assert report.inside_out == (inwards and kept != "plane")
    assert any("inwards" in fault for fault in report.faults) == report.inside_out


def test_patches_that_turn_the_other_way_round_are_refused():
    """An eighth of a closed ball, whose triangles face inwards there: its volume is still that of a ball."""
    ball = sphere(90.0, "cube")
    corner = (ball.corner_position_mm.mean(axis=1) > 0).all(axis=1)
    faces = np.where(corner[:, None], ball.faces[:, ::-1], ball.faces)
    uv = np.where(corner[:, None, None], ball.corner_uv[:, ::-1], ball.corner_uv)
    report, _ = reported(replace(ball, faces=faces, corner_uv=uv))
    assert report.turned == corner.sum()
    assert report.turned_share == pytest.approx(1 / 8, rel=0.02)
    assert not report.inside_out
    (fault,) = report.faults
    assert fault.startswith(f"{corner.sum()} triangles (12.5% of the skin) turn the other way round")
    assert reported(ball)[0].turned == 0
    assert reported(replace(ball, faces=ball.faces[:, ::-1], corner_uv=ball.corner_uv[:, ::-1]))[0].turned == 0


@pytest.mark.parametrize(("radius", "away", "inwards", "refused"), [
    (90, 150, True, True), (90, 80, True, True), (90, 0, True, False), (90, 150, False, False), (90, 0, False, False),
])  # fmt: skip
def test_shells_that_face_inwards_are_refused(radius, away, inwards, refused):
    """A ball beside another, sharing no edge, normals turned with it: it was baked dark. Within, it is a cavity."""
    ball, small = sphere(radius, "cube"), sphere(radius / 3, "cube")
    faces, uv, normal = small.faces, small.corner_uv / 2, small.corner_normal
    if inwards:
        faces, uv, normal = faces[:, ::-1], uv[:, ::-1], -normal[:, ::-1]
    small = SkinMesh(small.positions_mm + np.array([away, 0, 0]), np.ascontiguousarray(faces), uv, normal)
    report, _ = reported(joined(replace(ball, corner_uv=ball.corner_uv / 2 + 0.5), small))
    assert not report.inside_out
    assert report.turned == (len(small.faces) if refused else 0)
    assert bool(report.faults) == refused


def test_two_sheets_on_one_edge_do_not_count_as_turned():
    """Only where just two triangles meet does it say something; doubled ones are told otherwise."""
    both = joined(quad(100, 100), quad(100, 100))
    both = replace(both, faces=np.concatenate([quad(100, 100).faces, quad(100, 100).faces[:, ::-1]]))
    both = replace(both, positions_mm=quad(100, 100).positions_mm)
    report, _ = reported(both)
    assert report.turned == 0
    assert any("exist twice" in fault for fault in report.faults)


def test_normals_that_point_into_the_skin_are_refused():
    """What a mirrored export leaves, of normals or of triangles: nobody knows which of both are right."""
    ball = sphere(90.0, "cube")
    report, _ = reported(replace(ball, corner_normal=-ball.corner_normal))
    assert report.against == len(ball.faces)
    (fault,) = report.faults
    assert fault.startswith(f"{len(ball.faces)} triangles (100.0% of the skin) and their normals face opposite ways")
    few = ball.corner_normal.copy()
    few[:3] *= -1
    report, _ = reported(replace(ball, corner_normal=few))
    assert report.against == 3
    assert report.faults == ()
