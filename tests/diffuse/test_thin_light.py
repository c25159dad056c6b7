"""Light through flesh that lights other skin: plates a side apart, one of which gets its light from behind."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.small_blur import SmallBlur
from skinbake.diffuse.terms.bounced_light import SkinLight
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import look_around
from skinbake.diffuse.terms.thin_parts import ThinParts, TranslucentSkin
from skinbake.diffuse.terms.transmission import TransmissionSwitch, TransmittedLight, transmit
from skinbake.diffuse.thin_light import SmallLight, sent_again, sent_on
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SceneSpec, TextureSpec
from tests.diffuse.test_interreflection import SIZE, cavity, plates
from tests.shapes import joined, sphere

ALBEDO = np.array([0.8, 0.5, 0.25])
WEIGHT = np.array([0.9, 0.6, 0.3])
FACING = 0.1998  # [Howell], of squares a side apart


def found(through, blurred, arrived, mode="pre-scatter"):
    """What `sent_on` makes of constants on the lower plate, and a mean over each plate."""
    mesh = plates()
    occluder = Occluder(mesh)
    spec = SceneSpec.model_validate(
        {
            "mesh": {"path": "m.obj", "unit": "mm"}, "texture": {"size": list(SIZE), "gutter": 4},
            "texturing": {"mode": mode},
            "skin": {"model": "burley", "mean_free_path_mm": 1, "albedo_rgb": 0.5}, "output": {"dir": "out"},
            "tolerance": 1e-4,
            "lights": [{"name": "sun", "type": "directional", "direction": [0, 0, 1], "irradiance": [1, 1, 1]}],
        }
    )  # fmt: skip
    gaussians = GaussianSum(np.ones(1), WEIGHT[None], np.zeros(3), WEIGHT)
    thin = ThinParts.of(TranslucentSkin(mesh, occluder, spec.texture, gaussians, ALBEDO, SkinMedium()))
    (tile,) = thin.tiles
    height, width = tile.raster.shape

    def lower(value):
        image = np.zeros((1, height, width, 3), np.float32)
        image[:, :, : width // 2] = value
        return image

    view = look_around(TexturedSkin(mesh, occluder, SIZE), 4, 2.0, 256)
    reflected = np.broadcast_to((ALBEDO * WEIGHT).astype(np.float32), (*view.atlas[0].shape, 3))
    light = SkinLight(view, [reflected], {"sun": np.ones(3, np.float32)}, {"sun": (1, 0.0)})
    lobe = Lobe(1.0, (1.0, 1.0, 1.0), None, {1001: lower(through)})
    lobes = (Lobe(1.0, tuple(WEIGHT), "surface", {1001: lower(blurred)}),)
    maps = SkinMaps(albedo_rgb=tuple(ALBEDO))
    scene = SceneData(mesh, maps, {})
    blur = SmallBlur(view.atlas, mesh, gaussians, maps, spec.diffusion, lobes)
    entered = SmallLight.of({1001: lower(arrived)}, thin)
    out = sent_on(lobe, lobes, entered, ("sun",), light, blur, spec, scene, gaussians).lobe.rgb[1001][0]
    area = np.where(tile.raster.covered, tile.raster.area_mm2, 0)[..., None]
    half = np.arange(width) < width // 2
    return [(out * area)[:, side].sum(axis=(0, 1)) / area[:, side].sum() for side in (half, ~half)]


@pytest.mark.parametrize("mode", ["pre-scatter", "post-scatter"])
def test_a_plate_lit_from_behind_lights_the_other_one(mode):
    """By the form factor and what leaves of it, as shown: times the albedo wherever that is multiplied."""
    shown = 1.0 if mode == "pre-scatter" else ALBEDO
    lower, upper = found(0.5, 0.0, 0.0, mode)
    np.testing.assert_allclose(lower, 0.5, rtol=1e-4)
    np.testing.assert_allclose(upper * shown, FACING * 0.5 * shown * ALBEDO * WEIGHT, rtol=0.03)


def test_what_leaves_where_it_arrived_is_sent_already():
    """Light whose blur is itself adds nothing; what a blur has taken away is not sent, and nothing falls below 0."""
    lower, upper = found(0.0, 0.7, 0.7)
    assert np.abs([lower, upper]).max() < 1e-6
    assert np.abs(found(0.0, 0.2, 0.7)).max() == 0
    _, upper = found(0.0, 0.7, 0.2)
    np.testing.assert_allclose(upper, FACING * 0.5 * WEIGHT * ALBEDO * WEIGHT, rtol=0.03)


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_light_through_flesh_bounces_until_its_own_rest_is_negligible(rho):
    """In a cavity that no lamp reaches a series of its own begins; what is wrong of it is said."""
    mesh = cavity()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 4.0, 16)
    grey, sent = np.full((1, 1, 3), rho, np.float32), [np.full((1, *SIZE, 3), rho, np.float32)]
    light = SkinLight(view, [grey], {"sun": np.ones(3, np.float32)}, {"sun": (64, 0.01)}, {"sun": 0.1})
    (tile,), rms, error = light.lit_by(["sun"], sent)
    here = view.atlas[0].addressed
    np.testing.assert_allclose(tile[0][here], rho / (1 - rho), rtol=0.02)
    area = view.atlas[0].area_mm2.sum(dtype=np.float64)
    assert rms == pytest.approx(rho**2 / (1 - rho) * np.sqrt(3 * area), rel=0.02)
    assert error == pytest.approx(0.1 * rms, rel=0.02)
    (tile,), rms, error = light._replace(bounces={"sun": (2, 0.0)}).lit_by(["sun"], sent)
    rest = rho / (1 - rho) - tile[0][here].mean()
    assert error == pytest.approx(np.hypot(0.1 * rms, rest * rho * np.sqrt(3 * area)), rel=0.02)


def hollow_ball(radius_mm=20.0, wall_mm=2.0):
    """A ball in the left half of the texture, and what is seen from inside its wall in the right half."""
    outside, inside = sphere(radius_mm, "cube", 48), cavity(radius_mm - wall_mm)
    half = np.array([0.5, 1.0])
    return joined(
        replace(outside, corner_uv=outside.corner_uv * half),
        replace(inside, corner_uv=inside.corner_uv * half + [0.5, 0.0]),
    )


def test_what_is_left_out_counts_with_what_skin_sends_on_of_it():
    """A hollow ball, lit all about: what comes through its wall is all there is inside, and goes to and fro."""
    mesh, size, rho = hollow_ball(), (192, 96), 0.8
    occluder = Occluder(mesh)
    gaussians = GaussianSum(np.array([0.02, 1.0]), np.full((2, 3), rho / 2), np.zeros(3), np.full(3, rho))
    (raster,) = rasterize(mesh, size)
    outside = np.arange(size[0]) < size[0] // 2
    lit = np.where(outside[None, :, None], np.ones((*raster.shape, 3), np.float32), 0)[None].astype(np.float32)
    lobes = tuple(Lobe(v, (rho / 2,) * 3, "texture", {1001: lit}) for v in gaussians.variance_mm2)
    diffused = DiffuseMap(("sun",), lobes, None)
    skin = TranslucentSkin(mesh, occluder, TextureSpec(size=size), gaussians, np.full(3, rho), SkinMedium())
    view = look_around(TexturedSkin(mesh, occluder, size), 4, 4.0, 16)
    grey = np.full((1, 1, 3), rho, np.float32)
    light = SkinLight(view, [grey], {"sun": np.ones(3, np.float32)}, {"sun": (64, 0.01)}, {"sun": 0.1})
    weigh = partial(transmit, diffused, ThinParts.of(skin), lights={"sun": TransmittedLight(None, True)})
    switch = TransmissionSwitch("auto", 9.0, 9.0)
    again = partial(sent_again, light, ("sun",))
    (_, alone), (_, whole) = weigh(switch), weigh(switch, again=again)
    assert [alone.enabled, whole.enabled] == [False, False]
    series = rho / (1 - rho)  # of what came through, inside
    assert whole.error == pytest.approx(alone.error * np.hypot(1, series), rel=0.05)
    between = switch._replace(limit=0.5 * (alone.error + whole.error))
    assert not weigh(between)[1].enabled
    assert weigh(between, again=again)[1].enabled


def test_each_light_may_be_the_only_one_that_shines():
    """A dim light that comes from behind has as much of itself in thin parts beside a bright one as alone."""
    mesh, size = hollow_ball(), (192, 96)
    gaussians = GaussianSum(np.array([0.02, 1.0]), np.full((2, 3), 0.4), np.zeros(3), np.full(3, 0.8))
    (raster,) = rasterize(mesh, size)
    outside = interpolate(raster, mesh.corner_uv)[..., :1] < 0.5
    dim, bright = np.where(outside, 0.01, 0.0), np.ones((*raster.shape, 1))
    light = np.stack([np.repeat(each, 3, axis=2).astype(np.float32) for each in (dim, bright)])
    errors, texture = [], TextureSpec(size=size)
    thin = ThinParts.of(TranslucentSkin(mesh, Occluder(mesh), texture, gaussians, np.full(3, 0.8), SkinMedium()))
    for names, rgb in ((("dim",), light[:1]), (("dim", "bright"), light)):
        lobes = tuple(Lobe(v, (0.4,) * 3, "texture", {1001: rgb}) for v in gaussians.variance_mm2)
        from_behind = {name: TransmittedLight(None, True) for name in names}
        switch = TransmissionSwitch("auto", 9.0, 9.0)
        errors.append(transmit(DiffuseMap(names, lobes, None), thin, switch, from_behind)[1].error)
    assert errors[1] >= errors[0] > 0
