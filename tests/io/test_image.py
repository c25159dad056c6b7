"""Maps are decoded once, by what they are, from every format an artist keeps."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile

from skinbake.atlas import on_charts
from skinbake.bilinear import magnify_bilinear
from skinbake.errors import InputError
from skinbake.io.colour import srgb_to_linear
from skinbake.io.image import read_map, read_radiance
from skinbake.io.map_values import ggx_as_beckmann
from skinbake.io.png import write_png
from skinbake.io.read_maps import inward_normals, missing_tiles, read_maps
from skinbake.scene.map_files import MapsSpec
from tests.images import ACES_AP1, P3_D65, icc_profile, save
from tests.shapes import quad

RNG = np.random.default_rng(7)
EIGHT = RNG.integers(0, 256, (13, 29, 3), dtype=np.uint8)
SIXTEEN = RNG.integers(0, 65536, (13, 29, 3), dtype=np.uint16)
FLOAT = RNG.random((13, 29, 3), dtype=np.float32)


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
    """Grey becomes three equal channels, three that agree their mean, alpha is dropped and not multiplied in."""
    grey = save(tmp_path / "grey.png", EIGHT[..., :1])
    assert read_map(grey, 3, "linear").shape == (13, 29, 3)
    noisy = EIGHT[..., :1].clip(2) + np.array([0, 1, -2], np.int8)  # as JPEG leaves a grey picture
    path = save(tmp_path / "noisy.png", noisy.clip(0, 255).astype(np.uint8))
    np.testing.assert_allclose(read_map(path, 1, "linear"), EIGHT[..., :1] / 255, atol=2 / 255)
    rgba = np.dstack([EIGHT, np.full((13, 29), 0, np.uint8)])
    clear = save(tmp_path / "rgba.png", rgba, channels="RGBA", alpha=3, oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(read_map(clear, 3, "linear"), EIGHT / 255, atol=1e-7)


def test_colours_are_no_single_channel(tmp_path):
    """A packed map is refused where one channel is wanted, by the texel where its channels are furthest apart."""
    packed = np.full((4, 5, 3), [255, 77, 0], np.uint8)
    packed[0] = 77
    path = str(save(tmp_path / "orm.png", packed))
    for name in ("roughness", "specular"):
        with pytest.raises(InputError, match=r"orm\.png: expected one channel, .* got 1, 0\.302, 0 at column 0, row 1"):
            read_maps(MapsSpec.model_validate({name: path}))
    with pytest.raises(InputError, match=r"orm\.png: expected one channel"):
        read_maps(MapsSpec.model_validate({"height": {"path": path, "scale_mm": 1}}))


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ({"channel": "r"}, 1.0),
        ({"channel": "G"}, 77 / 255),
        ({"channel": "b"}, 0.0),
        ({"channel": "a"}, 51 / 255),
        ({"channel": "g", "invert": True}, 1 - 77 / 255),
        ({"channel": "g", "kind": "ggx"}, (77 / 255) ** 2),
        ({"channel": "a", "invert": True, "kind": "ggx"}, 0.8**2),
        ({"channel": "g", "color_space": "srgb"}, float(srgb_to_linear(np.array(77 / 255)))),
    ],
)
def test_one_channel_of_a_packed_map(tmp_path, keys, value):
    """As stored, whatever alpha means elsewhere; inverted; a GGX roughness r as Beckmann's m = r^2."""
    packed = np.full((4, 5, 4), [255, 77, 0, 51], np.uint8)
    path = str(save(tmp_path / "orm.png", packed, channels="RGBA", alpha=3, oiio__UnassociatedAlpha=1))
    maps = read_maps(MapsSpec.model_validate({"roughness": {"path": path, **keys}}))
    np.testing.assert_allclose(maps.roughness[1001], np.full((4, 5), value), atol=1e-6)


def test_ggx_as_beckmann_keeps_the_height_of_the_highlight():
    """D(0) of GGX with alpha = r^2, 1 / (pi alpha^2), is that of Beckmann with the m that comes back."""
    r = np.linspace(0.05, 1, 20, dtype=np.float32)
    np.testing.assert_allclose(1 / (np.pi * ggx_as_beckmann(r) ** 2), 1 / (np.pi * r.astype(float) ** 4), rtol=1e-5)


@pytest.mark.parametrize("key", ["albedo", "normal", "roughness", "specular"])
def test_texels_of_alpha_0_are_filled_from_painted_ones(tmp_path, key):
    """Black ones about a patch of one colour: the patch's colour everywhere, so that no filter finds another."""
    pixels = np.zeros((21, 30, 4), np.uint8)
    pixels[5:12, 9:20] = [128, 128, 230, 255] if key == "normal" else [200, 200, 200, 255]
    path = str(save(tmp_path / "map.png", pixels, channels="RGBA", alpha=3, oiio__UnassociatedAlpha=1))
    image = getattr(read_maps(MapsSpec.model_validate({key: path})), key)[1001]
    np.testing.assert_allclose(image, np.broadcast_to(image[8, 12], image.shape), atol=1e-6)


def test_painted_texels_stay_as_they_are(tmp_path):
    """Beside filled ones, to the last bit; the fill lies within the painted range."""
    alpha = (RNG.random((13, 29, 1)) > 0.4).astype(np.uint8) * 255
    path = save(tmp_path / "a.png", np.dstack([EIGHT, alpha]), channels="RGBA", alpha=3, oiio__UnassociatedAlpha=1)
    found = read_maps(MapsSpec(albedo=str(path))).albedo[1001]
    painted = alpha[..., 0] > 0
    plain = read_map(save(tmp_path / "b.png", EIGHT), 3)
    np.testing.assert_array_equal(found[painted], plain[painted])
    assert found[~painted].min() >= plain[painted].min()
    assert found[~painted].max() <= plain[painted].max() + 1e-6


@pytest.mark.parametrize("key", ["albedo", "normal", "roughness"])
def test_black_beside_the_charts_is_unpainted(tmp_path, key):
    """Without alpha: black off the charts is filled, black on them is paint, and so is any other colour beside them."""
    mesh = quad(uv_box=(0.25, 0.25, 0.75, 0.75))
    pixels = np.zeros((20, 20, 3), np.uint8)
    pixels[5:15, 5:15] = [128, 128, 230] if key == "normal" else 200
    pixels[7, 7] = 0  # on the chart
    pixels[0, 0] = 255  # beside it
    path = str(save(tmp_path / "map.png", pixels))
    spec = MapsSpec.model_validate({key: path})
    filled = getattr(read_maps(spec, charts=lambda tile, shape: on_charts(mesh, tile, shape)), key)[1001]
    alone = getattr(read_maps(spec), key)[1001]
    on = on_charts(mesh, 1001, (20, 20))
    np.testing.assert_array_equal(filled[on], alone[on])
    np.testing.assert_array_equal(filled[0, 0], alone[0, 0])
    np.testing.assert_allclose(filled[4, 5:15], alone[5, 5:15], atol=0.05)
    np.testing.assert_allclose(filled[16:, 12:], np.broadcast_to(alone[10, 10], filled[16:, 12:].shape), atol=0.05)


def test_colours_beyond_rec709_are_brought_to_its_edge(tmp_path):
    """P3's red as albedo: its luminance is within range, no channel leaves it; an AP1 grey of 1.5 is too bright."""
    red = np.full((4, 4, 3), [255, 0, 0], np.uint8)
    path = save(tmp_path / "p3.png", red, ICCProfile=icc_profile(P3_D65))
    np.testing.assert_array_equal(read_maps(MapsSpec(albedo=str(path))).albedo[1001][0, 0], [1, 0, 0])
    bright = save(tmp_path / "ap1.exr", np.full((4, 4, 3), 1.5, np.float32), oiio.FLOAT, chromaticities=ACES_AP1)
    with pytest.raises(InputError, match=r"ap1\.exr: expected values from 0 to 1, got 1\.5"):
        read_maps(MapsSpec(albedo=str(bright)))


def test_a_portable_map_says_no_colour_space(tmp_path):
    """PPM is sRGB as all integers that say nothing, PFM linear as floats; its last row comes first."""
    (tmp_path / "a.ppm").write_bytes(b"P6\n1 1\n255\n" + bytes([128, 64, 32]))
    expected = srgb_to_linear(np.array([128, 64, 32]) / 255)
    np.testing.assert_allclose(read_map(tmp_path / "a.ppm", 3)[0, 0], expected, atol=1e-6)
    rows = np.array([[[0.1, 0.2, 0.3]], [[0.5, 0.25, 0.75]]], "<f4")
    (tmp_path / "a.pfm").write_bytes(b"PF\n1 2\n-1.0\n" + rows.tobytes())
    np.testing.assert_allclose(read_map(tmp_path / "a.pfm", 3), rows[::-1], atol=1e-6)


@pytest.mark.parametrize("green", ["opengl", "directx"])
def test_normals_are_unfolded_and_green_points_up(tmp_path, green):
    """0 ... 1 becomes -1 ... 1; DirectX green is turned."""
    save(tmp_path / "n.png", EIGHT)
    maps = read_maps(MapsSpec(normal={"path": str(tmp_path / "n.png"), "green": green}))
    expected = 2 * (EIGHT / 255) - 1
    if green == "directx":
        expected = expected * [1, -1, 1]
    np.testing.assert_allclose(maps.normal[1001], expected, atol=1e-6)


def directions(count, spread):
    """Unit normals about z, (1, count, 3)."""
    slope = np.random.default_rng(3).normal(0, spread, (1, count, 2))
    return np.concatenate([slope, np.ones((1, count, 1))], axis=2) / np.hypot(1, np.hypot(*slope.T)).T[..., None]


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.5])
@pytest.mark.parametrize("stored", ["signed", "unsigned"])
@pytest.mark.parametrize("encoding", ["auto", None])
def test_floats_say_by_their_lengths_how_they_are_stored(tmp_path, stored, spread, encoding):
    """All of them together, never a single texel: one that rings below 0 changes nothing."""
    exact = directions(500, spread)
    values = exact if stored == "signed" else (exact + 1) / 2
    values = values.astype(np.float32)
    values[0, 7] = -0.02 if stored == "unsigned" else values[0, 7]
    save(tmp_path / "n.exr", values, oiio.FLOAT)
    maps = read_maps(MapsSpec(normal={"path": str(tmp_path / "n.exr"), "encoding": encoding or stored}))
    others = np.arange(500) != 7
    np.testing.assert_allclose(maps.normal[1001][0, others], exact[0, others], atol=1e-6)


@pytest.mark.parametrize("case", ["rg exr", "rg exr signed", "blue 0", "blue 0 exr", "xy exr"])
def test_two_channels_are_normals_whose_z_is_rebuilt(tmp_path, case):
    """(.6, 0, .8), from two channels or from three of which blue is 0."""
    exact = directions(400, 0.4)
    stored = exact[..., :2] if "signed" in case else (exact[..., :2] + 1) / 2
    path, encoding = tmp_path / "n.exr", "signed" if "signed" in case else "unsigned"
    if case == "blue 0":
        path, encoding = (
            save(tmp_path / "n.png", np.rint(255 * np.dstack([stored, 0 * stored[..., :1]])).astype(np.uint8)),
            "auto",
        )
    elif case == "blue 0 exr":
        save(path, np.dstack([stored, 0 * stored[..., :1]]).astype(np.float32), oiio.FLOAT)
    else:
        save(path, stored.astype(np.float32), oiio.FLOAT, "XY" if "xy" in case else "RG")
    maps = read_maps(MapsSpec(normal={"path": str(path), "encoding": encoding}))
    np.testing.assert_allclose(maps.normal[1001], exact, atol=0.012 if case == "blue 0" else 1e-5)
    if encoding == "signed":
        assert read_maps(MapsSpec(normal=str(path))).normal[1001] == pytest.approx(exact, abs=1e-5)
    elif path.suffix == ".exr":
        with pytest.raises(InputError, match="say encoding: unsigned or signed"):
            read_maps(MapsSpec(normal=str(path)))


@pytest.mark.parametrize("kind", [np.int8, np.int16])
def test_integers_with_a_sign_are_normals_as_they_are(tmp_path, kind):
    """A TIFF of them was taken for 0 ... 1, and all its normals were wrong."""
    exact, top = directions(400, 0.4), np.iinfo(kind).max
    tifffile.imwrite(tmp_path / "n.tif", np.rint(top * exact).astype(kind), photometric="rgb")
    np.testing.assert_allclose(read_maps(MapsSpec(normal=str(tmp_path / "n.tif"))).normal[1001], exact, atol=0.51 / top)


def test_two_channels_are_no_normals_in_object_space(tmp_path):
    """On the far side z points the other way."""
    path = save(tmp_path / "n.png", np.full((4, 4, 3), (128, 128, 0), np.uint8))
    spec = MapsSpec.model_validate({"normal": {"path": str(path), "space": "object"}})
    with pytest.raises(InputError, match=r"n\.png: expected normals in three channels with space: object, got two"):
        read_maps(spec)
    with pytest.raises(ValueError, match="expected strength beside space: tangent"):
        MapsSpec.model_validate({"normal": {"path": str(path), "space": "object", "strength": 0.5}})


def test_floats_that_are_no_normals_are_not_guessed(tmp_path):
    """Lengths far from 1 either way; one channel is no normal."""
    save(tmp_path / "n.exr", FLOAT, oiio.FLOAT)
    with pytest.raises(InputError, match="say encoding: unsigned or signed"):
        read_maps(MapsSpec(normal=str(tmp_path / "n.exr")))
    save(tmp_path / "h.png", EIGHT[..., :1])
    with pytest.raises(InputError, match=r"expected normals in two or three channels, got one; maps\.height"):
        read_maps(MapsSpec(normal=str(tmp_path / "h.png")))


def test_heights_and_details(tmp_path):
    """Heights in millimetres, inverted where asked, floats of any range; a detail is read as normals are."""
    save(tmp_path / "h.png", EIGHT[..., :1])
    save(tmp_path / "h.exr", 5 * FLOAT[..., :1] - 2, oiio.FLOAT)
    height = {"path": str(tmp_path / "h.png"), "scale_mm": 0.5, "invert": True}
    detail = {"path": str(save(tmp_path / "d.png", EIGHT)), "repeat": 12, "strength": 0.3, "green": "directx"}
    maps = read_maps(MapsSpec.model_validate({"height": height, "detail": detail}))
    np.testing.assert_allclose(maps.height_mm[1001], 0.5 * (1 - EIGHT[..., 0] / 255), atol=1e-6)
    assert (maps.detail.repeat, maps.detail.strength) == ((12, 12), 0.3)
    np.testing.assert_allclose(maps.detail.normal, (2 * (EIGHT / 255) - 1) * [1, -1, 1], atol=1e-6)
    maps = read_maps(MapsSpec.model_validate({"height": {"path": str(tmp_path / "h.exr"), "scale_mm": 2}}))
    np.testing.assert_allclose(maps.height_mm[1001], 2 * (5 * FLOAT[..., 0] - 2), atol=1e-5)


def test_udim_sets(tmp_path):
    """One file a tile; a tile without a file is left to the constant, no file at all is an error."""
    for tile in (1001, 1003):
        save(tmp_path / f"skin.{tile}.png", np.full((4, 4, 3), tile - 900, np.uint8))
    spec = MapsSpec(albedo=str(tmp_path / "skin.<UDIM>.png"))
    maps = read_maps(spec, (1001, 1002, 1003))
    assert sorted(maps.albedo) == [1001, 1003]
    assert missing_tiles(spec, (1001, 1002, 1003)) == ["maps.albedo: no skin.1002.png: maps.albedo_rgb is used there"]
    assert missing_tiles(spec, (1001, 1003)) == []
    with pytest.raises(InputError, match="no such file for any of the tiles"):
        read_maps(spec, (1011,))
    with pytest.raises(InputError, match=r"expected <UDIM>, .* in the path"):
        read_maps(MapsSpec(albedo=str(tmp_path / "skin.1001.png")), (1001, 1002))


def test_a_cavity_map_is_another_factor_on_the_oil(tmp_path):
    """Times the specular map, at the larger size of both along each axis; alone where there is none."""
    rng = np.random.default_rng(0)
    one, other = rng.integers(0, 256, (6, 4, 1), np.uint8), rng.integers(0, 256, (3, 8, 1), np.uint8)
    for name, pixels in (("s.png", one), ("c.png", other)):
        write_png(tmp_path / name, np.repeat(pixels, 3, axis=2))
    specular, cavity = (str(tmp_path / name) for name in ("s.png", "c.png"))
    both = read_maps(MapsSpec.model_validate({"specular": specular, "cavity": cavity})).specular[1001]
    large = [magnify_bilinear((p / np.float32(255)).astype(np.float32), (6, 8))[..., 0] for p in (one, other)]
    np.testing.assert_allclose(both, large[0] * large[1], atol=1e-6)
    alone = read_maps(MapsSpec.model_validate({"cavity": {"path": cavity, "invert": True}})).specular[1001]
    np.testing.assert_allclose(alone, 1 - other[..., 0] / 255, atol=1e-6)


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


def test_light_of_others_is_read_as_maps_are(tmp_path):
    """Divided by alpha, clear texels filled, ringing clamped, colours converted; brightness as it is."""
    light = np.full((6, 6, 4), [30, 20, 10, 1], np.float32)
    light[2, 2] = [-1e-4, 20, 10, 1]
    light[3, 3] = [15, 10, 5, 0.5]
    light[4, 4] = 0
    found = read_radiance(save(tmp_path / "light.exr", light, oiio.FLOAT, "RGBA", 3))
    expected = np.broadcast_to(np.float32([30, 20, 10]), (6, 6, 3)).copy()
    expected[2, 2, 0] = 0
    np.testing.assert_allclose(np.delete(found.reshape(36, 3), 28, 0), np.delete(expected.reshape(36, 3), 28, 0))
    assert found[4, 4, 2] == pytest.approx(10)
    light[2, 2, 0] = -3
    with pytest.raises(InputError, match="expected values >= 0, got -3 at column 2, row 2"):
        read_radiance(save(tmp_path / "light.exr", light, oiio.FLOAT, "RGBA", 3))


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


def test_normals_that_point_inwards_are_told(tmp_path):
    """They are passed over: another picture, or one in object space; a few slips, black and grey are nothing."""
    image = np.full((40, 40, 3), (128, 128, 255), np.uint8)
    image[:8], image[20:28], image[28:] = (255, 128, 0), 127, 0
    wrong = MapsSpec.model_validate({"normal": str(save(tmp_path / "n.png", image))})
    (told,) = inward_normals(read_maps(wrong))
    assert told.startswith(
        "maps.normal, tile 1001: 20% of its normals point into the skin and are passed over; is it in"
    )
    object_space = MapsSpec.model_validate({"normal": {"path": wrong.normal.path, "space": "object"}})
    assert not inward_normals(read_maps(object_space))
    image[:8] = (128, 128, 255)
    image[0, 0] = (255, 128, 0)
    assert not inward_normals(read_maps(MapsSpec.model_validate({"normal": str(save(tmp_path / "m.png", image))})))
