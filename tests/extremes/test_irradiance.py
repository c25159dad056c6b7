"""Light is linear, never negative, and the same from any side: turned, moved, in another unit, texture turned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.atlas import interpolate, rasterize
from skinbake.irradiance import light_texels
from skinbake.scene.lights import DirectionalLight, PointLight, RectangleLight
from skinbake.scene.maps import SkinMaps
from tests.extremes.moves import moved, relative, rotation, uv_turned
from tests.shapes import relief

SIZE = (47, 40)


def lights(turn=None, shift=0.0, scale=1.0, gain=1.0):
    """Sun, lamp and window over a bump, seen from another side."""
    turn = np.eye(3) if turn is None else turn

    def place(*point):
        return tuple(turn @ np.array(point, float) * scale + shift)

    def along(*direction):
        return tuple(turn @ np.array(direction, float))

    u, v = (tuple(turn @ np.array(edge, float) * scale) for edge in ((0, 30, 0), (30, 0, 0)))
    return [
        DirectionalLight(
            name="sun", type="directional", direction=along(-0.6, 0.3, -0.7), irradiance=(gain, 0.5 * gain, 0)
        ),
        PointLight(name="lamp", type="point", position_mm=place(50, 10, 40), intensity=(2000 * scale**2 * gain,) * 3),
        RectangleLight(
            name="window", type="rectangle", position_mm=place(0, -20, 70), edge_u_mm=u, edge_v_mm=v,
            radiance=(gain,) * 3, samples=16,
        ),
    ]  # fmt: skip


def lit(mesh, chosen, size=SIZE):
    atlas = rasterize(mesh, size, gutter=1)
    return light_texels(atlas, mesh, SkinMaps(), chosen)[0].rgb


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 99), shift=st.sampled_from([0.0, 300.0]), scale=st.sampled_from([0.1, 1.0, 10.0]))
def test_motion_and_unit(seed, shift, scale):
    """Head and lights moved together: all but a few texels at shadow edges the same, to float32."""
    turn = rotation(seed)
    here = lit(relief(), lights())
    there = lit(moved(relief(), turn, np.full(3, shift), scale), lights(turn, shift, scale))
    for name, a, b in zip(("sun", "lamp", "window"), here, there, strict=True):
        off = np.abs(a - b) > 2e-3 * a.max()
        assert off.mean() < 0.01, name
        assert abs(float(a.sum(dtype=np.float64) / b.sum(dtype=np.float64)) - 1) < 1e-3, name


def test_a_quarter_turn_of_the_texture():
    """Irradiance turns as an image does, but for texels at shadow edges."""
    here, there = lit(relief(), lights()), lit(uv_turned(relief()), lights(), SIZE[::-1])
    for a, b in zip(here, there, strict=True):
        assert (np.abs(np.rot90(a) - b) > 2e-3 * a.max()).mean() < 0.01


# Not below 1e-6: light times a cosine is to stay where float32 has all its digits (from 1e-38 on)
CHANNEL = st.just(0.0) | st.floats(1e-6, 1)


@settings(max_examples=5, deadline=None)
@given(exponent=st.floats(-25, 25), colour=st.tuples(CHANNEL, CHANNEL, CHANNEL))
def test_linear_and_positive(exponent, colour):
    """k times the light is k times the irradiance, from 1e-25 to 1e25, to float32; never below zero."""
    gain = 10.0**exponent
    one = lights()[:2]
    one = [
        light.model_copy(update={k: colour for k in ("irradiance", "intensity") if hasattr(light, k)}) for light in one
    ]
    many = [
        light.model_copy(
            update={k: tuple(gain * c for c in colour) for k in ("irradiance", "intensity") if hasattr(light, k)}
        )
        for light in one
    ]
    a, b = lit(relief(), one), lit(relief(), many)
    assert (b >= 0).all()
    assert np.isfinite(b).all()
    np.testing.assert_allclose(b, a.astype(np.float64) * gain, rtol=3e-6, atol=1e-37)


@pytest.mark.parametrize("distance", [1e-2, 1.0, 1e4, 1e8])
def test_a_lamp_at_any_distance_in_float32(distance):
    """A point light from a hundredth of a millimetre to a hundred kilometres: float64's I cos / d^2, to 1e-5."""
    mesh = relief(height_mm=0.0)
    lamp = PointLight(
        name="l", type="point", position_mm=(0.3, 0.2, distance), intensity=(distance**2,) * 3, shadows=False
    )
    raster = rasterize(mesh, SIZE, gutter=1)[0]
    got = light_texels((raster,), mesh, SkinMaps(), [lamp])[0].rgb[0, ..., 0]
    to_light = np.array(lamp.position_mm) - interpolate(raster, mesh.corner_position_mm).astype(np.float64)
    d2 = (to_light**2).sum(axis=-1)
    wanted = distance**2 * to_light[..., 2] / d2**1.5
    assert relative(got, wanted) < (1e-5 if distance >= 1 else 1e-3)
