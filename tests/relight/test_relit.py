"""Light that comes later, against closed forms and against bakes of the same light."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.irradiance.environment_map import direction_of

QUADRATURE = 4e-3  # of 1024 directions, and of coordinates of the cube's facets
SAME_SUM = 1e-5  # float32 sums in another order
BASED = 0.02  # what order 3 misses of a sky of order 2, with shadows, at 48 texels


def gradient(axis, slope, rows=32):
    """Radiance 1 + slope cos(angle to an axis), an equirectangular map."""
    u, v = np.meshgrid((np.arange(2 * rows) + 0.5) / (2 * rows), 1 - (np.arange(rows) + 0.5) / rows)
    return np.repeat(1 + slope * (direction_of(u, v) @ axis)[..., None], 3, axis=2).astype(np.float32)


def lit_texels(baked):
    """Texels of the first tile that show skin."""
    return baked.relight(np.ones((4, 8, 3)))[..., 0] > 0


def test_even_light_on_a_ball_is_pi(baked):
    """Radiance 2 from everywhere is irradiance 2 pi on a ball, of which the albedo leaves."""
    ball = baked("mesh.path=" + str(baked.folder / "ball.obj"))
    found = ball.relight(np.full((16, 32, 3), 2.0))
    skin = found[..., 0] > 0
    assert skin.mean() > 0.5
    np.testing.assert_allclose(
        found[skin], np.broadcast_to(2 * np.pi * np.array([0.8, 0.5, 0.4]), found[skin].shape), rtol=QUADRATURE
    )


def test_black_is_black(baked):
    """No light, a black sky and a black sun leave nothing at all."""
    face = baked()
    assert not face.relight().any()
    assert not face.relight(np.zeros((4, 8, 3)), suns=[((0, 0, -1), (0, 0, 0))]).any()


def test_light_adds_up(baked):
    """M under a sky and a sun is the sum of M under each, wherever none is below 0."""
    face, sky, sun = baked(), gradient((0, 1, 0), 0.5), ((0.3, -0.2, -1), (1.0, 2.0, 3.0))
    alone = face.relight(sky), face.relight(suns=[sun])
    both = face.relight(sky, suns=[sun])
    lit = (alone[1] > 0).all(axis=2)
    assert lit.mean() > 0.3
    np.testing.assert_allclose(both[lit], (alone[0] + alone[1])[lit], rtol=SAME_SUM, atol=SAME_SUM)


def test_a_whole_turn_gives_the_same_bytes(baked):
    """360 degrees are none; 90 are others, and those of the turned picture."""
    face, sky = baked(), gradient((1, 0, 0), 0.8)
    assert face.relight(sky, 360).tobytes() == face.relight(sky).tobytes()
    np.testing.assert_allclose(face.relight(sky, 90), face.relight(np.roll(sky, -16, axis=1)), rtol=1e-3)
    assert abs(face.relight(sky, 90) - face.relight(sky)).max() > 0.05
    sun, turned = ((0.6, -0.3, -0.7), (1, 2, 3)), ((-0.7, -0.3, -0.6), (1, 2, 3))
    np.testing.assert_allclose(face.relight(rotate_deg=90, suns=[sun]), face.relight(suns=[turned]), atol=1e-4)


def test_a_sky_is_as_it_is_baked(baked):
    """A gradient through 16 harmonics is that which the pipeline bakes, shadows, incidence and the oil among it."""
    import skinbake
    from skinbake.io.exr import Part, rgb_channels, write_parts

    sky = gradient((0.6, 0.64, 0.48), 0.7)
    write_parts(baked.folder / "sky.exr", [Part("", rgb_channels(sky))], precision="float")
    more = ["specular.strength=0.318", "terms.energy_conservation=on", "skin.medium={preset: jensen-skin1}",
            "terms.incidence=on"]  # fmt: skip
    light = f"lights=[{{name: sky, type: environment, path: {baked.folder}/sky.exr, rotate_deg: 70}}]"
    direct = skinbake.bake(skinbake.load_look(baked.folder / "look.yaml", [*more, light, "relight=null"]))
    found, exact = baked(*more).relight(sky, 70), direct.radiant_exitance()
    skin = lit_texels(baked())
    error = np.linalg.norm(found[skin] - exact[skin]) / np.linalg.norm(exact[skin])
    assert error < BASED


def test_albedo_after_scattering_is_multiplied(baked):
    """Post-scatter texturing gives what pre-scatter gives, where the albedo is the same everywhere."""
    sky = gradient((0, 0, 1), 0.9)
    before, after = (baked(f"texturing.mode={mode}").relight(sky) for mode in ("pre-scatter", "post-scatter"))
    np.testing.assert_allclose(after, before, rtol=1e-4, atol=1e-5)


def test_a_bake_without_it_says_so(baked):
    """What the look does not ask for is refused by name; so is a sun that is none."""
    plain = baked("relight=null", "lights=[{name: sky, type: environment, radiance: [1, 1, 1]}]")
    with pytest.raises(InputError, match="relight: expected a look with relight"):
        plain.relight()
    with pytest.raises(InputError, match="suns: expected"):
        baked().relight(suns=[((0, 0, 0), (1, 1, 1))])
    with pytest.raises(InputError, match="no lights of its own"):
        baked().irradiance("key")
    with pytest.raises(InputError, match="no lights of its own"):
        baked().radiant_exitance()


@pytest.mark.parametrize("suns", [None, 3, [None], [5], ["ab"], [((0, 0, 1), "red")], [((0, 0, 1),)],
                                  [((0, 0), (1, 1, 1))], [((0, 0, np.nan), (1, 1, 1))], [((0, 0, 1), (1, 1, -1))],
                                  [((0, 0, 0), (1, 1, 1))], ((0, 0, 1), (1, 1, 1))])  # fmt: skip
def test_suns_that_are_none_are_refused(baked, suns):
    """Whatever is given in place of pairs of three numbers gets one sentence."""
    with pytest.raises(InputError, match=r"^suns: expected a"):
        baked().relight(suns=suns)


def test_values_that_are_no_light_are_refused(baked):
    """Turns that are no number, gains and radiance that are none or below 0."""
    for turn in (np.nan, np.inf, "40", None, [1, 2]):
        with pytest.raises(InputError, match="rotate_deg: expected a finite number"):
            baked().relight(np.ones((4, 8, 3)), turn)
    for sky in (-np.ones((4, 8, 3)), np.full((4, 8, 3), np.nan), np.ones((4, 8)), [["a"]], [[1], [1, 2]]):
        with pytest.raises(InputError, match="environment: expected finite radiance"):
            baked().relight(sky)
    plain = baked("relight=null", "lights=[{name: sky, type: environment, radiance: [1, 1, 1]}]")
    for gain in (np.nan, -1, np.inf, "much", (1, 2), None, (1, 1, np.nan)):
        with pytest.raises(InputError, match="gains: sky: expected a number from 0 up"):
            plain.radiant_exitance({"sky": gain})
    np.testing.assert_allclose(plain.radiant_exitance({"sky": (2, 2, 2)}), 2 * plain.radiant_exitance(), rtol=1e-6)


def test_tiles_have_their_own_textures(baked):
    """On two UDIM tiles an even sky gives pi on both, and light through everything is counted: bounces, thin parts."""
    changes = ["mesh.path=" + str(baked.folder / "tiles.obj"), "texture.udim=true", "texture.size=[40, 48]"]
    ball = baked(*changes, "terms.transmission=on", "terms.interreflection=on", "relight.textures=4")
    assert ball.tiles == (1001, 1002)
    for tile in ball.tiles:
        found = ball.relight(np.ones((16, 32, 3)), tile=tile)[..., 0]
        assert (found > 0).mean() > 0.4
        np.testing.assert_allclose(found[found > 0], np.pi * 0.8, rtol=5 * QUADRATURE)
