"""The atlas addresses every texel exactly, whatever the triangles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.atlas import NO_FACE, interpolate, rasterize, signed_uv_area, tiles_of
from skinbake.scene.mesh import SkinMesh
from tests.shapes import quad, sphere


def triangles(uv, positions=None) -> SkinMesh:
    uv = np.asarray(uv, float).reshape(-1, 3, 2)
    n = len(uv)
    if positions is None:
        positions = np.concatenate([uv * [70.0, 40.0], np.zeros((n, 3, 1))], axis=2)
    faces = np.arange(3 * n, dtype=np.int32).reshape(-1, 3)
    normal = np.broadcast_to([0.0, 0.0, 1.0], (n, 3, 3)).copy()
    return SkinMesh(np.asarray(positions, float).reshape(-1, 3), faces, uv, normal)


def test_uv_of_texels_are_their_centres():
    """Interpolating the UVs gives texel centres, on an odd non-square raster, row 0 at v = 1."""
    (raster,) = rasterize(quad(columns=3, rows=5), (37, 23))
    uv = interpolate(raster, quad(columns=3, rows=5).corner_uv)
    u, v = np.meshgrid((np.arange(37) + 0.5) / 37, 1 - (np.arange(23) + 0.5) / 23)
    np.testing.assert_allclose(uv, np.stack([u, v], -1), atol=1e-6)
    assert (raster.coverage == 1).all()


@pytest.mark.parametrize("size", [(64, 64), (127, 33), (5, 3), (1, 1), (1, 40), (40, 1)])
@pytest.mark.parametrize("layout", ["latlong", "cube"])
def test_areas_sum_to_the_mesh(size, layout):
    """Texel areas sum to the area of the mesh at every size, one texel included."""
    mesh = sphere(50.0, layout)
    (raster,) = rasterize(mesh, size)
    drawn = signed_uv_area(mesh) != 0
    assert raster.area_mm2.sum(dtype=float) == pytest.approx(mesh.face_area_mm2[drawn].sum(), rel=1e-5)
    assert raster.addressed[raster.covered].all()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.0, 1.0, width=32), min_size=6, max_size=6),
    st.integers(1, 19),
    st.integers(1, 17),
)
def test_coverage_is_the_clipped_area(uv, width, height):
    """Coverage of any triangle, flipped, thin or tiny, sums to its UV area in texels, and no covered texel is lost."""
    mesh = triangles(uv)
    (raster,) = rasterize(mesh, (width, height), gutter=0)
    area = abs(signed_uv_area(mesh)[0]) * width * height
    assert raster.coverage.sum(dtype=float) == pytest.approx(area, rel=1e-5, abs=1e-9)
    assert np.array_equal(raster.covered, raster.addressed) or area < 1e-6
    b = raster.barycentric
    assert (b >= 0).all()
    assert (b.sum(axis=2) <= 1 + 1e-6).all()


def test_coverage_against_brute_force():
    """Coverage of a tilted triangle agrees with 64 x 64 point samples a texel."""
    uv = np.array([[0.07, 0.11], [0.93, 0.36], [0.31, 0.88]])
    (raster,) = rasterize(triangles(uv), (13, 9))
    n = 64
    x, y = np.meshgrid((np.arange(13 * n) + 0.5) / (13 * n), 1 - (np.arange(9 * n) + 0.5) / (9 * n))
    a, b, c = uv
    inside = np.ones(x.shape, bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) >= 0
    brute = inside.reshape(9, n, 13, n).mean(axis=(1, 3))
    np.testing.assert_allclose(raster.coverage, brute, atol=0.01)


def test_a_border_texel_looks_at_the_closest_chart_point():
    """Gutter and partly covered texels get the nearest point of the chart, found by brute force, up to the gutter."""
    uv = np.array([[0.30, 0.30], [0.72, 0.41], [0.44, 0.69]])
    mesh = triangles(uv)
    width, height, gutter = 31, 27, 5
    (raster,) = rasterize(mesh, (width, height), gutter=gutter)
    found = interpolate(raster, mesh.corner_uv)
    t = np.linspace(0, 1, 20001)[:, None]
    edge = np.concatenate([a + t * (b - a) for a, b in zip(uv, np.roll(uv, -1, 0), strict=True)])
    size = np.array([width, height])
    for row in range(height):
        for col in range(width):
            centre = np.array([(col + 0.5) / width, 1 - (row + 0.5) / height])
            nearest = np.linalg.norm((edge - centre) * size, axis=1).min()
            if raster.face_index[row, col] == NO_FACE:
                assert nearest > gutter - 1e-3
            else:
                distance = np.linalg.norm((found[row, col] - centre) * size)
                assert distance <= nearest + 1e-3
                assert distance <= gutter + 1e-3


def test_the_lowest_face_wins_where_charts_overlap():
    """Two equal triangles: texels show the first, and carry the area of both."""
    uv = [[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]]
    mesh = triangles([uv, uv])
    (raster,) = rasterize(mesh, (16, 16))
    assert set(np.unique(raster.face_index[raster.covered])) == {0}
    assert raster.area_mm2.sum(dtype=float) == pytest.approx(mesh.face_area_mm2.sum(), rel=1e-5)
    assert raster.coverage.max() <= 1


def test_shared_edges_through_texel_centres_leave_no_hole():
    """Edges that run exactly through texel centres leave no texel of a chart unaddressed or shown from its border."""
    mesh = quad(columns=8, rows=8)
    (raster,) = rasterize(mesh, (12, 12), gutter=0)
    uv = interpolate(raster, mesh.corner_uv)
    assert raster.addressed.all()
    np.testing.assert_allclose(uv[..., 0], np.broadcast_to((np.arange(12) + 0.5) / 12, (12, 12)), atol=1e-6)


def test_an_island_smaller_than_a_texel_keeps_it():
    """A chart that misses every centre still has its texel, its area and its colour."""
    mesh = triangles([[0.51, 0.51], [0.52, 0.51], [0.51, 0.52]])
    (raster,) = rasterize(mesh, (8, 8), gutter=0)
    assert np.count_nonzero(raster.addressed) == 1
    assert raster.area_mm2.sum(dtype=float) == pytest.approx(mesh.face_area_mm2[0], rel=1e-5)


def test_degenerate_triangles_do_no_harm():
    """Zero-area UV triangles and points are left out; nothing becomes NaN."""
    point, line = [[0.5, 0.5]] * 3, [[0.1, 0.1], [0.5, 0.5], [0.9, 0.9]]
    mesh = triangles([point, line, [[0.2, 0.2], [0.8, 0.2], [0.2, 0.8]]])
    (raster,) = rasterize(mesh, (9, 9))
    assert set(np.unique(raster.face_index)) <= {NO_FACE, 2}
    assert np.isfinite(raster.area_mm2).all()
    (empty,) = rasterize(triangles([point]), (9, 9))
    assert not empty.addressed.any()


def test_tiles_hold_their_share():
    """Two UDIM tiles: their areas sum to the mesh, each with the faces of its half."""
    mesh = sphere(30.0, "cube", tiles=2)
    assert tiles_of(mesh, True) == (1001, 1002)
    atlas = rasterize(mesh, (41, 29), udim=True)
    assert [raster.tile for raster in atlas] == [1001, 1002]
    areas = [raster.area_mm2.sum(dtype=float) for raster in atlas]
    assert sum(areas) == pytest.approx(mesh.face_area_mm2.sum(), rel=1e-5)
    assert min(areas) > 0.3 * mesh.face_area_mm2.sum()


def test_threads_do_not_change_a_byte(monkeypatch):
    """One and two threads give the same arrays."""
    results = []
    for threads in (1, 2):
        monkeypatch.setenv("NUMBA_NUM_THREADS", str(threads))
        (raster,) = rasterize(sphere(), (150, 70))
        results.append((raster.face_index, raster.barycentric, raster.coverage, raster.area_mm2))
    for one, two in zip(*results, strict=True):
        assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize(("size", "gutter"), [((0, 4), 8), ((4, 0), 8), ((4, 4), -1)])
def test_impossible_sizes_are_refused(size, gutter):
    """Sizes below one texel and negative gutters are errors."""
    with pytest.raises(ValueError, match="expected size"):
        rasterize(quad(), size, gutter)
