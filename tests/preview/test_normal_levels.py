"""Normal maps that are finer than a picture's pixels: their levels, and the highlights that these give."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.errors import MachineError
from skinbake.numerics import normalized
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode
from skinbake.preview.normal_levels import LEVELS, normal_levels
from skinbake.preview.scene import PreviewLobe
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec
from tests.preview.reference import shade
from tests.preview.scenes import LIGHTS, scene
from tests.shapes import quad


def bumps(rows, cols, slope):
    """Unit normals whose slopes are normal deviates of that size along each axis, smooth over four texels."""
    s = np.random.default_rng(1).normal(0, 1, (rows, cols, 2))
    for axis in (0, 1):
        s = sum(weight * np.roll(s, i, axis) for i, weight in enumerate((1, 4, 6, 4, 1)))
    s *= slope / s.std()
    return normalized(np.concatenate([s, np.ones((rows, cols, 1))], axis=2)).astype(np.float32)


@pytest.mark.parametrize("space", ["tangent", "object"])
def test_levels_are_means_of_what_they_stand_for(space):
    """Direction of the mean of the bent normals, and what their slopes vary, up to slopes of a few tenths."""
    strength = 0.5
    bent = strength if space == "tangent" else 1.0
    normal = bumps(67, 90, 0.2)
    levels = normal_levels(normal, strength, space)
    assert [level.shape[:2] for level in levels] == [(67 >> i, 90 >> i) for i in range(LEVELS)]
    np.testing.assert_array_equal(levels[0][..., :3], normal)
    assert not levels[0][..., 3].any()
    block = normalized(normal[16:24, 40:48] * [bent, bent, 1]).reshape(-1, 3)
    found = levels[3][2, 5]
    np.testing.assert_allclose(normalized(found[:3] * [bent, bent, 1]), normalized(block.mean(0)), atol=1e-6)
    slopes = block[:, :2] / block[:, 2:]
    assert found[3] == pytest.approx(slopes.var(0).sum(), rel=0.15)
    flat = normal_levels(np.broadcast_to(np.float16([0, 0, 1]), (8, 8, 3)), strength, space)
    assert all(level.dtype == np.float16 and not level[..., 3].any() for level in flat)


def test_what_is_no_normal_does_not_count():
    """In object space a texel without one; in tangent space one that points inwards leaves the skin smooth."""
    normal = np.zeros((2, 2, 3), np.float32)
    normal[0, 0] = 0, 0.6, 0.8
    np.testing.assert_allclose(normal_levels(normal, 1.0, "object")[1][0, 0], [0, 0.6, 0.8, 0], atol=1e-6)
    mean = normal_levels(np.float32([[[0, 0.6, 0.8], [0.6, 0, -0.8]]]), 1.0, "tangent")[1][0, 0]
    np.testing.assert_allclose(mean[:3], [0, 0.3, 0.9], atol=1e-6)
    assert np.isfinite(normal_levels(np.zeros((4, 4, 3), np.float32), 0.0, "tangent")[2]).all()


@pytest.mark.parametrize("space", ["tangent", "object"])
def test_the_shader_reads_the_levels_as_numpy_does(space):
    whole = scene()
    maps = replace(whole.maps, normal={1001: bumps(900, 1100, 0.2)}, normal_space=space)
    camera = view(whole.mesh, "three-quarter", 1.3)
    try:
        with OffscreenRenderer(replace(whole, maps=maps)) as opened:
            image = opened.draw(camera, (211, 163), supersample=1, geometry=True)
    except MachineError as error:
        pytest.skip(str(error))
    shown = image.geometry.tile > 0
    assert 1 < np.median(image.geometry.normal_level[shown]) < 4
    want = shade(opened.scene, image.geometry, camera, Mode(), np.ones((len(LIGHTS), 3)))[shown]
    near = np.abs(image.rgba[shown][:, :3] - want) <= 2e-3 * np.abs(want) + 1e-6
    assert near.all(axis=1).mean() >= 0.999


def test_a_small_picture_has_the_highlight_of_the_large_one(monkeypatch):
    """A point a pixel against the mean of 16 x 16 points, on bumps that are finer than a pixel: neither a glitter nor
    the highlight of smooth skin.
    """
    sun = DirectionalLight(name="sun", type="directional", direction=(-0.5, -0.2, -1), irradiance=(1.0,) * 3)
    one = {1001: np.ones((1, 3, 5, 3), np.float32)}
    whole = replace(
        scene(with_maps=False),
        mesh=quad(60.0, 60.0),
        lights=(sun,),
        lobes=(PreviewLobe(one, (1.0, 1.0, 1.0), 0.0),),
        irradiance=one,
        visibility={1001: np.ones((1, 3, 5), np.float32)},
        specular=SpecularSpec(roughness=0.15, strength=1.0),
        maps=SkinMaps(normal={1001: bumps(1024, 1024, 0.12)}),
        energy_conservation=False,
    )
    camera = view(whole.mesh, "front", 1.0)
    try:
        with OffscreenRenderer(whole) as opened:
            small = opened.draw(camera, (50, 50), Mode("specular"), supersample=1, geometry=True)
            fine = opened.draw(camera, (50, 50), Mode("specular"), supersample=16).rgba
    except MachineError as error:
        pytest.skip(str(error))
    inside = (slice(15, 35), slice(15, 35))
    texels = 1024 * (small.geometry.uv[25, 26, 0] - small.geometry.uv[25, 25, 0])
    assert small.geometry.normal_level[25, 25] == pytest.approx(np.log2(texels), abs=1e-3)
    got, want = small.rgba[inside][..., 0], fine[inside][..., 0]
    with OffscreenRenderer(replace(whole, maps=SkinMaps())) as opened:
        smooth = opened.draw(camera, (50, 50), Mode("specular"), supersample=1).rgba[inside][..., 0]
    monkeypatch.setattr("skinbake.preview.normal_levels.LEVELS", 1)
    with OffscreenRenderer(whole) as opened:
        glitter = opened.draw(camera, (50, 50), Mode("specular"), supersample=1).rgba[inside][..., 0]
    assert got.mean() == pytest.approx(want.mean(), rel=0.05)
    assert smooth.mean() < 0.7 * want.mean()
    assert got.std() < 1.5 * want.std() < 0.5 * glitter.std()
