"""Light that comes later is drawn as it is computed, and the oil mirrors the sky where it is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.irradiance.oil_albedo import specular_albedo
from skinbake.preview.camera import Camera
from skinbake.preview.controls import Controls, overlay, press
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode
from skinbake.preview.relit import LaterLight, relit_scene, sky_samples
from skinbake.preview.relit_controls import RelitControls, press_relit
from skinbake.relight.basis import LightBasis, harmonic_basis
from skinbake.relight.grey_lights import summed
from skinbake.relight.relit import light_coefficients
from skinbake.relight.skies import made_sky, sky_names
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec, TexturingSpec
from tests.oil_brdf import kelemen_brdf
from tests.shapes import quad

STUDIO = made_sky("studio")
SUN = ((0.3, -0.6, -1.0), (2.0, 3.0, 4.0))
HALF = 2e-3  # textures of half floats
PIXEL = 0.01  # what a table of the oil's albedo, and the middle of a pixel, are off
Z = np.array([0.0, 0.0, 1.0])


def test_coefficients_are_those_of_the_core():
    """A sky and a sun, turned, have the coefficients that `relight` uses; a whole turn changes no bit."""
    basis, light = harmonic_basis(3), LaterLight(STUDIO, (SUN,), 40.0)
    np.testing.assert_allclose(light.coefficients(basis), light_coefficients(basis, STUDIO, 40.0, [SUN]))
    assert (light.turned(360.0).coefficients(basis) == light.coefficients(basis)).all()


def test_a_raised_sun_stands_higher():
    """By so many degrees, and no further than upright."""
    light = LaterLight(None, (((0.0, 0.0, -1.0), (1, 1, 1)),))
    (direction, _), = light.turned(0.0, 30.0).placed_suns  # fmt: skip
    np.testing.assert_allclose(direction, [0, -0.5, -np.sqrt(0.75)], atol=1e-12)
    (direction, _), = light.turned(0.0, 300.0).placed_suns  # fmt: skip
    assert direction[1] == pytest.approx(-np.sin(np.radians(89)))


def test_directions_of_a_sky_hold_all_of_its_light():
    """Parts fill the sphere; what they send is what the sky sends; no more than asked for are bright."""
    for name in sky_names():
        few, many = (LaterLight(made_sky(name)).mirrored_sky(count) for count in (32, 4096))
        flux = [(each[:, 0, 3:] * each[:, 1, :3]).sum(axis=0) for each in (few, many)]
        np.testing.assert_allclose(flux[0], flux[1], rtol=0.1)
        assert len(few) == 32
        bright = few[:, 1, 3] == 1
        assert bright.sum() == 16
        assert few[~bright, 0, 3].sum() == pytest.approx(4 * np.pi, rel=1e-5)
    assert not LaterLight(np.ones((8, 16, 3), np.float32)).mirrored_sky(32)[:, 1, 3].any()


def mirrored(sky, normal, view, roughness):
    """What oil of strength 1 mirrors of directions, as the shader sums them."""
    towards, part = sky[:, 0, :3].astype(float), sky[:, 0, 3].astype(float)
    width = np.sqrt(roughness**2 + part / (8 * np.pi))
    cosine = np.maximum(towards @ normal, 0)
    weight = part * cosine * kelemen_brdf(normal, towards, view, width, 0.028, 1.0)
    whole, bright = float(specular_albedo(normal @ view, roughness, 0.028)), sky[:, 1, 3] == 1
    sums = [(weight[chosen, None] * sky[chosen, 1, :3]).sum(axis=0) for chosen in (~bright, bright)]
    return whole * (sums[0] / weight[~bright].sum() + sums[1] / max(weight[bright].sum(), whole))


def test_no_direction_burns_out_at_the_rim():
    """An even sky is mirrored as its integral at any angle, by any number of directions; none is more than the sky."""
    even, studio = LaterLight(np.ones((32, 64, 3), np.float32)), LaterLight(STUDIO)
    for degrees in (0.0, 60.0, 80.0, 86.0, 89.0):
        view = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
        whole = float(specular_albedo(np.cos(np.radians(degrees)), 0.3, 0.028))
        np.testing.assert_allclose(mirrored(even.mirrored_sky(32), Z, view, 0.3), whole, rtol=1e-4)
        few, many = (mirrored(studio.turned(50.0).mirrored_sky(count), Z, view, 0.3) for count in (32, 4096))
        assert few.max() < whole * STUDIO.max()
        np.testing.assert_allclose(few, many, rtol=0.5, atol=0.2)  # the sky: up to 6.7


def test_keys_turn_the_light_and_go_through_skies():
    """K takes the next sky, the comma and the point turn, R goes back."""
    start = RelitControls(LaterLight(STUDIO, (SUN,), 10.0), "studio", {n: lambda n=n: made_sky(n) for n in sky_names()})
    after = press_relit(start, start, "K")
    assert after.sky == "sunset"
    assert after.light.suns == (SUN,)
    assert press_relit(after, start, ".").light.rotate_deg == 15.0
    assert press_relit(after, start, "K").sky == "studio"
    assert press_relit(after, start, "R") is start
    assert press_relit(after, start, "A") is after
    assert start.line == "sky studio and 1 sun, turned 10 degrees"


@pytest.fixture(scope="module")
def drawn():
    """Draws a quad that faces the camera, its four textures each of one colour."""
    colours = np.array([[0.9, 0.6, 0.5], [0.1, -0.2, 0.3], [0.2, 0.1, -0.1], [0.5, 0.4, 0.3]], np.float16)
    textures = {1001: np.broadcast_to(colours[:, None, None], (4, 5, 7, 3)).copy()}
    camera = Camera(np.zeros(3), 3000.0, 0.0, 0.0, 1.0)

    def draw(light, mode, seen=3.544908, degrees=0.0, basis=None, fold=False):  # Y_0 times that is 1: all is open
        open_sky = np.zeros((3, 4, 4, 3), np.float16)
        open_sky[0, ..., 0] = seen
        scene = relit_scene(
            basis or harmonic_basis(1), quad(), textures, {1001: open_sky}, SkinMaps(), TexturingSpec(),
            SpecularSpec(roughness=0.3), False,
        )  # fmt: skip
        seen_from = replace(camera, azimuth_deg=degrees)
        with OffscreenRenderer(scene) as renderer:
            renderer._renderer.fold = fold
            return renderer.draw(seen_from, (9, 9), Mode(mode), supersample=1, later=light).rgba[4, 4, :3]

    draw.colours = colours.astype(np.float64)
    return draw


@pytest.mark.slow  # OpenGL
def test_diffuse_is_the_sum_of_the_textures(drawn):
    """Radiance is the sum of textures times coefficients, over pi; black light is black; below 0 is 0."""
    light = LaterLight(STUDIO, (SUN,), 30.0)
    exact = np.maximum((drawn.colours * light.coefficients(harmonic_basis(1))).sum(axis=0), 0) / np.pi
    np.testing.assert_allclose(drawn(light, "diffuse"), exact, rtol=HALF)
    assert not drawn(LaterLight(), "full").any()
    assert not drawn(LaterLight(0 * STUDIO), "full").any()


@pytest.mark.slow  # OpenGL
@pytest.mark.parametrize("fold", [False, True], ids=["", "summed"])
def test_grey_lights_are_drawn_as_they_are_summed(drawn, fold):
    """Two textures in colour and two of three lights each, summed in every frame or once."""
    matrix = np.random.default_rng(7).standard_normal((8, 9)) + np.eye(8, 9)
    matrix[:, 0] += 2
    basis, light = LightBasis("fitted", matrix, np.zeros((9, 0)), 6), LaterLight(STUDIO, (SUN,), 30.0)
    textures = np.broadcast_to(drawn.colours[:, None, None], (4, 1, 1, 3))
    exact = np.maximum(summed(textures, basis, light.coefficients(basis))[0, 0], 0) / np.pi
    assert exact.min() > 0.1
    np.testing.assert_allclose(drawn(light, "diffuse", basis=basis, fold=fold), exact, rtol=2 * HALF)


@pytest.mark.slow  # OpenGL
def test_the_oil_mirrors_the_sky(drawn):
    """A sun is mirrored as Kelemen and Szirmay-Kalos say, an even sky by its integral; what is shut mirrors nothing."""
    to_sun = np.array([0.0, 0.6, 0.8])
    sun = LaterLight(None, ((-to_sun, (2.0, 3.0, 4.0)),))
    exact = kelemen_brdf(Z, to_sun, Z, 0.3, 0.028, 0.318) * 0.8 * np.array([2.0, 3.0, 4.0])
    np.testing.assert_allclose(drawn(sun, "specular"), exact, rtol=1e-3)
    assert not drawn(sun, "specular", seen=0.0).any()
    for sky in (np.ones((32, 64, 3), np.float32), STUDIO):
        for degrees in (0.0, 70.0, 85.0):
            light = LaterLight(sky, (), 30.0)
            view = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
            exact = 0.318 * mirrored(light.mirrored_sky(sky_samples("llvmpipe")), Z, view, 0.3)
            np.testing.assert_allclose(drawn(light, "specular", degrees=degrees), exact, rtol=PIXEL)


def test_software_gets_fewer_directions():
    """By the renderer's name."""
    assert sky_samples("llvmpipe (LLVM 15.0.6, 256 bits)") < sky_samples("NVIDIA GeForce")


def test_the_window_s_text_is_that_of_its_light():
    """The light's line in place of lights that a bake has, and keys that mean something here."""
    scene = relit_scene(
        harmonic_basis(0), quad(), {1001: np.ones((1, 4, 4, 3), np.float16)}, {1001: np.ones((3, 2, 2, 3), np.float16)},
        SkinMaps(), TexturingSpec(), SpecularSpec(), False,
    )  # fmt: skip
    relit = RelitControls(LaterLight(STUDIO), "studio", {})
    controls = Controls(scene.lights, (np.ones(3),), help=True)
    for key in ("N", "1", "TAB", "UP", "L"):
        assert press(controls, controls, scene, key) is controls
    lines = overlay(controls, scene, 30.0, relit)
    assert lines[1] == "sky studio, turned 0 degrees"
    text = "\n".join(lines)
    assert "next sky" in text
    assert "next light" not in text
    assert "basis-0" not in text
