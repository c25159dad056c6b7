"""Where the texture's blur is right it stays, where it is wrong sums take its place, and nothing else decides."""

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse.evaluator import LobeEvaluator
from skinbake.diffuse.probes import draw_probes
from skinbake.diffuse.texture_space.blur import texture_blur
from skinbake.kernels.simd import LANES
from skinbake.scene.spec import DiffusionSpec
from tests.shapes import quad, relief, sphere


def diffuser_of(mesh, size=(240, 160), lights=1, edge_mm=0.3, **spec):
    """Hard-edged light from one side; a second light is other stripes."""
    atlas = rasterize(mesh, size, gutter=4)
    position = interpolate(atlas[0], mesh.corner_position_mm)
    waves = [np.sin(edge_mm * position[..., 0]) > 0.3, np.sin(0.5 * edge_mm * position[..., 1]) > 0.0][:lights]
    light = np.stack([(w * atlas[0].addressed)[..., None] * np.array([1, 0.8, 0.6]) for w in waves])
    return LobeEvaluator([light.astype(np.float32)], atlas, mesh, DiffusionSpec(**spec))


def shares(diffuser, variance, threshold, level=0):
    """How much sums count by light, 0 ... 1, and the kernel's mass on charts, of the first tile."""
    raster = diffuser.level_atlas(level)[0]
    mass = np.empty(raster.shape, np.float32)
    blurred = texture_blur(diffuser.pyramids[0], diffuser.variance_texels2(variance), level, None, mass)
    return diffuser.predictor(0, level).share_of_sums(variance, threshold, blurred, mass) / 255, mass


def rms(diffuser, variance, *plan):
    """Relative, of a map read at many texels against the exact integral."""
    points = [p for p, _, _ in diffuser.surface.tiles]
    probes = draw_probes(diffuser.atlas, diffuser.mesh, points, 1500, 0)
    exact = diffuser.reference(variance, probes)
    got = diffuser.at_texel(probes) if plan[0] == "identity" else diffuser.read(diffuser.map(*plan), probes, half=False)
    return np.sqrt(((got - exact) ** 2).sum() / (exact**2).sum())


@pytest.mark.parametrize("layout", ["cube", "latlong"])
@pytest.mark.parametrize("variance", [0.3, 2.0])
def test_few_sums_take_most_of_the_texture_s_error_away(layout, variance):
    """Seams and shadow edges are a small part of the texels, and nearly all of the error."""
    diffuser = diffuser_of(sphere(30, layout, 96), (512, 384), edge_mm=0.1, tolerance=0.003)
    texture = rms(diffuser, variance, "texture", variance, 0, 0.0, 0.0)
    hybrid = rms(diffuser, variance, "hybrid", variance, 0, 0.7, 0.02)
    surface = rms(diffuser, variance, "surface", variance, 0, 0.7, 0.0)
    share, _ = shares(diffuser, variance, 0.02)
    covered = diffuser.atlas[0].area_mm2 > 0
    assert texture > 0.004
    assert hybrid < max(0.25 * texture, surface + 1e-3)
    assert (share[0] > 0)[covered].mean() < 0.5


def test_a_plane_is_summed_at_its_border_only():
    """Texels are all the mean one: blurs of any width are right until the chart ends."""
    diffuser = diffuser_of(quad(100, 80, uv_box=(0.1, 0.1, 0.9, 0.9)), edge_mm=0.2)
    (share,), mass = shares(diffuser, 1.0, 0.01)
    assert (share[mass > 0.9999] == 0).all()
    inside = diffuser.atlas[0].addressed
    assert (share[inside & (mass < 0.98)] == 1).all()
    assert 0 < (share > 0).sum() < 0.25 * inside.sum()


def test_the_share_falls_smoothly_and_grows_as_the_threshold_falls():
    """No line where the two methods meet: between both ends all values occur."""
    diffuser = diffuser_of(relief(), (200, 200))
    before = 0
    for threshold in (0.2, 0.05, 0.01):
        (share,), _ = shares(diffuser, 0.5, threshold)
        assert ((share > 0.2) & (share < 0.8)).sum() > 20
        assert (share > 0).sum() > before
        before = (share > 0).sum()


@pytest.mark.parametrize("level", [0, 1])
def test_a_few_texels_get_the_shares_that_the_map_has(level):
    """What a plan reads at its probes is what the map will hold."""
    diffuser, variance, threshold = diffuser_of(relief(), (200, 180), lights=2), 2.0, 0.02
    flat = np.arange(0, np.prod(diffuser.level_atlas(level)[0].shape), 37)
    few = diffuser.predictor(0, level).shares_of_texels(
        variance, threshold, flat, *diffuser._blurred(0, variance, level, flat)
    )
    for light in range(2):
        share = shares(diffuser, variance, threshold, level)[0][light]
        assert share.any()
        np.testing.assert_allclose(few[:, light], share.reshape(-1)[flat], atol=6e-3)  # steps of 1 / 255


def test_read_hybrid_is_what_reading_the_map_gives():
    """At probes, by four texels each, before anything is made; sums that look far, for the little they add depends."""
    diffuser = diffuser_of(sphere(30, "cube", 48), (240, 160), lights=2, tolerance=1e-7)
    probes = draw_probes(diffuser.atlas, diffuser.mesh, [p for p, _, _ in diffuser.surface.tiles], 300, 0)
    plan = 1.0, 0, 0.8, 0.02
    got = diffuser.read_hybrid(*plan, probes)
    want = diffuser.read(diffuser.map("hybrid", *plan), probes, half=False)
    np.testing.assert_allclose(got, want, atol=2e-3)
    assert np.abs(got - want).mean() < 1e-4


def test_a_light_s_lobe_does_not_depend_on_what_else_is_lit():
    """To the last bit, alone and together, dark lights too."""
    both = diffuser_of(sphere(30, "cube", 48), (240, 160), lights=2)
    with_dark = LobeEvaluator(
        [np.concatenate([both.source[0], 0 * both.source[0][:1]])], both.atlas, both.mesh, both.spec
    )
    together = with_dark.map("hybrid", 1.0, 0, 0.8, 0.02)[0]
    for light in range(2):
        alone = LobeEvaluator([both.source[0][light : light + 1].copy()], both.atlas, both.mesh, both.spec)
        np.testing.assert_array_equal(alone.map("hybrid", 1.0, 0, 0.8, 0.02)[0][0], together[light])
    assert not together[2].any()


def test_brighter_light_is_summed_at_the_same_texels():
    """The prediction is in units of the light's own mean."""
    diffuser = diffuser_of(relief(), (200, 180))
    brighter = LobeEvaluator([diffuser.source[0] * np.float32(64)], diffuser.atlas, diffuser.mesh, diffuser.spec)
    first, second = (shares(d, 0.5, 0.02)[0] for d in (diffuser, brighter))
    np.testing.assert_allclose(second, first, atol=1.1 / 255)


def test_scattered_targets_share_batches():
    """Sums at a few texels, here and there, are those of the whole map."""
    diffuser = diffuser_of(sphere(30, "cube", 48), (240, 160), tolerance=1e-7)
    whole = diffuser.map("surface", 1.0, 0, 0.8)[0][0]
    everywhere = diffuser.map("hybrid", 1.0, 0, 0.8, 1e-9)[0][0]
    some = diffuser.map("hybrid", 1.0, 0, 0.8, 0.05)[0][0]
    (share,), _ = shares(diffuser, 1.0, 0.05)
    full = (share == 1) & (diffuser.atlas[0].area_mm2 > 0)
    assert LANES < full.sum() < 0.5 * full.size
    np.testing.assert_allclose(some[full], whole[full], atol=2e-5)
    covered = diffuser.atlas[0].area_mm2 > 0
    assert np.abs(everywhere[covered] - whole[covered]).mean() < 1e-4
