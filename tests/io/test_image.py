"""Maps are decoded once, by what they are, from every format an artist keeps."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.errors import InputError
from skinbake.io.image import read_environments, read_map, read_maps, srgb_to_linear
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.spec import MapsSpec


def save(path, pixels, kind=oiio.UINT8, **attributes):
    pixels = np.asarray(pixels)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(np.ascontiguousarray(pixels))
    out.close()
    return path


RNG = np.random.default_rng(7)
EIGHT = RNG.integers(0, 256, (13, 29, 3), dtype=np.uint8)
SIXTEEN = RNG.integers(0, 65536, (13, 29, 3), dtype=np.uint16)
FLOAT = RNG.random((13, 29, 3), dtype=np.float32)


def test_srgb_matches_its_definition():
    """The curve's two branches meet, 0 and 1 stay, 0.5 is 0.21404 (IEC 61966-2-1)."""
    np.testing.assert_allclose(srgb_to_linear(np.array([0, 0.5, 1.0])), [0, 0.21404114, 1], atol=1e-7)
    low, high = srgb_to_linear(np.array([0.04045 - 1e-9, 0.04045 + 1e-9]))
    assert abs(low - high) < 1e-6


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize(("pixels", "kind"), [(EIGHT, oiio.UINT8), (SIXTEEN, oiio.UINT16)])
def test_integers_are_srgb_as_colours_and_raw_as_data(tmp_path, suffix, pixels, kind):
    """8 and 16 bit PNG and TIFF: exact sRGB decoding for colours, exact fractions for data."""
    path = save(tmp_path / f"map.{suffix}", pixels, kind)
    fraction = pixels / np.iinfo(pixels.dtype).max
    np.testing.assert_allclose(read_map(path, 3), srgb_to_linear(fraction), atol=2e-7)
    np.testing.assert_allclose(read_map(path, 3, "linear"), fraction, atol=1e-7)
    np.testing.assert_allclose(read_map(path, 3, "linear", "srgb"), srgb_to_linear(fraction), atol=2e-7)
    np.testing.assert_allclose(read_map(path, 3, "auto", "linear"), fraction, atol=1e-7)


def test_floats_are_linear(tmp_path):
    """EXR comes back as it was, as colour and as data."""
    path = save(tmp_path / "map.exr", FLOAT, oiio.FLOAT)
    np.testing.assert_array_equal(read_map(path, 3), FLOAT)
    np.testing.assert_array_equal(read_map(path, 3, "linear"), FLOAT)


def test_jpeg_and_tx(tmp_path):
    """JPEG within its own loss; a tiled, mip-mapped .tx gives its largest level."""
    smooth = np.broadcast_to(np.linspace(20, 230, 64)[None, :, None], (32, 64, 3)).astype(np.uint8)
    path = save(tmp_path / "map.jpg", smooth)
    np.testing.assert_allclose(read_map(path, 3, "linear"), smooth / 255, atol=0.02)
    config = oiio.ImageSpec()
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, str(path), str(tmp_path / "map.tx"), config)
    np.testing.assert_allclose(read_map(tmp_path / "map.tx", 3, "linear"), read_map(path, 3, "linear"), atol=1e-6)


def test_channels(tmp_path):
    """Grey becomes three equal channels, three average to one, alpha is dropped and not multiplied in."""
    grey = save(tmp_path / "grey.png", EIGHT[..., :1])
    assert read_map(grey, 3, "linear").shape == (13, 29, 3)
    colour = save(tmp_path / "colour.png", EIGHT)
    np.testing.assert_allclose(read_map(colour, 1, "linear")[..., 0], (EIGHT / 255).mean(axis=2), atol=1e-6)
    rgba = np.dstack([EIGHT, np.full((13, 29), 0, np.uint8)])
    clear = save(tmp_path / "rgba.png", rgba, oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(read_map(clear, 3, "linear"), EIGHT / 255, atol=1e-7)


@pytest.mark.parametrize("green", ["opengl", "directx"])
def test_normals_are_unfolded_and_green_points_up(tmp_path, green):
    """0 ... 1 becomes -1 ... 1; DirectX green is turned."""
    save(tmp_path / "n.png", EIGHT)
    maps = read_maps(MapsSpec(normal={"path": str(tmp_path / "n.png"), "green": green}))
    expected = 2 * (EIGHT / 255) - 1
    if green == "directx":
        expected = expected * [1, -1, 1]
    np.testing.assert_allclose(maps.normal[1001], expected, atol=1e-6)


def test_signed_normals_are_taken_as_they_are(tmp_path):
    """A float map with negative values is a normal already."""
    save(tmp_path / "n.exr", 2 * FLOAT - 1, oiio.FLOAT)
    maps = read_maps(MapsSpec(normal={"path": str(tmp_path / "n.exr")}))
    np.testing.assert_allclose(maps.normal[1001], 2 * FLOAT - 1)


def test_udim_sets(tmp_path):
    """One file a tile; a tile without a file is left to the constant, no file at all is an error."""
    for tile in (1001, 1003):
        save(tmp_path / f"skin.{tile}.png", np.full((4, 4, 3), tile - 900, np.uint8))
    spec = MapsSpec(albedo=str(tmp_path / "skin.<UDIM>.png"))
    maps = read_maps(spec, (1001, 1002, 1003))
    assert sorted(maps.albedo) == [1001, 1003]
    with pytest.raises(InputError, match="no such file for any of the tiles"):
        read_maps(spec, (1011,))
    with pytest.raises(InputError, match="expected <UDIM> in the path"):
        read_maps(MapsSpec(albedo=str(tmp_path / "skin.1001.png")), (1001, 1002))


def test_roughness_and_specular_are_flat(tmp_path):
    """Scalar maps have shape (h, w)."""
    save(tmp_path / "r.png", EIGHT[..., :1])
    path = str(tmp_path / "r.png")
    maps = read_maps(MapsSpec(roughness=path, specular=path))
    assert maps.roughness[1001].shape == (13, 29)
    np.testing.assert_allclose(maps.specular[1001], EIGHT[..., 0] / 255, atol=1e-7)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_non_finite_texel_is_named(tmp_path, bad):
    """NaN or Inf: the message says which file and which texel."""
    pixels = FLOAT.copy()
    pixels[5, 17, 1] = bad
    path = save(tmp_path / "map.exr", pixels, oiio.FLOAT)
    with pytest.raises(InputError, match=r"map\.exr.*NaN or Inf in 1 texels, the first at column 17, row 5"):
        read_map(path, 3)


def test_values_out_of_range_are_named_and_ringing_is_not(tmp_path):
    """An albedo of 1.7 makes light and is refused; 1.02 is a filter's overshoot and clamped."""
    pixels = FLOAT.copy()
    pixels[2, 3, 0] = 1.02
    save(tmp_path / "a.exr", pixels, oiio.FLOAT)
    assert read_maps(MapsSpec(albedo=str(tmp_path / "a.exr"))).albedo[1001].max() == 1
    pixels[2, 3, 0] = 1.7
    save(tmp_path / "a.exr", pixels, oiio.FLOAT)
    with pytest.raises(InputError, match=r"values from 0 to 1, got 1\.7 at column 3, row 2"):
        read_maps(MapsSpec(albedo=str(tmp_path / "a.exr")))


def test_an_environment_keeps_its_range(tmp_path):
    """Radiance above 1 is kept, below 0 refused."""
    sky = FLOAT * 5000
    save(tmp_path / "sky.exr", sky, oiio.FLOAT)
    light = EnvironmentLight(name="sky", type="environment", path=str(tmp_path / "sky.exr"))
    constant = EnvironmentLight(name="flat", type="environment", radiance=(1, 1, 1))
    found = read_environments([light, constant])
    assert list(found) == ["sky"]
    np.testing.assert_array_equal(found["sky"], sky)
    save(tmp_path / "sky.exr", sky - 100, oiio.FLOAT)
    with pytest.raises(InputError, match="values >= 0"):
        read_environments([light])


@pytest.mark.parametrize("case", ["missing", "folder", "text", "cut png", "cut exr", "empty", "window"])
def test_an_unreadable_image_is_refused(tmp_path, case):
    """Each ends as one line with the file's name."""
    path = tmp_path / ("map.exr" if case in ("text", "cut exr", "window") else "map.png")
    if case == "folder":
        path.mkdir()
    elif case == "text":
        path.write_text("this is no EXR")
    elif case == "empty":
        path.write_bytes(b"")
    elif case == "window":
        spec = oiio.ImageSpec(29, 13, 3, oiio.FLOAT)
        spec.full_width = 40
        out = oiio.ImageOutput.create(str(path))
        out.open(str(path), spec)
        out.write_image(FLOAT)
        out.close()
    elif case.startswith("cut"):
        big = RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)
        save(
            path,
            big if path.suffix == ".png" else (big / 255).astype(np.float32),
            oiio.UINT8 if path.suffix == ".png" else oiio.FLOAT,
        )
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"map\.(png|exr): ") as failure:
        read_map(path, 3)
    assert "\n" not in str(failure.value)
