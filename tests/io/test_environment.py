"""Skies keep their range, and are refused where they are no lat-long maps."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.errors import InputError
from skinbake.io.environment import read_environments, read_sky
from skinbake.scene.lights import EnvironmentLight
from tests.images import ACES_AP1, radiance_file, save, ultra_hdr

SKY = np.random.default_rng(7).random((16, 32, 3), dtype=np.float32) * 5000


def read(path, **more):
    light = EnvironmentLight(name="sky", type="environment", path=str(path), **more)
    constant = EnvironmentLight(name="flat", type="environment", radiance=(1, 1, 1))
    found = read_environments([light, constant])
    assert list(found) == ["sky"]
    return found["sky"]


def test_an_environment_keeps_its_range(tmp_path):
    """Radiance above 1 is kept, in EXR to the bit and in .hdr to its own precision; below 0 it is refused."""
    np.testing.assert_array_equal(read(save(tmp_path / "sky.exr", SKY, oiio.FLOAT)), SKY)
    found = read(radiance_file(tmp_path / "sky.hdr", SKY, "-Y 16 +X 32"))
    np.testing.assert_allclose(found, SKY, atol=SKY.max() / 128)
    with pytest.raises(InputError, match="values >= 0"):
        read(save(tmp_path / "sky.exr", SKY - 1000, oiio.FLOAT))


def test_what_rings_about_a_sun_is_clamped(tmp_path):
    """Resampling leaves a twentieth of the sun below 0 at most: it becomes 0."""
    sky = SKY.copy()
    sky[3, 4] = -40
    assert read(save(tmp_path / "sky.exr", sky, oiio.FLOAT)).min() == 0


def test_infinite_suns_are_clamped_where_asked(tmp_path):
    """Half floats end at 65504: Inf is refused with the key that helps, and clamped by it; NaN stays refused."""
    sky = SKY.copy()
    sky[3, 4, 1] = np.inf
    path = save(tmp_path / "sky.exr", sky, oiio.HALF)
    with pytest.raises(
        InputError, match=r"NaN or Inf in 1 texels, the first at column 4, row 3, channel G; `clamp:` of the light"
    ):
        read(path)
    with pytest.raises(InputError, match=r"NaN or Inf in 1 texels, .*; limit what is infinite in the file"):
        read_sky(path)  # of `preview --environment`: no look has it
    for most in (65504.0, 2000.0, 1e6):
        found = read(path, clamp=most)
        np.testing.assert_allclose(found[3, 4, 1], min(most, 65504))
        np.testing.assert_allclose(found[5:], np.minimum(SKY[5:], most), rtol=1e-3)
    sky[3, 4, 1] = np.nan
    with pytest.raises(InputError, match="NaN or Inf"):
        read(save(tmp_path / "sky.exr", sky, oiio.FLOAT), clamp=10.0)


def test_colours_are_converted(tmp_path):
    """AP1 by the file's chromaticities, or by the light's own color_space: a grey sky stays grey."""
    grey = np.full((16, 32, 3), 7.0, np.float32)
    np.testing.assert_allclose(read(save(tmp_path / "a.exr", grey, oiio.FLOAT, chromaticities=ACES_AP1)), 7, rtol=1e-4)
    red = np.full((16, 32, 3), [7.0, 1.0, 1.0], np.float32)
    plain = save(tmp_path / "b.exr", red, oiio.FLOAT)
    said = read(plain, color_space="acescg")
    in_file = read(save(tmp_path / "c.exr", red, oiio.FLOAT, chromaticities=ACES_AP1))
    np.testing.assert_allclose(said, in_file, rtol=2e-3)
    assert said[0, 0, 0] > 10


def test_alpha_of_a_sky_is_left_alone(tmp_path):
    """What arrives is what is stored."""
    rgba = np.dstack([SKY, np.full(SKY.shape[:2], 0.5, np.float32)])
    np.testing.assert_array_equal(read(save(tmp_path / "sky.exr", rgba, oiio.FLOAT, "RGBA", 3)), SKY)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((24, 32), "got 32 x 24, as a cross of six cube faces is"),
        ((32, 24), "got 24 x 32, as a cross of six cube faces is"),
        ((8, 48), "as a row of six cube faces is"),
        ((48, 8), "as a column of six cube faces is"),
        ((32, 32), "as a mirror ball, an angular map or a single cube face is"),
        ((20, 32), "got 32 x 20; convert it to a lat-long map"),
    ],
)
def test_other_layouts_are_told_apart(tmp_path, shape, said):
    """Twice as wide as high is asked for; what it looks like is said."""
    path = save(tmp_path / "sky.exr", np.ones((*shape, 3), np.float32), oiio.FLOAT)
    with pytest.raises(
        InputError, match=r"sky\.exr: expected an equirectangular map, twice as wide as high"
    ) as failure:
        read(path)
    assert said in str(failure.value)


def test_a_cube_map_of_a_renderer_is_refused_by_its_header(tmp_path):
    """`textureformat` says so, though 2:1."""
    path = save(tmp_path / "sky.exr", SKY, oiio.FLOAT, textureformat="CubeFace Environment")
    with pytest.raises(InputError, match="got a cube map"):
        read(path)


def test_an_ultra_hdr_photograph_is_no_sky(tmp_path):
    """Its light is in a gain map."""
    with pytest.raises(InputError, match="Ultra HDR"):
        read(ultra_hdr(tmp_path / "sky.jpg", 128, size=(64, 32)))
