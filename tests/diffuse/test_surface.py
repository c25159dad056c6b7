"""Surface sums equal the brute-force integral, know no seams, and keep facing skin apart."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.bilinear import read_bilinear
from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.surface_space.gather import SumRule, gather
from skinbake.diffuse.surface_space.pair_rule import pair_weight
from skinbake.diffuse.surface_space.points import extended_points, texel_points
from skinbake.diffuse.surface_space.reference_integral import reference_integral
from skinbake.diffuse.surface_space.sources import AMPLITUDE, LIGHT, NORMAL
from skinbake.io.mesh import read_mesh
from skinbake.scene.mesh import SkinMesh
from tests.diffuse.exact import brute_force
from tests.diffuse.lobes import exact_at, lobe_map, probes_of, resources_of
from tests.diffuse.test_sources import sources
from tests.shapes import joined, quad, relief, sphere


def _lit(mesh, atlas, direction=(0.4, 0.5, 0.77), lights=1):
    """N.L with a hard shadow edge, (L, H, W, 3) a tile."""
    tiles = []
    for raster in atlas:
        position, normal = interpolate(raster, mesh.corner_position_mm), interpolate(raster, mesh.corner_normal)
        e = np.maximum(normal @ np.asarray(direction, np.float32), 0) * (position[..., 0] + 0.3 * position[..., 1] < 5)
        tint = np.array([[1, 0.8, 0.6], [0.2, 0.5, 1.5], [3, 0, 1]], np.float32)[:lights]
        tiles.append((e[None, ..., None] * tint[:, None, None]).astype(np.float32))
    return tiles


def _bumps(height_mm=18.0):
    mesh = relief(60, height_mm)
    atlas = rasterize(mesh, (130, 117))
    return mesh, atlas, _lit(mesh, atlas)


@pytest.mark.parametrize("variance", [0.02, 0.3, 3.0, 40.0])
@pytest.mark.parametrize("separate", [True, False])
def test_reference_equals_brute_force(variance, separate):
    """To 1e-6, for lobes from a third of a texel up: nothing of the neighbour search shows."""
    mesh, atlas, light = _bumps()
    resources = resources_of(light, atlas, mesh)
    texels, points = resources.texels(), resources.geometry.points[1001]
    pick = np.flatnonzero(points.area_mm2 > 0)[::301]
    coarse = np.full(len(pick), 1e-6, np.float32)  # lobes are not widened to the lattice here
    each = sources(texels)
    got = reference_integral(texels, points.position[pick], points.normal[pick], coarse, variance, separate)
    want = brute_force(
        points.position[pick], points.normal[pick], each[:, :3], each[:, NORMAL : NORMAL + 3],
        each[:, AMPLITUDE], each[:, LIGHT:].astype(float), variance, separate,
    )  # fmt: skip
    np.testing.assert_allclose(got, want, atol=1e-6)


@pytest.mark.parametrize(("spacing", "allowed"), [(0.0, 2e-4), (0.8, 2e-3), (1.2, 4e-3)])
@pytest.mark.parametrize("variance", [0.05, 0.6, 6.0])
def test_clusters_are_as_wrong_as_their_spacing(spacing, allowed, variance):
    """Against the reference at every texel of a bump, relative rms."""
    mesh, atlas, light = _bumps()
    resources = resources_of(light, atlas, mesh)
    points = resources.geometry.points[1001]
    exact = lobe_map(resources, "reference", variance)
    got = np.zeros((*atlas[0].shape, 3), np.float32)
    rule = SumRule(cut=4.0, separate=True, normalise=True)
    gather(points, resources.sources(variance, spacing), variance, rule, got.reshape(1, -1, 3))
    inside = atlas[0].coverage > 0.99
    assert np.linalg.norm((got - exact[0])[inside]) < allowed * np.linalg.norm(exact[0][inside])


def test_a_flat_wave_is_damped_as_the_plane_s_integral_says():
    """exp(-v k^2 / 2) on a stretched quad, 2 mm x 0.5 mm texels."""
    mesh = quad(200, 50)
    atlas = rasterize(mesh, (100, 100))
    x = interpolate(atlas[0], mesh.corner_position_mm)[..., 0]
    k = 2 * np.pi / 40
    light = np.repeat((0.5 + 0.4 * np.cos(k * x))[None, ..., None], 3, axis=3).astype(np.float32)
    got = lobe_map(resources_of([light], atlas, mesh), "surface", 25.0, 0, 0.5)[0, 50, :, 1]
    want = 0.5 + 0.4 * np.exp(-25 * k**2 / 2) * np.cos(k * x[50])
    np.testing.assert_allclose(got[15:-15], want[15:-15], atol=2e-3)


@pytest.mark.parametrize(("method", "normalise"), [("surface", True), ("surface", False), ("stretch", True)])
def test_a_wave_that_is_read_from_half_the_size_is_damped_as_at_the_full_one(method, normalise):
    """Read between its texels a smaller size shows exp(-v k^2 / 2), to a fourth of what reading alone takes off."""
    mesh = quad(100, 100)
    atlas = rasterize(mesh, (100, 100))
    x = interpolate(atlas[0], mesh.corner_position_mm)[..., 0]
    k = 2 * np.pi / 24
    light = np.repeat((0.5 + 0.4 * np.cos(k * x))[None, ..., None], 3, axis=3).astype(np.float32)
    resources = resources_of([light], atlas, mesh, normalise=normalise)
    small = lobe_map(resources, method, 9.0, 1, 0.1)[0]
    place = np.stack([np.full(400, 0.5), np.random.default_rng(3).uniform(0.25, 0.75, 400)], axis=1)
    read = read_bilinear(small[None].astype(np.float32), place)[:, 1]
    wave = np.cos(k * (place[:, 1] - 0.5) * 100)
    damped, shift = np.polyfit(wave, read, 1)
    want = 0.4 * np.exp(-9 * k**2 / 2)
    assert shift == pytest.approx(0.5, abs=2e-3)
    assert abs(damped - want) < want * k**2 * 4 / 12 / 4  # h^2 / 12 a second derivative, h = 2 mm


@pytest.mark.parametrize("method", ["texture", "stretch", "hybrid", "surface", "reference"])
@pytest.mark.parametrize("variance", [1e-4, 0.5, 50.0])
def test_constant_light_stays_constant(method, variance):
    """To 1e-5, by every method, over seams, borders and stretch."""
    mesh = sphere(20, "cube", 16)
    atlas = rasterize(mesh, (60, 45), gutter=3)
    light = np.where(atlas[0].addressed[..., None], np.float32(3.7), np.float32(0))[None] * np.ones(3, np.float32)
    got = lobe_map(resources_of([light], atlas, mesh), method, variance, 0, 0.8, 0.01)
    np.testing.assert_allclose(got[0][atlas[0].covered], 3.7, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [20, 50, 100])
def test_layouts_of_a_sphere_agree(radius):
    """Latitude-longitude on one and on two UDIM tiles, cube faces, xatlas's charts: the same light leaves a point."""
    direction = np.random.default_rng(3).normal(size=(400, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    values = []
    for layout, tiles in (("latlong", 1), ("cube", 1), ("latlong", 2), ("xatlas", 1)):
        mesh = sphere(radius, layout, 96, tiles)
        atlas = rasterize(mesh, (400 // tiles, 300), udim=tiles > 1)
        light = []
        for raster in atlas:
            n = interpolate(raster, mesh.corner_position_mm) / np.float32(radius)
            e = np.maximum(n @ np.array([0.6, 0.0, 0.8], np.float32), 0) * (1.5 + np.sin(5 * n[..., 1]))
            light.append((e[None, ..., None] * np.ones(3)).astype(np.float32))
        resources = resources_of(light, atlas, mesh, tolerance=0.001)
        variance = (0.08 * radius) ** 2
        count = len(direction)
        at = dataclasses.replace(
            probes_of(resources, 1), tile=np.zeros(count, np.int32), position=(direction * radius).astype(np.float32),
            normal=direction.astype(np.float32), texel_mm2=np.full(count, 1e-6, np.float32),
        )  # fmt: skip
        values.append(METHODS["surface"].at_probes(resources, LobeParameters(variance, 0, 0.6), at)[:, 0])
        exact = exact_at(resources, variance, at)[:, 0]
        assert np.linalg.norm(values[-1] - exact) < 2e-3 * np.linalg.norm(exact)
    for other in values[1:]:
        assert np.linalg.norm(other - values[0]) < 4e-3 * np.linalg.norm(values[0])


def test_both_sides_of_a_seam_agree():
    """Reading just left and just right of every seam of a cube sphere: before up to a texel apart, after the same."""
    mesh = sphere(30, "cube", 48)
    atlas = rasterize(mesh, (300, 200))
    resources = resources_of(_lit(mesh, atlas), atlas, mesh)
    pairs = seam_samples(mesh, 2000)
    for variance, level in ((2.0, 0), (8.0, 1)):
        image = lobe_map(resources, "surface", variance, level, 0.6)
        texture = lobe_map(resources, "texture", variance, level)
        apart = [np.abs(np.subtract(*(_read(i, uv) for uv in pairs))).mean() / i.mean() for i in (image, texture)]
        assert apart[0] < 2e-3
        assert apart[0] < 0.1 * apart[1]


def seam_samples(mesh: SkinMesh, count: int, with_faces: bool = False):
    """The two UVs of points on edges whose faces disagree about UV, both (count, 2); and their faces where asked."""
    edges = {}
    for f in range(len(mesh.faces)):
        for k in range(3):
            a, b = int(mesh.faces[f, k]), int(mesh.faces[f, (k + 1) % 3])
            edges.setdefault((min(a, b), max(a, b)), []).append((f, k, a > b))
    rows, faces = [], []
    for shared in edges.values():
        if len(shared) == 2:
            uv = []
            for f, k, flipped in shared:
                ends = mesh.corner_uv[f, [k, (k + 1) % 3]]
                uv.append(ends[::-1] if flipped else ends)
            if np.abs(uv[0] - uv[1]).max() > 1e-6:
                rows.append(uv)
                faces.append([shared[0][0], shared[1][0]])
    ends = np.array(rows)
    rng = np.random.default_rng(5)
    pick, along = rng.integers(len(ends), size=count), rng.random((count, 1))
    pairs = [ends[pick, side, 0] * (1 - along) + ends[pick, side, 1] * along for side in (0, 1)]
    return (pairs, [np.array(faces)[pick, side] for side in (0, 1)]) if with_faces else pairs


def _read(image, uv):
    return read_bilinear(image, np.stack([1 - uv[:, 1], uv[:, 0]], axis=1))


def test_a_light_alone_gives_the_same_bytes_as_in_a_group():
    """Shares of the weights, not of the light."""
    mesh = relief()
    atlas = rasterize(mesh, (70, 61))
    group = _lit(mesh, atlas, lights=3)[0]
    together = lobe_map(resources_of([group], atlas, mesh), "surface", 1.5, 0, 0.8)
    for k in range(3):
        alone = lobe_map(resources_of([group[k : k + 1]], atlas, mesh), "surface", 1.5, 0, 0.8)
        np.testing.assert_array_equal(alone[0], together[k])


@pytest.mark.slow
def test_bytes_do_not_depend_on_the_number_of_threads():
    """One thread and two."""
    code = (
        "import os, hashlib; os.environ['NUMBA_NUM_THREADS'] = '{n}';"
        "from tests.diffuse.test_surface import _bumps; from tests.diffuse.lobes import lobe_map, resources_of;"
        "m, a, l = _bumps(); r = resources_of(l, a, m);"
        "print([hashlib.sha256(lobe_map(r, x, 0.6, 0, 0.8).tobytes()).hexdigest() for x in ('texture', 'surface')])"
    )
    results = {
        subprocess.run([sys.executable, "-c", code.format(n=n)], capture_output=True, text=True, check=True).stdout
        for n in (1, 2)
    }
    assert len(results) == 1


def test_facing_skin_is_kept_apart_and_thin_skin_is_not():
    """Two lips a millimetre apart do not light one another; the two sides of an ear do."""
    lit, dark = quad(40, 40, 0.0, uv_box=(0.02, 0.02, 0.48, 0.98)), quad(40, 40, 1.0, uv_box=(0.52, 0.02, 0.98, 0.98))
    back = SkinMesh(dark.positions_mm, dark.faces[:, ::-1], dark.corner_uv[:, ::-1], -dark.corner_normal)
    front = SkinMesh(lit.positions_mm, lit.faces[:, ::-1], lit.corner_uv[:, ::-1], -lit.corner_normal)
    received = {}
    for name, mesh in (("lips", joined(lit, back)), ("ear", joined(front, dark))):
        atlas = rasterize(mesh, (120, 60))
        light = np.zeros((1, 60, 120, 3), np.float32)
        light[:, :, :60] = 1
        for separate in (True, False):
            resources = resources_of([light], atlas, mesh, separate=separate)
            received[name, separate] = lobe_map(resources, "surface", 4.0, 0, 0.8)[0, 30, 90, 0]
    assert received["lips", True] < 0.03
    assert received["lips", False] > 0.4
    assert received["ear", True] == pytest.approx(received["ear", False], abs=1e-6)
    assert received["ear", True] > 0.4


def test_the_pair_rule_is_symmetric_and_smooth():
    """Exchanging the two ends changes nothing; no jump anywhere."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        c, i, j = rng.uniform(-1, 1, 3)
        assert pair_weight(c, i, j, 1.0) == pair_weight(c, j, i, 1.0)
        assert abs(pair_weight(c, i, j, 1.0) - pair_weight(c + 1e-4, i + 1e-4, j, 1.0)) < 1e-2


def test_not_normalised_a_plane_keeps_its_light_and_a_border_loses_half():
    """The classical integral: 1 in the middle, 1/2 at an edge, 1/4 at a corner."""
    mesh = quad(60, 60)
    atlas = rasterize(mesh, (120, 120))
    light = np.ones((1, 120, 120, 3), np.float32)
    for method in ("surface", "reference"):
        got = lobe_map(resources_of([light], atlas, mesh, normalise=False), method, 9.0, 0, 0.8)[0, ..., 0]
        assert got[60, 60] == pytest.approx(1, abs=4e-3)
        assert got[60, 0] == pytest.approx(0.5, abs=0.04)
        assert got[0, 0] == pytest.approx(0.25, abs=0.04)


def test_extended_gutter_points_continue_the_plane():
    """Beside a flat quad's chart the points go on at the texels' own pace."""
    mesh = quad(100, 80, uv_box=(0.2, 0.2, 0.8, 0.8))
    atlas = rasterize(mesh, (50, 50), gutter=4)
    points = extended_points(texel_points(atlas[0], mesh, np.zeros(3)), atlas[0], mesh, np.zeros(3))
    row = points.position[points.row[25, 8:41]]
    np.testing.assert_allclose(np.diff(row[1:-1, 0]), 100 / 30, rtol=0.02)


@pytest.mark.parametrize("method", ["surface", "reference"])
def test_no_texel_of_a_scan_stays_dark_in_constant_light(lee_perry_smith, method):
    """Not even one at an eyelid whose centre lies so far beside its chart that the narrowest lobe finds no skin."""
    mesh = read_mesh(str(lee_perry_smith / "head.obj"), 50.35)
    atlas = rasterize(mesh, (512, 512))
    light = np.where(atlas[0].addressed[None, ..., None], np.float32(0.7), np.float32(0)).repeat(3, axis=3)
    image = lobe_map(resources_of([light], atlas, mesh), method, 0.0064, 0, 0.8)
    np.testing.assert_allclose(image[0][atlas[0].addressed], 0.7, rtol=1e-5)
