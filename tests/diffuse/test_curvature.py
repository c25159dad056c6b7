"""Round skin: a bake's ball in a sky and under a sun, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.terms.beam_shift import BeamShift
from skinbake.diffuse.terms.curvature import MOST_GAIN, CurvedSkin, curve_skin, lobe_factors
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.irradiance.occluder import Occluder
from skinbake.profile import GaussianSum
from skinbake.profile.curved_skin import curved_gain
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.spec import TextureSpec
from tests.shapes import quad, sphere

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
MEDIUM = SkinMedium((Layer(SKIN, np.inf, 1.4),))
VARIANCE = np.array([0.002, 1.0, 12.0])
RADIUS = 20.0


def profile(normalise="none"):
    weight = np.array([[0.1, 0.1, 0.06], [0.15, 0.07, 0.03], [0.15, 0.03, 0.01]])
    weight = weight / weight.sum(axis=0) if normalise == "white" else weight
    return GaussianSum(VARIANCE, weight, np.zeros(3), weight.sum(axis=0), "dipole", normalise)


def even_lobes(gaussians, size=(47, 31)):
    image = np.full((1, *size[::-1], 3), 2.0, np.float32)
    return tuple(
        Lobe(float(v), tuple(w), "surface", {1001: image})
        for v, w in zip(gaussians.variance_mm2, gaussians.weight_rgb, strict=True)
    )


def test_a_ball_in_even_light_sends_back_the_gain():
    """Lobes of constant light sum to the profile's total times the gain of 1 / r; the narrow one is left."""
    mesh, gaussians = sphere(RADIUS, "cube", 48), profile()
    curved, line = curve_skin(mesh, TextureSpec(size=(96, 64)), gaussians, MEDIUM, "auto", 1e-4)
    assert curved is not None
    assert line.enabled
    lobes = even_lobes(gaussians)
    bent = curved.applied(lobes)
    assert bent[0].rgb[1001] is lobes[0].rgb[1001]
    np.testing.assert_array_equal(lobes[2].rgb[1001], 2.0)  # a copy was changed
    total = sum(np.asarray(lobe.weight_rgb) * np.median(lobe.rgb[1001][0], axis=(0, 1)) for lobe in bent)
    want = 2 * gaussians.weight_rgb.sum(axis=0) * curved_gain(SKIN, 1.4, np.array([1 / RADIUS]))[0]
    np.testing.assert_allclose(total, want, rtol=0.015)
    assert bent[2].rgb[1001].min() > 0


def test_lobes_share_any_gain():
    """Weighted, the factors are the gain, above and below 1, and none is below 0; of a plane they are 1."""
    weight, share = np.array([[0.1, 0.2], [0.2, 0.1], [0.1, 0.1]]), np.array([[0.2, 0.5], [0.8, 1.0], [2.2, 2.0]])
    factors = lobe_factors(weight, share)
    gain = np.linspace(0, MOST_GAIN, factors.shape[1])
    mean = (weight[:, None] * factors).sum(axis=0) / weight.sum(axis=0)
    above, below = gain >= 1, (gain > 0.01) & (gain < 1)
    want = 1 + (weight * share).sum(axis=0) / weight.sum(axis=0) * (gain[above, None] - 1)
    np.testing.assert_allclose(mean[above], want, rtol=1e-6)
    np.testing.assert_allclose(mean[below], np.repeat(gain[below, None], 2, axis=1), rtol=1e-3)
    assert factors.min() >= 0
    np.testing.assert_allclose(factors[:, np.abs(gain - 1).argmin()], 1, atol=1e-6)


def test_what_another_lobe_adds_is_taken_off():
    """In even light the lobes and light through a thin part come to the gain together."""
    gaussians = profile()
    total = gaussians.weight_rgb.sum(axis=0)
    gain, through = np.full((4, 4, 3), 1.3, np.float32), np.full((8, 8, 3), 0.45, np.float32)
    curved = CurvedSkin({1001: gain}, {1001: gain}, gaussians.weight_rgb, np.ones((3, 3)), MEDIUM.layers[0])
    bent = curved.applied(even_lobes(gaussians), {1001: through})
    light = sum(np.asarray(lobe.weight_rgb) * lobe.rgb[1001][0].mean(axis=(0, 1)) for lobe in bent)
    np.testing.assert_allclose(light + 2 * 0.45 * total, 2 * 1.3 * total, rtol=2e-3)


def test_form_finer_than_the_texels_of_a_wide_lobe_is_kept():
    """Lobes stored at 8 x 6 texels show a gain that changes from each of its 64 x 48 to the next."""
    gaussians = profile()
    gain = np.where(np.indices((48, 64)).sum(axis=0) % 2, 0.7, 1.6).astype(np.float32)[..., None].repeat(3, axis=2)
    curved = CurvedSkin({1001: gain}, {1001: gain}, gaussians.weight_rgb, np.ones((3, 3)), MEDIUM.layers[0])
    bent = curved.applied(even_lobes(gaussians, (8, 6)))
    light = sum(np.asarray(of.weight_rgb) * magnify_bilinear(of.rgb[1001][0], gain.shape[:2]) for of in bent)
    np.testing.assert_allclose(light, 2 * gain * gaussians.weight_rgb.sum(axis=0), rtol=2e-3)


def test_lobes_of_the_same_pixels_are_put_aside_once():
    """Two narrow ones that are the light itself keep one texture with figures of their own, the wide one another."""
    gaussians, put = profile(), []
    gain = np.full((4, 4, 3), 1.3, np.float32)
    share = np.array([[0.0, 0, 0], [0, 0, 0], [1, 1, 1]])
    curved = CurvedSkin({1001: gain}, {1001: gain}, gaussians.weight_rgb, share, MEDIUM.layers[0])

    def aside(lobe):
        put.append(lobe.rgb.pop(1001) / 2)
        return replace(lobe, rgb={1001: put[-1]})

    bent = curved.applied(even_lobes(gaussians), aside=aside)
    assert len(put) == 2
    assert bent[0].rgb[1001] is bent[1].rgb[1001]
    np.testing.assert_array_equal(bent[0].rgb[1001], 1)
    assert bent[2].rgb[1001].min() > 1
    assert [lobe.variance_mm2 for lobe in bent] == gaussians.variance_mm2.tolist()


def test_round_skin_holds_more_of_the_light_that_arrives():
    """The root of the gain of 1 / r on a ball, nothing where a ray met no skin, and nothing of a white profile."""
    mesh = sphere(RADIUS, "cube", 48)
    size = TextureSpec(size=(96, 64))
    curved, _ = curve_skin(mesh, size, profile(), MEDIUM, "on", 0.0)
    face = np.append(np.arange(0, len(mesh.faces), 7), -1)
    held = curved.held(mesh, False, face, mesh.corner_uv[face].mean(axis=1))
    want = np.sqrt(curved_gain(SKIN, 1.4, np.array([1 / RADIUS]))[0])
    np.testing.assert_allclose(np.median(held[:-1], axis=0), want, rtol=0.01)
    np.testing.assert_array_equal(held[-1], 1)
    white, _ = curve_skin(mesh, size, profile("white"), MEDIUM, "on", 0.0)
    assert white.held(mesh, False, face, mesh.corner_uv[face].mean(axis=1)) is None
    layers = SkinMedium((Layer(SKIN, 1.0, 1.4), Layer(SKIN, np.inf, 1.4)))
    several, _ = curve_skin(mesh, size, profile(), layers, "on", 0.0)
    assert several.held(mesh, False, face, mesh.corner_uv[face].mean(axis=1)) is None


def test_a_white_profile_looks_in_even_light_as_its_albedo():
    """Albedo maps hold what the skin's form makes of even light: lobes stay as they are."""
    mesh, gaussians = sphere(RADIUS, "cube", 24), profile("white")
    curved, line = curve_skin(mesh, TextureSpec(size=(64, 64)), gaussians, MEDIUM, "on", 0.0)
    assert line.enabled
    for lobe, bent in zip(even_lobes(gaussians), curved.applied(even_lobes(gaussians)), strict=True):
        np.testing.assert_array_equal(bent.rgb[1001], lobe.rgb[1001])


def test_a_shifted_beam_keeps_its_total():
    """Over a ball under a sun, the light that stands further along is as much as what arrived; unspread, too much."""
    mesh = sphere(RADIUS, "cube", 48)
    size = (192, 128)
    (raster,) = rasterize(mesh, size)
    occluder = Occluder(mesh)
    sun = DirectionalLight(name="sun", type="directional", direction=(0.3, -0.2, -1.0), irradiance=(1, 1, 1))
    normal = interpolate(raster, mesh.corner_normal)
    cosine = -(normal @ np.asarray(sun.direction)) / np.linalg.norm(sun.direction)
    arrives = np.repeat(np.maximum(cosine, 0)[..., None], 3, axis=2).astype(np.float32)
    curved, _ = curve_skin(mesh, TextureSpec(size=size), profile(), MEDIUM, "on", 0.0)
    area = raster.area_mm2[..., None]
    total = (area * arrives).sum(axis=(0, 1))
    gained = []
    for curvature in (None, curved.curvature_per_mm[1001]):
        shift = BeamShift(
            raster, TexturedSkin(mesh, occluder, raster.shape[::-1]), 0, SKIN.free_path_mm, 1.4, curvature
        )
        gained.append((area * shift.read(sun, arrives)).sum(axis=(0, 1)) / total - 1)
    # 4/3 of a free path over the radius and the index, to first order
    np.testing.assert_allclose(gained[0], 4 / 3 * SKIN.free_path_mm / 1.4 / RADIUS, rtol=0.15)
    assert np.all(np.abs(gained[1]) < 0.2 * gained[0])


@pytest.mark.parametrize(
    ("switch", "medium", "why"),
    [
        ("off", MEDIUM, "off"),
        ("auto", SkinMedium((Layer(SKIN, 0.3, 1.4), Layer(SKIN, np.inf, 1.4)), named=True), "several layers"),
        ("auto", SkinMedium(why="model table gives a profile"), "model table"),
    ],
)
def test_it_is_left_out_where_it_is_not_known(switch, medium, why):
    """Off, layers that are only named, no medium: no factors, and the plan says why."""
    curved, line = curve_skin(sphere(RADIUS, "cube", 8), TextureSpec(size=(32, 32)), profile(), medium, switch, 0.0)
    assert curved is None
    assert not line.enabled
    assert why in line.why


def test_flat_skin_is_left_alone():
    """A plate has no curvature worth a factor, and the plan tells what was left out."""
    plate = quad(40.0, 40.0, 0.0, columns=8, rows=8, uv_box=(0, 0, 1, 1))
    curved, line = curve_skin(plate, TextureSpec(size=(32, 32)), profile(), MEDIUM, "auto", 1e-4)
    assert curved is None
    assert line.error == 0.0
    assert "0.00%" in line.why
