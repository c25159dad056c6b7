"""What incidence and light from skin to skin make of irradiance, against what they must not and must change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse.light_entering import light_entering
from skinbake.diffuse.terms.beam import ShiftedLights
from skinbake.diffuse.terms.beam_shift import BeamShift
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.irradiance.decide import decide
from skinbake.irradiance.light_skin import light_skin
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import mean_specular_albedo
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.effective_medium import effective_medium
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.incidence import reflect_slanted
from skinbake.profile.skin_medium import SkinMedium, medium_incidence, skin_medium
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.skin import DipoleSkin
from skinbake.scene.spec import SceneSpec
from tests.diffuse.test_interreflection import plates
from tests.shapes import joined, quad, relief

SKIN = {"model": "dipole", "sigma_a_per_mm": [0.032, 0.17, 0.48], "sigma_sp_per_mm": [0.74, 0.88, 1.01], "eta": 1.0}
MEDIUM = skin_medium(DipoleSkin(**SKIN))
INCIDENCE = medium_incidence(MEDIUM)
ALBEDO = (0.8, 0.5, 0.25)
SKY = {"name": "sky", "type": "environment", "radiance": [1, 2, 3]}
OFF = dict.fromkeys(
    ("energy_conservation", "incidence", "beam", "interreflection", "diffuse_profile", "transmission"), "off"
)


def sun(mu: float, name="sun"):
    """Light of 1, 2, 3 at a cosine to +z."""
    direction = [-np.sqrt(1 - mu * mu), 0, -mu]
    return {"name": name, "type": "directional", "direction": direction, "irradiance": [1, 2, 3]}


def entering(mesh, lights, terms, size=(33, 32), medium=MEDIUM, weight=(1.0, 1.0, 1.0), **keys):
    """Light that is blurred, that which arrived, and the raster; `weight` of a lobe, or narrower ones too."""
    spec = SceneSpec.model_validate(
        {
            "mesh": {"path": "m.obj", "unit": "mm"}, "skin": SKIN | keys.pop("skin", {}), "lights": lights,
            "texture": {"size": list(size)}, "terms": OFF | terms, "output": {"dir": "out"} | keys.pop("output", {}),
            **keys,
        }
    )  # fmt: skip
    scene = SceneData(mesh, SkinMaps(albedo_rgb=ALBEDO), {})
    atlas = rasterize(mesh, size, 2)
    decisions = decide(spec)
    arrived = light_skin(spec, decisions, scene, atlas)
    weight = np.array(weight, ndmin=2)
    gaussians = GaussianSum(100.0 ** np.arange(1 - len(weight), 1), weight, np.zeros(3), weight.sum(axis=0))
    skin = EnteredSkin(replace(gaussians, normalise=spec.skin.normalise), medium, INCIDENCE if medium.layers else None)
    return light_entering(spec, decisions, scene, atlas, arrived, skin), arrived[0], atlas[0]


def test_without_terms_it_is_light_times_albedo_to_the_bit():
    """Off, and off for want of a medium."""
    for terms in ({}, {"incidence": "on", "beam": "on"}):
        got, arrived, _ = entering(plates(), [sun(0.6), SKY], terms, medium=SkinMedium(why="nothing is known"))
        assert (got.rgb[1001] == arrived.rgb * np.array(ALBEDO, np.float32)).all()
        assert got.names == ("sun", "sky")
        assert got.beam is None
        assert not any(line.enabled for line in got.plan)
    assert [line.why for line in got.plan[:2]] == ["on: nothing is known"] * 2


def test_white_skin_looks_in_a_constant_sky_as_before():
    """Its profile is that of light from everywhere."""
    got, arrived, _ = entering(quad(), [SKY], {"incidence": "on"})
    np.testing.assert_allclose(got.rgb[1001], arrived.rgb * np.array(ALBEDO, np.float32), rtol=1e-6)
    assert not entering(quad(), [SKY], {"incidence": "auto"})[0].plan[0].enabled


@pytest.mark.parametrize("mu", [1.0, 0.5, 0.125])
@pytest.mark.parametrize("normalise", ["white", "none"])
def test_a_sun_counts_by_its_slant(mu, normalise):
    """R(mu) over R of light from everywhere (white), or over the profile's total, whatever that is."""
    weight = np.array([0.5, 0.25, 0.2])
    got, arrived, raster = entering(
        quad(), [sun(mu)], {"incidence": "on"}, weight=weight, skin={"normalise": normalise}
    )
    place = tuple(np.argwhere(raster.covered)[len(np.argwhere(raster.covered)) // 2])
    ratio = got.rgb[1001][0][place] / (arrived.rgb[0][place] * np.array(ALBEDO))
    want = INCIDENCE.reflectance_rgb[round(mu * 32)] / (INCIDENCE.diffuse_rgb if normalise == "white" else weight)
    np.testing.assert_allclose(ratio, want, rtol=1e-5)
    assert ratio[2] > 1 or mu == 1.0


def test_skin_lights_skin_by_the_form_factor():
    """Two squares a side apart, one lit: the other gets 0.1998 of what leaves it, less what the oil keeps off."""
    mesh, size = plates(), (96, 96)
    light = [sun(-1.0) | {"shadows": False}]  # upwards, on the square that looks down
    for energy in ("off", "on"):
        got, arrived, raster = entering(
            mesh, light, {"interreflection": "on", "energy_conservation": energy}, size,
            skin={"normalise": "none"}, weight=(0.5, 0.25, 0.2),
        )  # fmt: skip
        lower = np.arange(size[0]) < size[0] // 2
        assert not arrived.rgb[0][:, lower].any()
        area = raster.area_mm2[..., None]
        mean = (got.rgb[1001][0] * area)[:, lower].sum(axis=(0, 1)) / area[:, lower].sum()
        sent = (arrived.rgb[0] * area)[:, ~lower].sum(axis=(0, 1)) / area[:, ~lower].sum()
        share = 1 - 0.318 * mean_specular_albedo(0.3, 0.028) if energy == "on" else 1.0
        want = 0.1998 * sent * np.array(ALBEDO) ** 2 * (0.5, 0.25, 0.2) * share
        np.testing.assert_allclose(mean, want, rtol=0.03)
        assert [line.enabled for line in got.plan if line.term == "sun.interreflection"] == [True]


def test_lights_stay_linear():
    """Terms of two lights together are those of each; summed before the blur they are the sum."""
    terms = {"incidence": "on", "beam": "on", "interreflection": "on", "bounces": 2}
    lights = [sun(0.7) | {"shadows": False}, sun(-0.4, "back") | {"shadows": False}]
    both = entering(plates(), lights, terms)[0]
    each = [entering(plates(), [light], terms)[0] for light in lights]
    total = entering(plates(), lights, terms, output={"lights": "total"})[0]
    assert total.names == ("total",)
    for of in ("rgb", "beam"):

        def of_tile(found, of=of):
            return (found.rgb if of == "rgb" else found.beam.rgb)[1001]

        image = of_tile(both)
        np.testing.assert_array_equal(image, np.concatenate([of_tile(one) for one in each]))
        np.testing.assert_allclose(of_tile(total)[0], image.sum(axis=0), rtol=1e-5, atol=1e-6)
    assert not np.array_equal(both.rgb[1001], both.beam.rgb[1001])


def test_a_second_bounce_adds_what_comes_back():
    """The lit square is lit by the other's light."""
    light = [sun(-1.0) | {"shadows": False}]
    one, two = (
        entering(plates(), light, {"interreflection": "on", "bounces": n})[0].rgb[1001][0].sum(axis=(0, 1))
        for n in (1, 2)
    )
    assert (two > one).all()
    assert (two < one * 1.05).all()


def test_a_spectral_skin_has_a_table_too():
    """White light, 41 wavelengths: more comes back at a slant, in every channel."""
    from skinbake.scene.skin import PhysiologySkin

    medium = skin_medium(PhysiologySkin(model="physiology", melanin=0.02))
    assert medium.to_rgb is not None
    assert medium.to_rgb.shape[0] == 3
    few = reflect_slanted(medium.layers, 64)
    rgb = few.reflectance_rgb @ medium.to_rgb.T
    assert (rgb[4] > rgb[-1]).all()


def test_even_light_is_not_moved_and_auto_says_so():
    """A plane in the sun: upstream there is the same light. Skies have no upstream."""
    got, arrived, _ = entering(quad(), [sun(0.4), SKY], {"beam": "on"})
    np.testing.assert_allclose(got.beam.rgb[1001], arrived.rgb * np.array(ALBEDO, np.float32), rtol=1e-5)
    assert [line.enabled for line in got.plan if line.term.endswith(".beam")] == [True, False]
    auto = entering(quad(), [sun(0.4), SKY], {"beam": "auto"})[0]
    assert auto.beam is None
    assert not any(line.enabled for line in auto.plan)


def test_light_left_unmoved_counts_by_its_colour():
    """Where red alone goes far, a red lamp is as wrong as if all did, a blue one not at all, white by what leaves."""

    def lost(colour, weight):
        light = [sun(0.3) | {"irradiance": colour}]
        got = entering(relief(), light, {"beam": "auto"}, weight=weight, diffusion={"tolerance": 1.0})[0]
        return next(line.error for line in got.plan if line.term == "sun.beam")

    all_far, red_far = [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]], [[0.1, 1.0, 1.0], [0.9, 0.0, 0.0]]
    red = lost([1, 0, 0], all_far)
    assert red > 0.01
    assert lost([1, 0, 0], red_far) == pytest.approx(red)
    assert lost([0, 0, 1], red_far) == 0
    assert lost([1, 1, 1], red_far) == pytest.approx(red * ALBEDO[0] / np.linalg.norm(ALBEDO), rel=1e-4)


@pytest.mark.parametrize("lights", [[SKY], [sun(0.4)], [sun(0.4), SKY]], ids=["sky", "sun", "both"])
def test_white_skin_is_curved_for_shifted_beams_alone(lights):
    """A sky has none, nor has an even sun on a plane: then the plan does not say that something was done."""
    for beam, shifted in (("auto", False), ("on", lights != [SKY]), ("off", False)):
        got = entering(quad(), lights, {"beam": beam, "curvature": "on"})[0]
        assert [line.enabled for line in got.plan if line.term == "curvature"] == [shifted]
        assert (got.curved is not None) == (got.beam is not None) == shifted
    assert "has the skin's own form in it" in str(got.plan)


def test_what_a_beam_lights_stands_further_along():
    """Half of a plane lies in the shadow of a sheet: light is found one free path over eta further along it."""
    size, mu = (241, 240), 0.6
    mesh = quad(24.0, 24.0)
    shift = MEDIUM.layers[0].medium.free_path_mm * 0.8
    spec = [sun(mu)]
    got, _, raster = entering(mesh, spec, {"beam": "on"}, size)
    image = np.zeros((*raster.shape, 3), np.float32)
    image[:, : size[0] // 2] = 1
    light = DirectionalLight(**spec[0])
    upstream = BeamShift(
        raster, TexturedSkin(mesh, Occluder(mesh), raster.shape[::-1]), 0, MEDIUM.layers[0].medium.free_path_mm, 1.0
    )
    moved = upstream.read(light, image)
    # The sun of `sun` travels towards -x
    edge_mm = moved[60].sum(axis=0) * 24.0 / size[0]
    np.testing.assert_allclose(edge_mm - image[60].sum(axis=0) * 24.0 / size[0], -shift, atol=0.06)
    rows = np.arange(5, 240, 24)
    np.testing.assert_array_equal(upstream.read(light, image, rows), moved[rows])
    room = np.empty_like(image)
    for found in (
        upstream.looked_at(light, image.astype(np.float16), rows, room),
        upstream.curved(None).looked_at(light, np.zeros_like(image), rows, room),  # known by the light's name
    ):
        np.testing.assert_array_equal(found, [image[rows], moved[rows]])
    bent = upstream.curved(np.full((4, 4, 3), 0.1, np.float32))
    bent_there = bent.read(light, image, rows)
    np.testing.assert_array_equal(bent.looked_at(light, image, rows, room)[1], bent_there)
    assert (bent_there < moved[rows]).any()
    np.testing.assert_array_equal(upstream.looked_at(light, image, rows, room)[1], moved[rows])
    of_index = BeamShift(
        raster, TexturedSkin(mesh, Occluder(mesh), raster.shape[::-1]), 0, MEDIUM.layers[0].medium.free_path_mm, 1.6
    )
    nearer = of_index.read(light, image)[60].sum(axis=0) * 24.0 / size[0]
    np.testing.assert_allclose(nearer - image[60].sum(axis=0) * 24.0 / size[0], -shift / 1.6, atol=0.06)
    assert got.plan[1].term == "sun.beam"
    assert got.beam.narrowest_mm2 == pytest.approx((0.4 * shift.mean() / 0.8) ** 2)


def test_rays_find_what_lies_upstream_in_another_chart():
    """Two charts of one plane: light that depends on the place alone is read across the seam, to a texel."""
    left = quad(20.0, 20.0, uv_box=(0.55, 0.02, 0.98, 0.98))
    right = quad(20.0, 20.0, uv_box=(0.02, 0.02, 0.45, 0.98))
    right = SkinMesh(right.positions_mm + np.array([20.0, 0, 0]), right.faces, right.corner_uv, right.corner_normal)
    mesh, size = joined(left, right), (256, 128)
    (raster,) = rasterize(mesh, size, 2)
    x = interpolate(raster, mesh.corner_position_mm)[..., 0]
    image = np.repeat(x[..., None], 3, axis=2).astype(np.float32)
    upstream = BeamShift(
        raster, TexturedSkin(mesh, Occluder(mesh), raster.shape[::-1]), 0, np.array([3.0, 2.0, 1.0]), 1.0
    )
    moved = upstream.read(DirectionalLight(**sun(0.6)), image)
    inside = raster.covered & (x < x.max() - 3)
    texel_mm = 20.0 / (0.43 * 256)
    for c, shift in enumerate((2.4, 1.6, 0.8)):
        assert np.abs(moved[..., c] - x - shift)[inside].max() < texel_mm
    assert (np.abs(moved - image)[~raster.addressed] == 0).all()


def test_several_layers_have_the_free_path_of_a_medium_that_stands_for_them():
    """Their beams are shifted by it, those of layers that are only named are not; the plan says why."""
    layers = SkinMedium(MEDIUM.layers * 2)
    got = entering(plates(), [sun(0.5)], {"beam": "on"}, medium=layers)[0]
    assert got.plan[1].enabled
    effective = effective_medium(GaussianSum(np.ones(1), np.ones((1, 3)), np.zeros(3), np.ones(3)), np.ones(3), 1.0)
    assert got.beam.narrowest_mm2 == pytest.approx((0.4 * effective.free_path_mm.mean()) ** 2)
    got = entering(plates(), [sun(0.5)], {"beam": "on"}, medium=replace(layers, named=True))[0]
    assert got.beam is None
    assert "several layers that are only named" in got.plan[1].why


def test_a_medium_that_is_only_named_gives_its_slant_and_not_its_total():
    """Light along the normal stays what the profile says, though its total is another than the medium's."""
    weight = np.array([1.0, 0.5, 0.2])
    named = replace(MEDIUM, named=True)
    got, arrived, _ = entering(
        quad(), [sun(1.0)], {"incidence": "on"}, weight=weight, medium=named, skin={"normalise": "none"}
    )
    np.testing.assert_allclose(got.rgb[1001], arrived.rgb * np.array(ALBEDO, np.float32), rtol=1e-5)


def test_no_lamp_has_more_shifted_light_in_all_than_arrived():
    """Over two tiles together: what one tile finds too much of another may lack, lamp by lamp."""
    (raster,) = rasterize(quad(10.0), (16, 16), 1)
    where = (raster.area_mm2 > 0)[..., None]
    tiles = [replace(raster, tile=tile) for tile in (1001, 1002)]
    shifted, moved = ShiftedLights(), {each.tile: np.zeros((2, 16, 16, 3), np.float32) for each in tiles}
    for tile, times in zip(tiles, (1.5, 0.5), strict=True):
        arrived = np.full((16, 16, 3), 2, np.float32)
        shifted.add(tile, 0, "level", arrived, arrived * np.float32(times))
        shifted.add(tile, 1, "more", arrived, arrived * np.array([times, 1.25, 0.5], np.float32))
    shifted.add_to(moved)
    for tile, times in zip(tiles, (1.5, 0.5), strict=True):
        found = moved[tile.tile][:, where[..., 0]]
        np.testing.assert_allclose(found[0], 2 * times, rtol=1e-6)
        np.testing.assert_allclose(found[1], np.broadcast_to([2 * times, 2.0, 1.0], found[1].shape), rtol=1e-6)
