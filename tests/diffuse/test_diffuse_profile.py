"""Light from everywhere by its own profile: what is blurred, what stays, and what the plan says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skinbake
from skinbake.atlas import rasterize
from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.light_entering import light_entering
from skinbake.diffuse.memoize import Memoizer
from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.terms.curvature import MOST_GAIN, STEPS, CurvedSkin, lobe_factors
from skinbake.diffuse.terms.diffuse_profile import TERM, DiffuseProfile, EverywhereLight, layer_of_profile
from skinbake.io.mesh import write_obj
from skinbake.irradiance.decide import decide
from skinbake.irradiance.light_skin import light_skin
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.curved_skin import curved_share
from skinbake.profile.diffuse_shape import LEAST, MOST, diffuse_factors
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.maps import SkinMaps
from skinbake.scene.skin import TransportSkin
from skinbake.scene.spec import SceneSpec
from tests.diffuse.test_interreflection import plates
from tests.diffuse.test_light_entering import ALBEDO, INCIDENCE, MEDIUM, OFF, SKIN, SKY, sun
from tests.diffuse.test_memoize import Store, run
from tests.diffuse.test_methods import lit
from tests.shapes import quad, relief

VARIANCE = np.array([0.05, 0.5, 4.0])
WEIGHT = np.array([[0.01, 0.02, 0.06], [0.2, 0.12, 0.1], [0.3, 0.15, 0.0]])
GAUSSIANS = GaussianSum(VARIANCE, WEIGHT, np.zeros(3), WEIGHT.sum(axis=0), normalise="none")
LAYER = MEDIUM.layers[0]
FACTOR = diffuse_factors(GAUSSIANS, LAYER)
UP = sun(-1.0) | {"shadows": False}


def spec_of(lights, word, **terms):
    output = {"dir": "out", "lights": terms.pop("stored", "separate")}
    return SceneSpec.model_validate(
        {
            "mesh": {"path": "m.obj", "unit": "mm"}, "skin": SKIN | {"normalise": "none"}, "lights": lights,
            "texture": {"size": [48, 40]}, "terms": OFF | {"diffuse_profile": word} | terms, "output": output,
        }
    )  # fmt: skip


def entering(lights, word, mesh=None, medium=MEDIUM, **terms):
    spec, mesh = spec_of(lights, word, **terms), mesh or plates()
    scene, decisions = SceneData(mesh, SkinMaps(albedo_rgb=ALBEDO), {}), decide(spec)
    atlas = rasterize(mesh, spec.texture.size, 2)
    arrived = light_skin(spec, decisions, scene, atlas)
    skin = EnteredSkin(GAUSSIANS, medium, INCIDENCE if medium.layers else None)
    return light_entering(spec, decisions, scene, atlas, arrived, skin), arrived[0]


def line_of(entered, name):
    return next(line for line in entered.plan if line.term == f"{name}.{TERM}")


def test_off_or_left_out_nothing_changes_to_the_bit():
    """`auto` leaves it out here, and says what it was worth; a lamp without bounces has none of it."""
    off, _ = entering([SKY, UP], "off", interreflection="on")
    auto, _ = entering([SKY, UP], "auto", interreflection="on")
    assert off.plan[-1] == replace(off.plan[-1], term=TERM, enabled=False, why="off", error=0.0)
    assert off.everywhere is None
    assert auto.everywhere is None
    assert (auto.rgb[1001] == off.rgb[1001]).all()
    assert auto.digests() == off.digests()
    sky = line_of(auto, "sky")
    assert 0 < sky.error < 0.002
    assert "skies and skin moves about" in sky.why
    assert line_of(entering([UP], "on")[0], "sun").enabled is False


def test_what_comes_from_everywhere_is_the_sky_and_what_skin_sends():
    """Of a lamp all that did not come from it; what is blurred once is the same as without the term."""
    got, arrived = entering([SKY, UP], "on", interreflection="on")
    plain, _ = entering([SKY, UP], "off", interreflection="on")
    assert (got.rgb[1001] == plain.rgb[1001]).all()
    sky, lamp = got.everywhere.rgb[1001]
    assert (sky == got.rgb[1001][0]).all()
    bounced = got.rgb[1001][1] - arrived.rgb[1] * np.array(ALBEDO, np.float32)
    np.testing.assert_allclose(lamp, bounced, atol=1e-6)
    assert lamp.max() > 0.01
    assert got.digests()["sky"] != plain.digests()["sky"]
    np.testing.assert_array_equal(got.everywhere.factor[:, 250], FACTOR)  # at a gain of 1


def test_lights_stay_linear():
    """Each alone, together, twice as bright, and stored summed with a sky."""
    terms, lights = {"interreflection": "on", "bounces": 2}, [UP, sun(-0.4, "back") | {"shadows": False}]
    both = entering(lights, "on", **terms)[0].everywhere.rgb[1001]
    each = [entering([light], "on", **terms)[0].everywhere.rgb[1001] for light in lights]
    np.testing.assert_array_equal(both, np.concatenate(each))
    twice = entering([UP | {"irradiance": [2, 4, 6]}, lights[1]], "on", **terms)[0].everywhere.rgb[1001]
    np.testing.assert_allclose(twice[0], 2 * both[0], rtol=1e-4, atol=1e-6)
    assert both.max() > 0.01
    separate, total = (entering([SKY, UP], "on", **terms, stored=word)[0] for word in ("separate", "total"))
    assert total.names == ("total",)
    np.testing.assert_allclose(
        total.everywhere.rgb[1001][0], separate.everywhere.rgb[1001].sum(axis=0), rtol=1e-4, atol=2e-6
    )


def test_without_a_medium_or_with_a_profile_of_such_light_there_is_none():
    """The plan says why, whatever was asked for."""
    got = entering([SKY], "on", medium=SkinMedium(why="nothing is known"))[0]
    assert got.everywhere is None
    assert got.plan[-1].why == "on: nothing is known"
    layers = [SKIN | {"thickness_mm": float("inf")}]
    del layers[0]["model"]
    own = TransportSkin.model_validate({"model": "transport", "layers": layers, "incidence": "diffuse"})
    assert layer_of_profile(own, MEDIUM, GAUSSIANS) == "the skin's profile is that of light from everywhere"
    assert layer_of_profile(own.model_copy(update={"incidence": "perpendicular"}), MEDIUM, GAUSSIANS) is LAYER


def everywhere_of(rgb, factor=FACTOR):
    return EverywhereLight(
        rgb, VARIANCE, np.repeat(factor[:, None], STEPS + 1, axis=1), {1001: np.ones((1, 1, 3), np.float32)}
    )


@pytest.mark.parametrize("operation", ["map", "at_probes", "read_stored"])
@pytest.mark.parametrize("name", METHODS)
def test_each_reader_of_a_lobe_gets_its_own_light(name, operation):
    """What lamps send plus the factor times the rest, to the bit; of wider lobes the shifted light."""
    from skinbake.diffuse.draw_probes import draw_probes

    near, far, sky = lit(), lit(), {}
    for tile, rgb in far.source.items():
        rgb *= np.float32(0.7)
        sky[tile] = np.stack([rgb[0] * np.float32(0.5), np.zeros_like(rgb[1])])
    probes = draw_probes(near.geometry, 30, 0)
    own = everywhere_of(sky)
    for memoize in (None, Store()):
        memoizer = Memoizer(near, ("key", "rim"), memoize, far, 3.0, own)
        for i, of in ((1, near), (2, far)):
            lobe = LobeParameters(float(VARIANCE[i]), 0, 0.8, 0.02)
            source = own.added_to(of.source, lobe.variance_mm2, np.zeros)
            want = of.source[1001] + sky[1001] * (FACTOR[i] - 1).astype(np.float32)
            np.testing.assert_allclose(source[1001], want, atol=1e-6)
            assert (source[1001][1] == of.source[1001][1]).all()
            alone = Memoizer(of.with_light(source), ("key", "rim"))
            method = METHODS[name]
            np.testing.assert_array_equal(
                run(memoizer, method, operation, probes, lobe), run(alone, method, operation, probes, lobe)
            )
    assert Memoizer(near, ("key", "rim"), None, None, 3.0, everywhere_of(sky, np.ones((3, 3)))).of_lobe(0.5) is near


def test_a_plan_goes_by_the_light_in_common_and_is_not_taken_for_a_lobes_own():
    """What is remembered of one is not read for the other, and without the term both are one."""
    from skinbake.diffuse.draw_probes import draw_probes

    near, store = lit(), Store()
    sky = {tile: rgb * np.float32(0.5) for tile, rgb in near.source.items()}
    own = Memoizer(near, ("key", "rim"), store, everywhere=everywhere_of(sky))
    plain = Memoizer(near, ("key", "rim"))
    assert plain.in_common() is plain
    probes, lobe = draw_probes(near.geometry, 30, 0), LobeParameters(float(VARIANCE[1]), 0, 0.8, 0.02)
    for operation in ("at_probes", "map"):
        common, its_own, want = (
            run(each, METHODS["surface"], operation, probes, lobe) for each in (own.in_common(), own, plain)
        )
        np.testing.assert_array_equal(common, want)
        assert np.abs(its_own - want).max() > 0.01
    assert len(store.made) == 4


def test_a_plane_under_a_constant_sky_stays_what_it_was():
    """Lobes are their factors brighter, and their sum is the same; half of the light from lamps halves the change."""
    mesh = quad(40.0, 30.0)
    atlas = rasterize(mesh, (40, 32), 2)
    spec = spec_of([SKY], "on").diffusion.model_copy(update={"probes": 50})
    light = {1001: np.ones((2, 32, 40, 3), np.float32)}
    part = {1001: np.stack([light[1001][0], 0.5 * light[1001][1]])}
    made = diffuse(light, ("sky", "half"), atlas, mesh, GAUSSIANS, spec, 0, "float", everywhere=everywhere_of(part))
    covered = atlas[0].covered
    for lobe, factor in zip(made.lobes, FACTOR, strict=True):
        np.testing.assert_allclose(lobe.rgb[1001][0, 16, 20], factor, rtol=1e-5)
        np.testing.assert_allclose(lobe.rgb[1001][1, 16, 20], (1 + factor) / 2, rtol=1e-5)
    from skinbake.diffuse.skin_weights import SkinWeights
    from skinbake.relight.scattering import summed_lobes

    total = summed_lobes(made.lobes, SkinWeights.of(GAUSSIANS, SkinMaps()), 1001, (32, 40))
    np.testing.assert_allclose(
        total[:, covered], np.broadcast_to(WEIGHT.sum(axis=0), total[:, covered].shape), rtol=1e-4
    )
    assert made.error.rms < 1e-3


def test_round_skin_still_sends_back_its_gain():
    """Of light from everywhere lobes sum to the gain, although curvature shares it by the weights of all light."""
    atlas = rasterize(quad(), (16, 12), 2)
    share = curved_share(GAUSSIANS, LAYER.medium, LAYER.eta)
    gain = np.array([[[0.7, 0.8, 0.9], [1.1, 1.2, 1.5]]], np.float32)
    curved = CurvedSkin({}, {1001: gain}, WEIGHT, share, LAYER)
    light = {1001: np.ones((1, 12, 16, 3), np.float32)}
    own = DiffuseProfile(GAUSSIANS, LAYER, atlas, 1, curved).light(light, [0], lambda k: iter(()), np.zeros)
    assert own.gain is curved.gain
    gains = np.linspace(0, MOST_GAIN, STEPS + 1)[:, None]
    seen = own.factor * lobe_factors(WEIGHT, share)
    # Above what the narrow lobe alone sends back; blue has no wide lobe to share it
    inside = (gains[:, 0] > 0.7) & (gains[:, 0] < 3)
    whole = WEIGHT.sum(axis=0)
    total, plain = (
        ((WEIGHT[:, None] * factor).sum(axis=0) / whole)[inside, :2]
        for factor in (seen, FACTOR[:, None] * lobe_factors(WEIGHT, share))
    )
    np.testing.assert_allclose(total, np.repeat(gains[inside], 2, axis=1), rtol=1e-3)
    assert np.abs(plain - gains[inside]).max() > 0.005  # which it would not be


def test_a_lobe_that_a_hollow_leaves_next_to_nothing_of_takes_no_light_for_it():
    """Where form takes all of the wide lobes, what they should have is many times what they have: within bounds."""
    atlas = rasterize(quad(), (16, 12), 2)
    layer = Layer(Medium(np.array([0.015, 0.077, 0.19]), np.array([0.15, 0.21, 0.38])), np.inf, 1.3)  # chicken
    variance = np.array([0.6, 1.7, 4.5, 13.3, 46.0, 198.0])
    weight = np.array([[0, 0, 14], [0, 22, 46], [32, 66, 37], [107, 56, 11], [113, 16, 0], [69, 0, 0]]) / 1000
    gaussians = GaussianSum(variance, weight, np.zeros(3), weight.sum(axis=0), normalise="none")
    share = curved_share(gaussians, layer.medium, layer.eta)
    curved = CurvedSkin({}, {1001: np.full((1, 2, 3), 0.5, np.float32)}, weight, share, layer)
    light = {1001: np.ones((1, 12, 16, 3), np.float32)}
    own = DiffuseProfile(gaussians, layer, atlas, 1, curved).light(light, [0], lambda k: iter(()), np.zeros)
    assert own.factor.max() <= MOST**2
    assert own.factor.min() >= LEAST**2


def test_times_tells_how_often_a_lobe_has_a_light():
    """Of half a light by half of the factor; of a light without any once."""
    rgb = np.ones((3, 4, 6, 3), np.float32)
    part = np.stack([rgb[0], 0.5 * rgb[1], 0 * rgb[2]])
    times = everywhere_of({1001: part}).times({1001: rgb})
    np.testing.assert_allclose(times, np.stack([FACTOR, (1 + FACTOR) / 2, np.ones_like(FACTOR)]), rtol=1e-6)


def test_the_estimate_sees_what_a_blur_of_the_difference_does():
    """A wave across a plane: the kernel at its frequency, of what is lit; even light none."""
    mesh = quad(64.0, 64.0)
    atlas = rasterize(mesh, (64, 64), 0)
    wave = np.ones((2, 64, 64, 3), np.float32)
    s = 2 * np.pi * 8 / 64
    wave[1] += 0.5 * np.sin(s * (np.arange(64) + 0.5))[None, :, None].astype(np.float32)
    even, waved = DiffuseProfile(GAUSSIANS, LAYER, atlas, 2).decide({1001: wave}, ("a", "b"), "auto", [1.0, 1.0])
    assert even.error < 1e-5
    change = np.exp(-0.5 * s**2 * VARIANCE) @ (WEIGHT * (FACTOR - 1)) * 0.5 / np.sqrt(2)
    whole = WEIGHT.sum(axis=0) * np.sqrt(1 + 0.125)
    want = 4.0 * np.sqrt((change**2).sum() / (whole**2).sum())
    assert waved.error == pytest.approx(want, rel=0.15)
    assert not waved.enabled


def test_a_bake_shows_it_and_auto_changes_no_pixel(tmp_path):
    """A relief under a sky and a lamp: measured against the integral of the same light; lights stored summed agree."""
    write_obj(tmp_path / "mesh.obj", relief(60.0, 9.0, segments=12))

    def baked(word, *sets):
        look = spec_of([SKY, sun(0.6)], word, interreflection="on", curvature="on", beam="on", bounces=1)
        values = look.model_dump(mode="json") | {
            "mesh": {"path": str(tmp_path / "mesh.obj"), "unit": "mm", "any_size": True},
            "output": {"dir": "out", "precision": "float", "lights": sets[0] if sets else "separate"},
        }
        return skinbake.bake(SceneSpec.model_validate(values))

    off, auto, on, total = baked("off"), baked("auto"), baked("on"), baked("on", "total")
    for i in range(len(off.variance_mm2)):
        np.testing.assert_array_equal(auto.lobe(i), off.lobe(i))
    kept = {line.term: line.enabled for line in on.plan}
    assert kept[f"sky.{TERM}"]
    assert not {line.term: line.enabled for line in auto.plan}[f"sky.{TERM}"]
    assert on.error.rms < 0.01
    moved = np.linalg.norm(on.radiant_exitance() - off.radiant_exitance()) / np.linalg.norm(off.radiant_exitance())
    assert 1e-5 < moved < 0.01
    apart = np.linalg.norm(on.radiant_exitance() - total.radiant_exitance())
    assert apart < 0.004 * np.linalg.norm(off.radiant_exitance())


def test_the_room_of_a_lobes_light_is_taken_again_unless_it_is_the_lobe():
    """An unblurred lobe is its light itself: the next lobe's must not stand in its place."""
    near = lit()
    sky = {tile: rgb * np.float32(0.5) for tile, rgb in near.source.items()}
    own = Memoizer(near, ("key", "rim"), everywhere=everywhere_of(sky))
    lobes = [LobeParameters(float(variance)) for variance in VARIANCE]
    first = own.of_lobe(VARIANCE[0]).source[1001]
    assert own.of_lobe(VARIANCE[1]).source[1001] is first
    kept = own.map(METHODS["identity"], lobes[1])[1001]
    before = kept.copy()
    assert own.of_lobe(VARIANCE[2]).source[1001] is not kept
    np.testing.assert_array_equal(kept, before)
    want = near.source[1001] + sky[1001] * (FACTOR[1] - 1).astype(np.float32)
    np.testing.assert_allclose(kept, want, atol=1e-6)
