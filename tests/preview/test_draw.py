"""The shader computes what NumPy computes from the same pixels, in every mode, and the same again."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.errors import InputError, MachineError
from skinbake.irradiance.bump_terminator import bump_terminator
from skinbake.irradiance.oil_albedo import mean_specular_albedo, specular_albedo
from skinbake.numerics import normalized
from skinbake.preview import textures
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer, draw
from skinbake.preview.mode import Mode
from skinbake.preview.scene import PreviewLobe
from skinbake.preview.shader_light import gains_rgb
from skinbake.preview.target import STRIP
from skinbake.scene.lights import DirectionalLight, PointLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SecondLobeSpec, SpecularSpec, TexturingSpec
from tests.oil_brdf import kelemen_brdf
from tests.preview.reference import shade
from tests.preview.scenes import LIGHTS, scene, varying_scene
from tests.shapes import quad

SIZE = (211, 163)
GAINS = {"key": 0.7, "lamp": (1.5, 0.2, 0.0), "sky": 2.0}
MODES = [Mode("full"), Mode("diffuse"), Mode("specular"), Mode("none"), Mode("lobe", 0), Mode("lobe", 5)]


@pytest.fixture(scope="module")
def renderer():
    try:
        with OffscreenRenderer(scene()) as opened:
            yield opened
    except MachineError as error:
        pytest.skip(str(error))


def same_as_numpy(opened, mode, fold=False):
    """Share of pixels within 1e-3 relative of the NumPy shading of the same geometry."""
    camera = view(opened.scene.mesh, "three-quarter", SIZE[0] / SIZE[1])
    opened._renderer.fold = fold
    image = opened.draw(camera, SIZE, mode, GAINS if opened.scene.separate else None, supersample=1, geometry=True)
    opened._renderer.fold = False
    gains = gains_rgb(opened.scene, GAINS if opened.scene.separate else None)
    want = shade(opened.scene, image.geometry, camera, mode, gains)
    shown = image.geometry.tile > 0
    assert shown.mean() > 0.3
    assert np.array_equal(image.rgba[..., 3] > 0, shown)
    got = image.rgba[shown][:, :3]
    want = want[shown]
    assert want.max() > 0.01
    near = np.abs(got - want) <= 1e-3 * np.abs(want) + 1e-7
    return near.all(axis=1).mean()


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_every_mode_matches_numpy_from_the_same_pixels(renderer, mode):
    assert same_as_numpy(renderer, mode) >= 0.999


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_folded_lights_match_as_well(renderer, mode):
    assert same_as_numpy(renderer, mode, fold=True) >= 0.999


@pytest.mark.parametrize(
    "changes",
    [
        {"texturing": TexturingSpec(mode="post-scatter"), "energy_conservation": False},
        {"texturing": TexturingSpec(mode="pre-scatter"), "with_maps": False},
        {"half": False, "tiles": 2},
        {"maps": replace(scene().maps, normal_space="object")},
        {"specular": SpecularSpec(f0=0.03, strength=0.3, second=SecondLobeSpec(roughness=0.12, mix=0.3))},
        {"maps": replace(scene().maps, f0={1001: np.float32([[0.02, 0.09], [0.3, 0.01], [0.05, 0.15]])})},
    ],
    ids=["post-scatter", "no maps", "two tiles, float", "object space", "second lobe", "f0 by map"],
)
def test_other_scenes_match_as_well(renderer, changes):
    with OffscreenRenderer(scene(**changes)) as other:
        for mode in MODES[:4]:
            assert same_as_numpy(other, mode) >= 0.999


@pytest.mark.parametrize(
    ("names", "scatters", "tiles"),
    [
        (("radius",), True, 2),
        (("radius",), False, 1),
        (("melanin", "haemoglobin"), True, 1),
        (("haemoglobin",), False, 1),
    ],
)
def test_skin_that_varies_matches_as_well(names, scatters, tiles):
    """Weights by a map of widths or by two of pigments, and what does not scatter; also light through thin parts."""
    with OffscreenRenderer(varying_scene(names, scatters, tiles=tiles)) as other:
        for mode in (MODES[0], MODES[3]):
            assert same_as_numpy(other, mode, fold=mode is MODES[0]) >= 0.999


def test_lights_that_the_bake_summed_match_and_take_no_gains(renderer):
    whole = scene()
    summed = tuple(
        replace(x, rgb={t: rgb.astype(np.float32).sum(0, keepdims=True) for t, rgb in x.rgb.items()})
        for x in whole.lobes
    )
    with OffscreenRenderer(replace(whole, lobes=summed, separate=False)) as other:
        for mode in MODES[:4]:
            assert same_as_numpy(other, mode) >= 0.999
        with pytest.raises(InputError, match=r"output\.lights: separate"):
            other.draw(view(whole.mesh, "front", 1.0), (16, 16), light_gains={"key": 2.0})


def test_the_picture_is_linear_in_the_light_gains(renderer):
    camera = view(renderer.scene.mesh, "front", 1.0)
    off = {light.name: 0.0 for light in LIGHTS}
    alone = [renderer.draw(camera, (64, 64), light_gains=off | {light.name: 1.0}).rgba[..., :3] for light in LIGHTS]
    np.testing.assert_allclose(sum(alone), renderer.draw(camera, (64, 64)).rgba[..., :3], rtol=2e-5, atol=1e-6)
    assert all(image.max() > 1e-3 for image in alone)


def test_the_same_picture_comes_again_bit_for_bit(renderer):
    camera = view(renderer.scene.mesh, "left", 0.8)
    first = renderer.draw(camera, (96, 120)).rgba
    again = draw(renderer.scene, camera, (96, 120)).rgba  # another context
    assert first.tobytes() == again.tobytes()


def test_textures_may_come_when_all_else_is_ready(renderer):
    """After others in number and size: the same picture bit for bit, folded or not; another mesh is refused."""
    whole = renderer.scene
    lobe = PreviewLobe({1001: np.zeros((len(LIGHTS), 1, 1, 3), np.float16)}, (1.0, 1.0, 1.0), 0.0)
    stand_in = replace(whole, lobes=(lobe,) * 2, maps=SkinMaps())
    camera = view(whole.mesh, "three-quarter", 1.0)
    with OffscreenRenderer(stand_in) as later:
        for fold in (False, True):
            renderer._renderer.fold = later._renderer.fold = fold
            later.draw(camera, (32, 32))
            later.set_scene(whole)
            got, want = later.draw(camera, (64, 64)), renderer.draw(camera, (64, 64))
            later.set_scene(stand_in)
            renderer._renderer.fold = False
            assert got.rgba.tobytes() == want.rgba.tobytes()
        with pytest.raises(ValueError, match="same mesh"):
            later.set_scene(scene())


def test_maps_are_sent_once_for_two_scenes_that_have_the_same(renderer, monkeypatch):
    """Lobes are sent anew, and a normal map of another strength is."""
    sent, send = [], textures.upload_levels
    monkeypatch.setattr(textures, "upload_levels", lambda levels, most: sent.append(len(levels)) or send(levels, most))
    whole = renderer.scene
    camera = view(whole.mesh, "three-quarter", 1.0)
    lobe = PreviewLobe({1001: np.zeros((len(LIGHTS), 1, 1, 3), np.float16)}, (1.0, 1.0, 1.0), 0.0)
    with OffscreenRenderer(replace(whole, lobes=(lobe,) * len(whole.lobes))) as later:
        later.draw(camera, (32, 32))
        assert len(sent) == 1
        later.set_scene(whole)
        assert later.draw(camera, (64, 64)).rgba.tobytes() == renderer.draw(camera, (64, 64)).rgba.tobytes()
        assert len(sent) == 1
        bumpy = replace(whole, maps=replace(whole.maps, normal_strength=2.0))
        later.set_scene(bumpy)
        picture = later.draw(camera, (64, 64)).rgba
        assert len(sent) == 2
    assert picture.tobytes() == draw(bumpy, camera, (64, 64)).rgba.tobytes()


def test_near_and_far_views_follow_one_another(renderer):
    """A camera may come closer than the near plane of the picture before, and go beyond its far plane."""
    far = view(renderer.scene.mesh, "front", 1.0)
    near, away = (replace(far, distance_mm=far.distance_mm * times) for times in (0.02, 40))
    pictures = [renderer.draw(camera, (48, 48), Mode("full")).rgba for camera in (far, near, away, near, far)]
    np.testing.assert_array_equal(pictures[0], pictures[4])
    np.testing.assert_array_equal(pictures[1], pictures[3])


def test_supersampling_is_the_mean_of_the_finer_picture(renderer):
    """Also in more than one strip of rows, the last one lower than the others."""
    camera = view(renderer.scene.mesh, "front", 30 / 2.5 / STRIP)
    rows = 5 * STRIP // 2
    fine = renderer.draw(camera, (90, 3 * rows), supersample=1).rgba.astype(np.float64)
    coarse = renderer.draw(camera, (30, rows), supersample=3).rgba
    np.testing.assert_allclose(coarse, fine.reshape(rows, 3, 30, 3, 4).mean((1, 3)), rtol=1e-6, atol=1e-7)
    assert len(np.unique(coarse[..., 3])) > 3  # smooth edges


def test_an_unknown_light_is_refused_by_name(renderer):
    with pytest.raises(InputError, match="key, lamp, spot, box, sky, got kicker"):
        renderer.draw(view(renderer.scene.mesh, "front", 1.0), (8, 8), light_gains={"kicker": 1.0})


@pytest.mark.parametrize("roughness", [1e-4, 1e-2, 0.3, 1.0])
@pytest.mark.parametrize("strength", [1 / np.pi, 5.0])
def test_extremes_are_finite_and_not_negative(renderer, roughness, strength):
    behind = DirectionalLight(name="behind", type="directional", direction=(0, 0, 1), irradiance=(1e5,) * 3)  # L = -V
    grazing = DirectionalLight(name="grazing", type="directional", direction=(1, 0, 0), irradiance=(1.0,) * 3)
    inside = PointLight(name="inside", type="point", position_mm=(0.0, 0.0, 0.0), intensity=(1e30,) * 3)
    same = DirectionalLight(name="same", type="directional", direction=(0, 0, -1), irradiance=(1e5,) * 3)  # L = V
    lights = (behind, grazing, inside, same)
    n = len(lights)
    specular = SpecularSpec(f0=0.028, roughness=roughness, strength=strength)
    whole = scene(with_maps=False, specular=specular)
    tiny = PreviewLobe({1001: np.full((n, 1, 1, 3), 1e-8, np.float32)}, (1.0, 1.0, 1.0), 0.0)
    huge = PreviewLobe({1001: np.full((n, 1, 1, 3), 1e30, np.float32)}, (0.5, 0.5, 0.5), 1e3)
    one = {1001: np.ones((n, 1, 1, 3), np.float32)}
    hard = replace(
        whole, lights=lights, lobes=(tiny, huge), irradiance=one, visibility={1001: np.ones((n, 1, 1), np.float32)}
    )
    with OffscreenRenderer(hard) as opened:
        for mode in MODES[:4]:
            rgba = opened.draw(view(hard.mesh, "front", 1.0), (65, 65), mode).rgba
            assert np.isfinite(rgba).all()
            assert rgba.min() >= 0


def test_a_lambertian_quad_gives_back_its_exitance_over_pi(renderer):
    white = SkinMaps()
    one = {1001: np.ones((1, 3, 5, 3), np.float16)}
    plain = replace(
        scene(),
        mesh=quad(60.0, 60.0),
        lights=LIGHTS[:1],
        lobes=(PreviewLobe(one, (0.25, 0.5, 1.0), 0.0),),
        irradiance=one,
        visibility={1001: np.ones((1, 3, 5), np.float16)},
        maps=white,
        energy_conservation=False,
    )
    rgba = draw(plain, view(plain.mesh, "front", 1.0), (21, 21), Mode("diffuse")).rgba
    np.testing.assert_allclose(rgba[10, 10], [0.25 / np.pi, 0.5 / np.pi, 1 / np.pi, 1.0], rtol=1e-6)


@pytest.mark.parametrize("conserving", [False, True])
def test_an_even_sky_is_mirrored_as_its_integral(renderer, conserving):
    """Whether or not the light that arrives in the skin has lost what the oil reflects: the sky is as bright."""
    spec = SpecularSpec(f0=0.08, roughness=0.4, strength=0.318)
    sky, passed = 0.3, 1 - spec.strength * float(mean_specular_albedo(spec.roughness, spec.f0))
    arrives = {1001: np.full((1, 3, 5, 3), np.pi * sky * (passed if conserving else 1), np.float32)}
    plain = replace(
        scene(),
        mesh=quad(60.0, 60.0),
        lights=tuple(light for light in LIGHTS if light.name == "sky"),
        lobes=(PreviewLobe(arrives, (1.0, 1.0, 1.0), 0.0),),
        irradiance=arrives,
        visibility={1001: np.ones((1, 3, 5), np.float32)},
        maps=SkinMaps(),
        specular=spec,
        energy_conservation=conserving,
    )
    rgba = draw(plain, view(plain.mesh, "front", 1.0), (21, 21), Mode("specular")).rgba
    exact = sky * spec.strength * float(specular_albedo(1.0, spec.roughness, spec.f0))
    assert passed < 0.93
    np.testing.assert_allclose(rgba[10, 10, :3], exact, rtol=2e-3)


@pytest.mark.parametrize("elevation_deg", [60.0, 20.0, 8.0, 3.0, 0.5, -2.0])
def test_bumps_fade_out_at_the_terminator_as_the_bake_s_do(renderer, elevation_deg):
    """A tilted normal map under a light that sinks below the skin: the kernel's factor, and none while it is high."""
    tilt, elevation = np.radians(30.0), np.radians(elevation_deg)
    to_light = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    mapped = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    sun = DirectionalLight(name="sun", type="directional", direction=tuple(-to_light), irradiance=(1.0,) * 3)
    one = {1001: np.ones((1, 3, 5, 3), np.float32)}
    bumped = replace(
        scene(with_maps=False),
        mesh=quad(60.0, 60.0),
        lights=(sun,),
        lobes=(PreviewLobe(one, (1.0, 1.0, 1.0), 0.0),),
        irradiance=one,
        visibility={1001: np.ones((1, 3, 5), np.float32)},
        maps=SkinMaps(normal={1001: np.broadcast_to(mapped, (2, 2, 3)).astype(np.float32)}),
        energy_conservation=False,
    )
    camera = view(bumped.mesh, "front", 1.0)
    image = draw(bumped, camera, (21, 21), Mode("specular"), supersample=1, geometry=True)
    cos_mapped = float(mapped @ to_light)
    kept = bump_terminator(cos_mapped, float(to_light[2]))
    assert (kept == 1) == (elevation_deg > 15)
    assert (kept == 0) == (elevation_deg < 0)
    to_view = normalized(camera.position_mm - image.geometry.position_mm[10, 10])
    spec = bumped.specular
    f = kelemen_brdf(mapped, to_light, to_view, spec.roughness, spec.f0, spec.strength)
    np.testing.assert_allclose(image.rgba[10, 10, :3], f * cos_mapped * kept, rtol=2e-4, atol=1e-9)


def test_a_lobe_of_the_wrong_shape_is_refused():
    whole = scene()
    short = replace(whole.lobes[0], rgb={1001: whole.lobes[0].rgb[1001][:2]})
    with pytest.raises(ValueError, match=r"lobe 0, tile 1001: expected shape \(5, h, w, 3\)"):
        replace(whole, lobes=(short,))
