"""Where the texture's blur is right it stays, where it is wrong sums take its place, and nothing else decides."""

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.probes import read_at_probes
from skinbake.diffuse.texture_space.blur import texture_blur
from skinbake.diffuse.texture_space.blur_at_probes import blur_of_texels
from skinbake.kernels.simd import LANES
from tests.diffuse.lobes import exact_at, lobe_map, probes_of, resources_of
from tests.shapes import quad, relief, sphere


def lit(mesh, size=(240, 160), lights=1, edge_mm=0.3, **spec):
    """Hard-edged light from one side; a second light is other stripes."""
    atlas = rasterize(mesh, size, gutter=4)
    position = interpolate(atlas[0], mesh.corner_position_mm)
    waves = [np.sin(edge_mm * position[..., 0]) > 0.3, np.sin(0.5 * edge_mm * position[..., 1]) > 0.0][:lights]
    light = np.stack([(w * atlas[0].addressed)[..., None] * np.array([1, 0.8, 0.6]) for w in waves])
    return resources_of([light.astype(np.float32)], atlas, mesh, **spec)


def shares(resources, variance, threshold, level=0):
    """How much sums count by light, 0 ... 1, and the kernel's mass on charts, of the first tile."""
    raster = resources.geometry.level_atlas(level)[0]
    mass = np.empty(raster.shape, np.float32)
    blurred = texture_blur(
        resources.pyramids.get()[1001], resources.geometry.variance_texels2(variance), level, None, mass
    )
    return resources.predictor(1001, level).share_of_sums(variance, threshold, blurred, mass) / 255, mass


def rms(resources, method, variance, *plan):
    """Relative, of a map read at many texels against the exact integral."""
    probes = probes_of(resources, 1500)
    exact = exact_at(resources, variance, probes)
    got = read_at_probes(METHODS[method].map(resources, LobeParameters(variance, *plan)), probes)
    return np.sqrt(((got - exact) ** 2).sum() / (exact**2).sum())


@pytest.mark.parametrize("layout", ["cube", "latlong"])
@pytest.mark.parametrize("variance", [0.3, 2.0])
def test_few_sums_take_most_of_the_texture_s_error_away(layout, variance):
    """Seams and shadow edges are a small part of the texels, and nearly all of the error."""
    resources = lit(sphere(30, layout, 96), (512, 384), edge_mm=0.1, tolerance=0.003)
    texture = rms(resources, "texture", variance, 0, 0.0, 0.0)
    hybrid = rms(resources, "hybrid", variance, 0, 0.7, 0.02)
    surface = rms(resources, "surface", variance, 0, 0.7, 0.0)
    share, _ = shares(resources, variance, 0.02)
    covered = resources.geometry.atlas[0].area_mm2 > 0
    assert texture > 0.004
    assert hybrid < max(0.25 * texture, surface + 1e-3)
    assert (share[0] > 0)[covered].mean() < 0.5


def test_a_plane_is_summed_at_its_border_only():
    """Texels are all the mean one: blurs of any width are right until the chart ends."""
    resources = lit(quad(100, 80, uv_box=(0.1, 0.1, 0.9, 0.9)), edge_mm=0.2)
    (share,), mass = shares(resources, 1.0, 0.01)
    assert (share[mass > 0.9999] == 0).all()
    inside = resources.geometry.atlas[0].addressed
    assert (share[inside & (mass < 0.98)] == 1).all()
    assert 0 < (share > 0).sum() < 0.25 * inside.sum()


def test_the_share_falls_smoothly_and_grows_as_the_threshold_falls():
    """No line where the two methods meet: between both ends all values occur."""
    resources = lit(relief(), (200, 200))
    before = 0
    for threshold in (0.2, 0.05, 0.01):
        (share,), _ = shares(resources, 0.5, threshold)
        assert ((share > 0.2) & (share < 0.8)).sum() > 20
        assert (share > 0).sum() > before
        before = (share > 0).sum()


@pytest.mark.parametrize("level", [0, 1])
def test_a_few_texels_get_the_shares_that_the_map_has(level):
    """What a plan reads at its probes is what the map will hold."""
    resources, variance, threshold = lit(relief(), (200, 180), lights=2), 2.0, 0.02
    flat = np.arange(0, np.prod(resources.geometry.level_atlas(level)[0].shape), 37)
    texels2 = resources.geometry.variance_texels2(variance)
    blurred = blur_of_texels(resources.pyramids.get()[1001], texels2, level, flat)
    few = resources.predictor(1001, level).shares_of_texels(variance, threshold, flat, *blurred)
    for light in range(2):
        share = shares(resources, variance, threshold, level)[0][light]
        assert share.any()
        np.testing.assert_allclose(few[:, light], share.reshape(-1)[flat], atol=6e-3)  # steps of 1 / 255


def test_read_hybrid_is_what_reading_the_map_gives():
    """At probes, by four texels each, before anything is made; sums that look far, for the little they add depends."""
    resources = lit(sphere(30, "cube", 48), (240, 160), lights=2, tolerance=1e-7)
    probes, hybrid, lobe = probes_of(resources, 300), METHODS["hybrid"], LobeParameters(1.0, 0, 0.8, 0.02)
    got = hybrid.read_stored(resources, lobe, probes)
    want = read_at_probes(hybrid.map(resources, lobe), probes)
    np.testing.assert_allclose(got, want, atol=2e-3)
    assert np.abs(got - want).mean() < 1e-4


def test_a_light_s_lobe_does_not_depend_on_what_else_is_lit():
    """To the last bit, alone and together, dark lights too."""
    both = lit(sphere(30, "cube", 48), (240, 160), lights=2)
    atlas, mesh = both.geometry.atlas, both.geometry.mesh
    with_dark = resources_of([np.concatenate([both.source[1001], 0 * both.source[1001][:1]])], atlas, mesh)
    together = lobe_map(with_dark, "hybrid", 1.0, 0, 0.8, 0.02)
    for light in range(2):
        alone = resources_of([both.source[1001][light : light + 1].copy()], atlas, mesh)
        np.testing.assert_array_equal(lobe_map(alone, "hybrid", 1.0, 0, 0.8, 0.02)[0], together[light])
    assert not together[2].any()


def test_brighter_light_is_summed_at_the_same_texels():
    """The prediction is in units of the light's own mean."""
    resources = lit(relief(), (200, 180))
    geometry = resources.geometry
    brighter = resources_of([resources.source[1001] * np.float32(64)], geometry.atlas, geometry.mesh)
    first, second = (shares(each, 0.5, 0.02)[0] for each in (resources, brighter))
    np.testing.assert_allclose(second, first, atol=1.1 / 255)


def test_scattered_targets_share_batches():
    """Sums at a few texels, here and there, are those of the whole map."""
    resources = lit(sphere(30, "cube", 48), (240, 160), tolerance=1e-7)
    whole = lobe_map(resources, "surface", 1.0, 0, 0.8)[0]
    everywhere = lobe_map(resources, "hybrid", 1.0, 0, 0.8, 1e-9)[0]
    some = lobe_map(resources, "hybrid", 1.0, 0, 0.8, 0.05)[0]
    (share,), _ = shares(resources, 1.0, 0.05)
    full = (share == 1) & (resources.geometry.atlas[0].area_mm2 > 0)
    assert LANES < full.sum() < 0.5 * full.size
    np.testing.assert_allclose(some[full], whole[full], atol=2e-5)
    covered = resources.geometry.atlas[0].area_mm2 > 0
    assert np.abs(everywhere[covered] - whole[covered]).mean() < 1e-4
