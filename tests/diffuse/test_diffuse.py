"""The whole stage: plans that keep their promise, errors that are measured, inputs that are refused."""

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse import diffuse
from skinbake.errors import InputError
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec
from tests.shapes import quad, relief, sphere

SKIN = GaussianSum(
    np.array([0.04, 0.4, 4.0]), np.array([[0.3, 0.5, 0.7], [0.3, 0.4, 0.3], [0.4, 0.1, 0.0]]), np.zeros(3), np.ones(3)
)


def _source(mesh, atlas, lights=1, scale=1.0):
    source = {}
    for raster in atlas:
        p, n = interpolate(raster, mesh.corner_position_mm), interpolate(raster, mesh.corner_normal)
        e = np.maximum(n @ np.array([0.36, 0.48, 0.8], np.float32), 0) * (np.sin(0.4 * p[..., 0]) > -0.2)
        tint = np.array([[1, 0.8, 0.6], [0.2, 0.5, 1.5]], np.float32)[:lights]
        source[raster.tile] = (np.float32(scale) * e[None, ..., None] * tint[:, None, None]).astype(np.float32)
    return source


def _bake(mesh, size=(128, 117), lights=1, scale=1.0, udim=False, skin=SKIN, precision="half", **spec):
    atlas = rasterize(mesh, size, udim=udim)
    names = ("key", "rim")[:lights]
    spec = DiffusionSpec(**{"probes": 500, **spec})
    return diffuse(_source(mesh, atlas, lights, scale), names, atlas, mesh, skin, spec, 0, precision)


@pytest.mark.parametrize("tolerance", [0.05, 0.01, 0.004])
def test_auto_keeps_its_promise(tolerance):
    """On probes that the plan did not use, with a line for each decision."""
    baked = _bake(relief(), tolerance=tolerance)
    assert baked.tolerance_met
    assert baked.error.rms <= tolerance
    assert [line.term for line in baked.plan][:3] == ["lobe_0", "lobe_1", "lobe_2"]
    assert all("%" in line.why for line in baked.plan[:3])


def test_a_missed_tolerance_is_said_with_the_knob_that_helps():
    """Texture blurs cannot reach 0.1 % on stretched UVs."""
    baked = _bake(relief(), method="texture", tolerance=1e-3)
    assert not baked.tolerance_met
    assert "diffusion.method" in baked.advice


def test_surface_is_nearer_than_stretch_and_stretch_than_texture():
    """On a chart stretched three times on its flanks."""
    rms = {
        m: _bake(relief(), (200, 200), method=m, tolerance=0.001).error.method
        for m in ("texture", "stretch", "surface")
    }
    assert rms["surface"] < 0.0015
    assert rms["surface"] < 0.5 * rms["stretch"]
    assert rms["stretch"] < 0.8 * rms["texture"]


def test_stretch_equals_surface_on_a_sheared_plane():
    """A first-order metric is exact where the chart is affine: shear, and 2 mm by 0.8 mm texels."""
    flat = quad(120, 60, uv_box=(0.1, 0.1, 0.6, 0.9))
    uv = flat.corner_uv.copy()
    uv[..., 0] += 0.4 * uv[..., 1]
    mesh = SkinMesh(flat.positions_mm, flat.faces, uv, flat.corner_normal)
    skin = GaussianSum(np.array([9.0]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    assert _bake(mesh, (128, 96), skin=skin, method="stretch", tolerance=1e-4).error.method < 3e-3


def test_two_tiles_bake_as_one():
    """Light crosses the border of UDIM tiles; both meet the tolerance against their own reference."""
    for tiles in (1, 2):
        baked = _bake(sphere(20, "latlong", 48, tiles), (160, 120), udim=tiles > 1, tolerance=0.01)
        assert baked.error.rms < 0.01
        assert sorted(baked.lobes[0].rgb) == list(range(1001, 1001 + tiles))


@pytest.mark.parametrize("scale", [1e-30, 1e-8, 1e5, 1e30])
def test_brightness_does_not_matter(scale):
    """Diffusion is linear: errors and lobes are those of light 1, finite, times the scale."""
    one, scaled = (_bake(relief(), (64, 61), scale=s, precision="float", method="surface") for s in (1.0, scale))
    for a, b in zip(one.lobes, scaled.lobes, strict=True):
        np.testing.assert_allclose(b.rgb[1001] / np.float32(scale), a.rgb[1001], rtol=2e-4, atol=1e-6)
    assert scaled.error.rms == pytest.approx(one.error.rms, abs=1e-4)


def test_darkness_stays_dark():
    """No light, no error, nothing that is not a number."""
    baked = _bake(relief(), (64, 61), scale=0.0)
    assert baked.error.rms == 0
    assert all(not lobe.rgb[1001].any() for lobe in baked.lobes)


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 1.0, 1e2, 1e3])
@pytest.mark.parametrize("method", ["texture", "stretch", "hybrid", "surface", "auto"])
def test_any_width_is_finite_and_within_the_light_s_range(sigma, method):
    """Sigma from a thousandth of a texel to a thousand texels (a texel is 1 mm here)."""
    skin = GaussianSum(np.array([sigma**2]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    baked = _bake(quad(48, 45), (48, 45), skin=skin, method=method, probes=50, tolerance=0.02)
    values = baked.lobes[0].rgb[1001]
    assert np.isfinite(values).all()
    assert values.min() >= -1e-6
    assert values.max() <= 0.81
    assert baked.error.rms < 0.2


@pytest.mark.parametrize("size", [(1, 1), (1, 33), (29, 1), (31, 17)])
def test_any_texture_size_bakes(size):
    """One texel, 1 x N, N x 1, odd."""
    baked = _bake(quad(20, 30), size, probes=20, tolerance=0.5)
    assert np.isfinite(baked.lobes[-1].rgb[1001]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_light_that_is_not_finite_is_refused_by_its_address(bad):
    """Tile, light, row and column."""
    mesh = quad()
    atlas = rasterize(mesh, (12, 9))
    source = _source(mesh, atlas)
    source[1001][0, 4, 7, 1] = bad
    with pytest.raises(InputError, match="tile 1001: light key is not finite at row 4, column 7"):
        diffuse(source, ("key",), atlas, mesh, SKIN, DiffusionSpec(), 0)


def test_light_of_another_size_is_refused():
    """Shape expected and got."""
    mesh = quad()
    with pytest.raises(InputError, match=r"expected shape \(1, 9, 12, 3\), got \(1, 9, 11, 3\)"):
        diffuse(
            {1001: np.zeros((1, 9, 11, 3), np.float32)},
            ("key",),
            rasterize(mesh, (12, 9)),
            mesh,
            SKIN,
            DiffusionSpec(),
            0,
        )


def test_faces_without_area_and_flipped_ones_do_no_harm():
    """Zero UV area, zero area, a mirrored chart."""
    mesh = relief(segments=12)
    uv, faces = mesh.corner_uv.copy(), mesh.faces.copy()
    uv[0] = uv[0, 0]
    faces[1] = faces[1, 0]
    flipped = SkinMesh(mesh.positions_mm, faces, 1 - uv[..., ::-1], mesh.corner_normal)
    for method in ("auto", "texture", "stretch", "hybrid"):
        baked = _bake(flipped, (64, 64), method=method)
        assert all(np.isfinite(lobe.rgb[1001]).all() for lobe in baked.lobes)


def test_totals_are_reported():
    """Near 1 for every lobe of a closed surface."""
    baked = _bake(sphere(30, "cube", 48), (180, 120), method="surface")
    for lobe in baked.lobes:
        np.testing.assert_allclose(lobe.total_rgb, 1, atol=0.01)


def test_same_seed_same_bytes():
    """Plan, lobes and errors."""
    first, second = (_bake(relief(), (96, 80), lights=2) for _ in range(2))
    assert first.error == second.error
    assert first.plan == second.plan
    for a, b in zip(first.lobes, second.lobes, strict=True):
        np.testing.assert_array_equal(a.rgb[1001], b.rgb[1001])
