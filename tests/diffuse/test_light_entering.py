"""What incidence and light from skin to skin make of irradiance, against what they must not and must change."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.light_entering import light_entering
from skinbake.irradiance.decide import decide
from skinbake.irradiance.light_skin import light_skin
from skinbake.irradiance.oil_albedo import mean_specular_albedo
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.incidence import reflect_slanted
from skinbake.profile.skin_medium import medium_incidence, skin_medium
from skinbake.scene.maps import SkinMaps
from skinbake.scene.skin import DipoleSkin
from skinbake.scene.spec import SceneSpec
from tests.diffuse.test_interreflection import plates
from tests.shapes import quad

SKIN = {"model": "dipole", "sigma_a_per_mm": [0.032, 0.17, 0.48], "sigma_sp_per_mm": [0.74, 0.88, 1.01], "eta": 1.0}
INCIDENCE = medium_incidence(skin_medium(DipoleSkin(**SKIN)))
ALBEDO = (0.8, 0.5, 0.25)
SKY = {"name": "sky", "type": "environment", "radiance": [1, 2, 3]}
OFF = {"energy_conservation": "off", "incidence": "off", "interreflection": "off", "transmission": "off"}


def sun(mu: float, name="sun"):
    """Light of 1, 2, 3 at a cosine to +z."""
    direction = [-np.sqrt(1 - mu * mu), 0, -mu]
    return {"name": name, "type": "directional", "direction": direction, "irradiance": [1, 2, 3]}


def entering(mesh, lights, terms, size=(33, 32), incidence=INCIDENCE, weight=(1.0, 1.0, 1.0), **keys):
    """Light that is blurred, that which arrived, and the raster."""
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
    gaussians = GaussianSum(np.ones(1), np.array([weight]), np.zeros(3), np.array(weight))
    return light_entering(spec, decisions, scene, atlas, arrived, gaussians, incidence), arrived[0], atlas[0]


def test_without_terms_it_is_light_times_albedo_to_the_bit():
    """Off, and off for want of a medium."""
    for terms in ({}, {"incidence": "on"}):
        got, arrived, _ = entering(plates(), [sun(0.6), SKY], terms, incidence="nothing is known")
        assert (got.rgb[1001] == arrived.rgb * np.array(ALBEDO, np.float32)).all()
        assert got.names == ("sun", "sky")
        assert not any(line.enabled for line in got.plan)
    assert "on: nothing is known" in got.plan[0].why


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
        assert got.plan[-1].term == "sun.interreflection"
        assert got.plan[-1].enabled


def test_lights_stay_linear():
    """Terms of two lights together are those of each; summed before the blur they are the sum."""
    terms = {"incidence": "on", "interreflection": "on", "bounces": 2}
    lights = [sun(0.7) | {"shadows": False}, sun(-0.4, "back") | {"shadows": False}]
    both = entering(plates(), lights, terms)[0].rgb[1001]
    each = [entering(plates(), [light], terms)[0].rgb[1001][0] for light in lights]
    np.testing.assert_array_equal(both, np.stack(each))
    total = entering(plates(), lights, terms, output={"lights": "total"})[0]
    assert total.names == ("total",)
    np.testing.assert_allclose(total.rgb[1001][0], both.sum(axis=0), rtol=1e-5, atol=1e-6)


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
