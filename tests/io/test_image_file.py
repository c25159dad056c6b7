"""What lies in an image file: layers, channels, alpha, size; everything that is not there is said."""

from __future__ import annotations

import struct

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from PIL import Image

from skinbake.errors import InputError
from skinbake.io.exr import Part, write_parts
from skinbake.io.image import read_opacity
from skinbake.io.image_file import read_header, read_stored
from tests.images import flat_png, icc_profile, save, ultra_hdr

RNG = np.random.default_rng(7)
FLOAT = RNG.random((5, 7, 8), dtype=np.float32) + 0.1
ALPHA = np.array([0, 0.25, 0.5, 1, 1, 0.75, 2], np.float32)[None, :, None].repeat(5, axis=0)
NAMES = ("R", "G", "B", "A", "spec.R", "spec.G", "spec.B", "Z")


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_associated_alpha_is_divided_out(tmp_path, suffix):
    """.3 / .5 is .6; where alpha is 0 or 1 nothing changes."""
    colours = np.concatenate([FLOAT[..., :3] * ALPHA, ALPHA], axis=2)
    found = read_stored(save(tmp_path / f"map.{suffix}", colours, oiio.FLOAT, "RGBA", 3))
    np.testing.assert_allclose(found.pixels[:, 1:], FLOAT[:, 1:, :3], rtol=1e-6)
    np.testing.assert_array_equal(found.pixels[:, 0], 0)
    np.testing.assert_array_equal(found.alpha, ALPHA[..., 0])


def test_eight_bit_associated_alpha(tmp_path):
    """TIFF's ExtraSamples 1: divided as stored, to half a level over alpha."""
    pixels = np.array([[[100, 50, 25, 128], [255, 255, 255, 255]]], np.uint8)
    found = read_stored(save(tmp_path / "map.tif", pixels, oiio.UINT8, "RGBA", 3))
    np.testing.assert_array_equal(found.pixels, [[[199, 100, 50], [255, 255, 255]]])


@pytest.mark.parametrize("suffix", ["png", "tif", "tga"])
def test_unassociated_alpha_is_left_alone(tmp_path, suffix):
    """PNG always, TIFF and TGA where they say so."""
    pixels = np.array([[[100, 50, 25, 128], [9, 8, 7, 0]]], np.uint8)
    path = save(tmp_path / f"map.{suffix}", pixels, oiio.UINT8, "RGBA", 3, oiio__UnassociatedAlpha=1)
    found = read_stored(path)
    np.testing.assert_array_equal(found.pixels, pixels[..., :3])
    np.testing.assert_allclose(found.alpha, [[128 / 255, 0]], atol=1e-6)


@pytest.mark.parametrize("suffix", ["bmp", "dds", "jp2"])
def test_alpha_that_nothing_is_said_of_is_left_alone(tmp_path, suffix):
    """Kinds of files that hold plain colours beside alpha, of which OpenImageIO does not say it."""
    pixels = np.tile(np.array([100, 50, 25, 128], np.uint8), (8, 8, 1))
    Image.fromarray(pixels).save(tmp_path / f"map.{suffix}")
    found = read_stored(tmp_path / f"map.{suffix}")
    np.testing.assert_array_equal(found.pixels, pixels[..., :3])
    np.testing.assert_allclose(found.alpha, 128 / 255, atol=1e-6)


def test_a_fourth_byte_without_a_meaning_is_no_alpha(tmp_path):
    """0 throughout in BMP and TGA; of a TGA that says so: it was divided out of the colours, and hair was not there."""
    pixels = np.tile(np.array([100, 50, 25, 0], np.uint8), (8, 8, 1))
    for name in ("map.bmp", "map.tga"):
        Image.fromarray(pixels).save(tmp_path / name)
        found = read_stored(tmp_path / name)
        np.testing.assert_array_equal(found.pixels, pixels[..., :3])
        assert found.alpha is None
        assert read_opacity(tmp_path / name)[0, 0] == pytest.approx(np.mean([100, 50, 25]) / 255)
    pixels[..., 3] = 128
    for kind, means in ((0, False), (1, False), (2, False), (3, True)):
        head = struct.pack("<3B9x2H2B", 0, 0, 2, 8, 8, 32, 0x28) + pixels[..., [2, 1, 0, 3]].tobytes()
        extension = struct.pack("<H492xB", 495, kind) + struct.pack("<II", len(head), 0)
        (tmp_path / "map.tga").write_bytes(head + extension + b"TRUEVISION-XFILE.\0")
        found = read_stored(tmp_path / "map.tga")
        np.testing.assert_array_equal(found.pixels, pixels[..., :3])
        assert (found.alpha is not None) == means


def test_identifiers_are_no_values(tmp_path):
    """Whole numbers of an EXR are no shares of the largest one; beside colours they do no harm."""
    rows = np.full((4, 4), 7, np.uint32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": rows}).write(str(tmp_path / "id.exr"))
    with pytest.raises(InputError, match=r"id\.exr: expected half or float values, got whole numbers \(UINT\)"):
        read_stored(tmp_path / "id.exr")
    colours = {name: np.full((4, 4), 0.25, np.float32) for name in "RGB"}
    OpenEXR.File(header, colours | {"id": rows}).write(str(tmp_path / "both.exr"))
    np.testing.assert_array_equal(read_stored(tmp_path / "both.exr").pixels, np.full((4, 4, 3), 0.25))


def test_coverage_in_our_own_files_is_no_alpha(tmp_path):
    """Their colours are not multiplied by it."""
    planes = {c: FLOAT[..., i] for i, c in enumerate("RGBA")}
    write_parts(tmp_path / "ours.exr", [Part("irradiance", planes)], {"skinbake:version": "0"}, "float")
    np.testing.assert_array_equal(read_stored(tmp_path / "ours.exr").pixels, FLOAT[..., :3])


def test_channels_by_name(tmp_path):
    """Each of r, g, b, a as it is stored, alpha not divided out of it; grey is its own red."""
    path = save(tmp_path / "packed.exr", FLOAT[..., :4], oiio.FLOAT, "RGBA", 3)
    for i, channel in enumerate("rgba"):
        found = read_stored(path, channel=channel)
        np.testing.assert_array_equal(found.pixels[..., 0], FLOAT[..., i])
        assert found.alpha is None
    grey = save(tmp_path / "grey.png", np.full((3, 4, 1), 7, np.uint8))
    assert read_stored(grey, channel="r").pixels[0, 0] == [7]
    with pytest.raises(InputError, match=r"grey\.png: expected a channel G, the file has Y"):
        read_stored(grey, channel="g")


def test_channels_of_any_order_and_vectors(tmp_path):
    """An EXR's channels have names, not places; X, Y, Z are vectors, R and G two of them."""
    shuffled = save(tmp_path / "a.exr", FLOAT[..., :3], oiio.FLOAT, ("G", "B", "R"))
    np.testing.assert_array_equal(read_stored(shuffled).pixels, FLOAT[..., [2, 0, 1]])
    vectors = save(tmp_path / "n.exr", FLOAT[..., :3], oiio.FLOAT, ("X", "Y", "Z"))
    np.testing.assert_array_equal(read_stored(vectors).pixels, FLOAT[..., :3])
    two = save(tmp_path / "rg.exr", FLOAT[..., :2], oiio.FLOAT, ("R", "G"))
    assert read_stored(two).pixels.shape == (5, 7, 2)


def test_layers_of_one_part(tmp_path):
    """By the names before the dot, the end of them is enough; without a name, the plain channels."""
    path = save(tmp_path / "layers.exr", FLOAT, oiio.FLOAT, NAMES, 3)
    np.testing.assert_array_equal(read_stored(path, layer="spec").pixels, FLOAT[..., 4:7])
    assert read_stored(path).alpha is not None
    blender = save(tmp_path / "b.exr", FLOAT[..., :3], oiio.FLOAT, [f"View.Combined.{c}" for c in "RGB"])
    for layer in ("Combined", "View.Combined", None):
        np.testing.assert_array_equal(read_stored(blender, layer).pixels, FLOAT[..., :3])
    with pytest.raises(InputError, match=r"expected a layer 'diffuse', the file has spec"):
        read_stored(path, layer="diffuse")


def test_layers_of_several_parts(tmp_path):
    """By the name of the part."""
    parts = [
        Part("depth", {"Z": FLOAT[..., 0]}),
        Part("beauty", {c: FLOAT[..., i] for i, c in enumerate("RGB")}),
    ]
    write_parts(tmp_path / "parts.exr", parts, precision="float")
    np.testing.assert_array_equal(read_stored(tmp_path / "parts.exr", layer="beauty").pixels, FLOAT[..., :3])
    with pytest.raises(InputError, match=r"the file has depth\.Z, beauty\.R, beauty\.G, beauty\.B; `layer:` chooses"):
        read_stored(tmp_path / "parts.exr")


@pytest.mark.parametrize("in_parts", [True, False])
def test_one_layer_of_several_is_not_guessed(tmp_path, in_parts):
    """Of two pictures in one file the first was taken, without a word; the end of a name must be one layer's."""
    names, path = ("a.light", "b.light"), tmp_path / "two.exr"
    if in_parts:
        write_parts(path, [Part(name, {c: FLOAT[..., i] for i, c in enumerate("RGB")}) for name in names], {}, "float")
    else:
        save(path, FLOAT[..., :6], oiio.FLOAT, [f"{name}.{c}" for name in names for c in "RGB"])
    with pytest.raises(
        InputError, match=r"expected one layer of R, G, B, the file has a\.light\.R, .*`layer:` chooses"
    ):
        read_stored(path)
    with pytest.raises(InputError, match=r"whole name of a layer 'light', the file has a\.light, b\.light"):
        read_stored(path, layer="light")
    wanted = FLOAT[..., :3] if in_parts else FLOAT[..., 3:6]
    np.testing.assert_array_equal(read_stored(path, layer="b.light").pixels, wanted)


def test_the_whole_name_of_a_layer_or_channel_goes_before_a_likeness(tmp_path):
    layers = save(
        tmp_path / "l.exr", FLOAT[..., :6], oiio.FLOAT, [f"{n}.{c}" for n in ("a.spec", "spec") for c in "RGB"]
    )
    np.testing.assert_array_equal(read_stored(layers, layer="spec").pixels, FLOAT[..., 3:6])
    channels = save(tmp_path / "c.exr", FLOAT[..., :6], oiio.FLOAT, "RGBrgb")
    np.testing.assert_array_equal(read_stored(channels).pixels, FLOAT[..., :3])


def test_a_file_without_colours_lists_what_it_has(tmp_path):
    """Two odd channels."""
    path = save(tmp_path / "odd.exr", FLOAT[..., :2], oiio.FLOAT, ("U", "V"))
    with pytest.raises(InputError, match=r"expected channels R, G, B, or a single one, the file has U, V"):
        read_stored(path)


def test_an_ultra_hdr_photograph_is_its_standard_picture(tmp_path):
    """Not the light of its gain map, two stops brighter; its profile is kept."""
    path = ultra_hdr(tmp_path / "phone.jpg", 128, profile=icc_profile())
    with_gain = oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[0, 0, 0]
    assert with_gain == pytest.approx(4 * 0.2159, rel=0.02)
    found = read_stored(path)
    np.testing.assert_allclose(found.pixels, 128, atol=1)
    assert found.pixels.dtype == np.uint8
    assert bytes(found.attributes["ICCProfile"]) == icc_profile()


def test_the_header_is_enough_for_the_size(tmp_path):
    """A picture larger than any that can be used is refused in no time."""
    header = read_header(flat_png(tmp_path / "map.png", 3000, 2000))
    assert (header.width, header.height, header.channels) == (3000, 2000, ("Y",))
    assert header.decoded_bytes(1) == 3000 * 2000 * 5
    with pytest.raises(InputError, match=r"big\.png: expected an image of at most 32768 x 32768, got 40000 x 10"):
        read_header(flat_png(tmp_path / "big.png", 40000, 10))
