"""Pictures whose files say otherwise than the library reads them: refused by name, read where it reads them right."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from skinbake.errors import InputError
from skinbake.io.image_file import read_stored

GREY = np.arange(48).reshape(6, 8) * 5
RGB = np.stack([GREY, GREY[::-1], 255 - GREY], axis=2).astype(np.uint8)


@pytest.mark.parametrize(
    ("pixels", "photometric", "page", "said"),
    [
        ((65535 - GREY * 257).astype(np.uint16), "miniswhite", 0, "grey of more than 8 bits whose white is 0"),
        ((1 - GREY / 255).astype(np.float32), "miniswhite", 0, "grey of more than 8 bits whose white is 0"),
        (RGB, "cielab", 0, "CIELAB"),
        (GREY.astype(np.uint16), "cfa", 0, "a camera's raw mosaic"),
        (RGB, "linear_raw", 0, "a camera's raw colours"),
        (RGB, "rgb", 1, "a thumbnail before the picture"),
    ],
)
def test_a_tiff_in_other_colours_is_refused_by_name(tmp_path, pixels, photometric, page, said):
    """They came out inverted, in wrong colours or small, without a word."""
    path = tmp_path / "map.tif"
    tifffile.imwrite(path, pixels, photometric=photometric, subfiletype=page)
    with pytest.raises(InputError, match=f"map.tif: expected a plain picture, got {said}; save it as RGB"):
        read_stored(path)


@pytest.mark.parametrize(
    ("pixels", "photometric", "wanted"),
    [
        ((255 - GREY).astype(np.uint8), "miniswhite", GREY[..., None]),
        ((GREY * 257).astype(np.uint16), "minisblack", GREY[..., None] * 257),
        (RGB, "rgb", RGB),
    ],
)
def test_a_tiff_that_is_read_right_is_read(tmp_path, pixels, photometric, wanted):
    """White may be 0 where a value has 8 bits: the library turns that round itself."""
    tifffile.imwrite(tmp_path / "map.tif", pixels, photometric=photometric)
    np.testing.assert_array_equal(read_stored(tmp_path / "map.tif").pixels, wanted)


def bmp(path, pixels, masks):
    """A BMP of 32 bits, top row first, with masks of red, green and blue."""
    head = struct.pack("<IiiHHIIiiII", 40, pixels.shape[1], -pixels.shape[0], 1, 32, 3, pixels.nbytes, 0, 0, 0, 0)
    begin = 14 + len(head) + 12
    file = b"BM" + struct.pack("<IHHI", begin + pixels.nbytes, 0, 0, begin)
    path.write_bytes(file + head + struct.pack("<3I", *masks) + pixels.tobytes())
    return path


def test_a_bmp_of_32_bits_keeps_the_usual_order(tmp_path):
    """GIMP's have red last in memory: the library takes blue for green, and green for red."""
    blank = np.full((*GREY.shape, 1), 255, np.uint8)
    usual = bmp(tmp_path / "usual.bmp", np.dstack([RGB[..., ::-1], blank]), (0xFF0000, 0xFF00, 0xFF))
    np.testing.assert_array_equal(read_stored(usual).pixels, RGB)
    gimp = bmp(tmp_path / "gimp.bmp", np.dstack([blank, RGB[..., ::-1]]), (0xFF000000, 0xFF0000, 0xFF00))
    with pytest.raises(InputError, match=r"gimp\.bmp: expected a plain picture, got 32 bits whose channels lie in an"):
        read_stored(gimp)
    Image.fromarray(RGB).save(tmp_path / "plain.bmp")
    np.testing.assert_array_equal(read_stored(tmp_path / "plain.bmp").pixels, RGB)


@pytest.mark.parametrize("composite", [True, False])
def test_a_psd_needs_a_picture_of_all_its_layers(tmp_path, composite):
    """Without Maximize Compatibility there is a white one in its place."""
    version = struct.pack(">I?IIIx", 1, composite, 0, 0, 1)
    resource = b"8BIM" + struct.pack(">HHI", 1057, 0, len(version) - 1) + version
    head = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, *GREY.shape, 8, 3) + struct.pack(">I", 0)
    planes = b"".join(np.ascontiguousarray(RGB[..., k]).tobytes() for k in range(3))
    path = tmp_path / "skin.psd"
    path.write_bytes(head + struct.pack(">I", len(resource)) + resource + struct.pack(">IH", 0, 0) + planes)
    if composite:
        np.testing.assert_array_equal(read_stored(path).pixels, RGB)
        return
    with pytest.raises(InputError, match=r"skin\.psd: expected a plain picture, got layers alone \(saved without Max"):
        read_stored(path)
