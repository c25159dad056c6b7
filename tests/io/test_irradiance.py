"""Irradiance comes back as it was written, and from files of others as maps do."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.errors import InputError
from skinbake.io.exr import Part, write_parts
from skinbake.io.irradiance import read_irradiance
from tests.images import save

LIGHT = np.random.default_rng(2).random((4, 6, 3), dtype=np.float32) + 1


def test_a_texel_a_hair_below_zero_is_clamped(tmp_path):
    """What resampling leaves, -1e-4, becomes 0, in a plain file and in a part of ours; -3 is refused by its place."""
    light = LIGHT.copy()
    light[2, 5, 1] = -1e-4
    plain = save(tmp_path / "plain.exr", light, oiio.FLOAT)
    planes = {c: light[..., i] for i, c in enumerate("RGB")}
    write_parts(tmp_path / "parts.exr", [Part("irradiance", planes), Part("light.key", planes)], precision="float")
    light[2, 5, 1] = 0
    for path, name in ((plain, "total"), (tmp_path / "parts.exr", "key")):
        found = read_irradiance(path, 1001, (6, 4))
        assert found.lights == (name,)
        np.testing.assert_array_equal(found.rgb[0], light)
    light[2, 5, 1] = -3
    with pytest.raises(InputError, match=r"plain\.exr: expected values >= 0, got -3 at column 5, row 2"):
        read_irradiance(save(plain, light, oiio.FLOAT), 1001)


def test_halves_stay_halves_and_are_judged_alike(tmp_path):
    """As a bake stores them: nothing is rounded, and half of the memory does."""
    light = LIGHT.astype(np.float16)
    light[0, 0] = -0.0
    planes = {c: light[..., i] for i, c in enumerate("RGB")}
    parts = [Part("irradiance", planes), Part("light.key", planes | {"visibility": light[..., 0]})]
    write_parts(tmp_path / "ours.exr", parts)
    found = read_irradiance(tmp_path / "ours.exr", 1001)
    np.testing.assert_array_equal(found.rgb[0], light)
    light[0, 0] = 0
    write_parts(tmp_path / "ours.exr", parts)
    found = read_irradiance(tmp_path / "ours.exr", 1001)
    assert found.rgb.dtype == found.visibility.dtype == np.float16
    np.testing.assert_array_equal(found.rgb[0], light)
    light[3, 2, 0] = -1
    write_parts(tmp_path / "ours.exr", parts)
    with pytest.raises(InputError, match=r"part light\.key, channel R: expected finite .*, got .* at column 2, row 3"):
        read_irradiance(tmp_path / "ours.exr", 1001)


def test_a_cropped_file_is_refused_as_a_map_is(tmp_path):
    """Its data window is not its display window: nobody says what lies between."""
    spec = oiio.ImageSpec(6, 4, 3, oiio.FLOAT)
    spec.full_width = 9
    out = oiio.ImageOutput.create(str(tmp_path / "crop.exr"))
    assert out.open(str(tmp_path / "crop.exr"), spec)
    out.write_image(LIGHT)
    out.close()
    with pytest.raises(InputError, match=r"crop\.exr: expected a data window equal to the display window"):
        read_irradiance(tmp_path / "crop.exr", 1001)


def test_the_size_is_that_of_the_texture(tmp_path):
    """Said with both."""
    with pytest.raises(InputError, match=r"expected texture\.size 8 x 8, got 6 x 4"):
        read_irradiance(save(tmp_path / "plain.exr", LIGHT, oiio.FLOAT), 1001, (8, 8))
