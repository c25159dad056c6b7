"""Every key of a map reads every kind of file that pictures come in: one known value, and what is read of it."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.io.colour import srgb_to_linear
from skinbake.io.read_maps import read_maps
from skinbake.scene.map_files import MapsSpec
from tests.images import save

# Suffix, type, and by how much the kind itself may miss a value: half a level and round-off, or half a bit
KINDS = {
    "png 8 bit": ("png", oiio.UINT8, 0.51 / 255),
    "png 16 bit": ("png", oiio.UINT16, 0.51 / 65535),
    "tiff 8 bit": ("tif", oiio.UINT8, 0.51 / 255),
    "tiff 16 bit": ("tif", oiio.UINT16, 0.51 / 65535),
    "tiff float": ("tif", oiio.FLOAT, 1e-7),
    "jpeg": ("jpg", oiio.UINT8, 2 / 255),
    "tga": ("tga", oiio.UINT8, 0.51 / 255),
    "bmp": ("bmp", oiio.UINT8, 0.51 / 255),
    "exr half": ("exr", oiio.HALF, 2.5e-4),
    "exr float": ("exr", oiio.FLOAT, 1e-7),
    "tx 8 bit": ("tx", oiio.UINT8, 0.51 / 255),
    "tx half": ("tx", oiio.HALF, 2.5e-4),
}
COLOUR = np.array([0.6, 0.3, 0.1])
DIRECTION = np.array([0.6, 0.0, 0.8])  # as 0 ... 1: 0.8 0.5 0.9


def written(folder, kind, values):
    """A picture of one colour in this kind of file, and whether it holds integers."""
    suffix, of, _ = KINDS[kind]
    whole = of in (oiio.UINT8, oiio.UINT16)
    pixels = np.broadcast_to(values, (32, 48, 3))
    if whole:
        top = {oiio.UINT8: 255, oiio.UINT16: 65535}[of]
        pixels = np.rint(pixels * top).astype({255: np.uint8, 65535: np.uint16}[top])
    else:
        pixels = pixels.astype(np.float32)
    if suffix != "tx":
        return save(folder / f"map.{suffix}", pixels, of), whole
    plain = save(folder / ("plain.tif" if whole else "plain.exr"), pixels, of)
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, str(plain), str(folder / "map.tx"), oiio.ImageSpec())
    return folder / "map.tx", whole


def read(key, path, **keys):
    """What `maps.KEY` is at a texel."""
    maps = read_maps(MapsSpec.model_validate({key: {"path": str(path), **keys}}))
    if key == "detail":
        return maps.detail.normal[9, 9]
    return getattr(maps, "height_mm" if key == "height" else key)[1001][9, 9]


@pytest.mark.parametrize("kind", KINDS)
def test_colours(tmp_path, kind):
    """`albedo`: integers are sRGB, floats linear; `color_space: linear` and `invert` say otherwise."""
    path, whole = written(tmp_path, kind, COLOUR)
    off = KINDS[kind][2] * (2.3 if whole else 1)  # sRGB's curve is steeper than 1
    np.testing.assert_allclose(read("albedo", path), srgb_to_linear(COLOUR) if whole else COLOUR, atol=off)
    np.testing.assert_allclose(read("albedo", path, color_space="linear"), COLOUR, atol=off)
    np.testing.assert_allclose(read("albedo", path, color_space="linear", invert=True), 1 - COLOUR, atol=off)


@pytest.mark.parametrize("kind", KINDS)
def test_single_channels(tmp_path, kind):
    """`roughness`, `specular` and `height` take the channel that is asked for as it is stored."""
    path, _ = written(tmp_path, kind, COLOUR)
    off = KINDS[kind][2]
    for channel, value in zip("rgb", COLOUR, strict=True):
        assert read("roughness", path, channel=channel) == pytest.approx(value, abs=off)
        assert read("roughness", path, channel=channel, kind="ggx") == pytest.approx(value**2, abs=2 * off)
        assert read("specular", path, channel=channel, invert=True) == pytest.approx(1 - value, abs=off)
        assert read("height", path, channel=channel, scale_mm=-2.0) == pytest.approx(-2 * value, abs=2 * off)


@pytest.mark.parametrize("kind", KINDS)
def test_directions(tmp_path, kind):
    """`normal` and `detail` hold 0 ... 1 for -1 ... 1, in floats where they say so; DirectX's green is turned."""
    path, _ = written(tmp_path, kind, DIRECTION / 2 + 0.5)
    for key, more in (("normal", {}), ("detail", {"repeat": 4})):
        found = read(key, path, encoding="unsigned", **more)
        np.testing.assert_allclose(found, DIRECTION, atol=2.1 * KINDS[kind][2])
        turned = read(key, path, encoding="unsigned", green="directx", **more)
        np.testing.assert_allclose(turned, found * [1, -1, 1], atol=1e-7)
