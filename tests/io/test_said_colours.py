"""Colours that pictures name without an ICC profile."""

from __future__ import annotations

import struct
import zlib
from fractions import Fraction

import numpy as np
import pytest
import tifffile
from PIL import Image, TiffImagePlugin

from skinbake.errors import InputError
from skinbake.io.colour import decode, srgb_to_linear
from skinbake.io.image_file import read_stored
from tests.images import ADOBE_RGB, icc_profile

RGB = (200, 100, 50)
SRGB = (0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)  # as a PNG has them, white first
P3 = (0.3127, 0.3290, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)
# Linear P3 to Rec.709, from its published primaries (SMPTE RP 431-2, EG 432-1)
P3_TO_REC709 = [[1.2249, -0.2249, 0.0], [-0.0420, 1.0420, 0.0], [-0.0197, -0.0786, 1.0983]]
ADOBE_TO_REC709 = [[1.3983, -0.3983, 0.0], [0.0, 1.0, 0.0], [0.0, -0.0429, 1.0429]]  # Adobe RGB (1998), 4.3.5


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def read(folder, *chunks, color_space="auto", is_data=False):
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0))
    pixels = chunk(b"IDAT", zlib.compress((b"\0" + bytes(RGB) * 2) * 2))
    path = folder / "map.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + b"".join(chunks) + pixels + chunk(b"IEND", b""))
    stored = read_stored(path)
    return decode(path, stored.pixels, stored.attributes, color_space, is_data)[0][0, 0]


def primaries(*xy):
    return chunk(b"cHRM", struct.pack(">8I", *(round(1e5 * value) for value in xy)))


def test_the_primaries_of_a_png_count(tmp_path):
    """P3 by cHRM alone was taken for Rec.709: saturated colours came out dull. Its curve is gAMA's where it has one."""
    encoded = np.array(RGB) / 255
    moved = np.array(P3_TO_REC709) @ srgb_to_linear(encoded)
    np.testing.assert_allclose(read(tmp_path, primaries(*P3)), moved, atol=2e-4)
    power = np.array(P3_TO_REC709) @ encoded**2.2
    np.testing.assert_allclose(
        read(tmp_path, chunk(b"gAMA", struct.pack(">I", 45455)), primaries(*P3)), power, atol=2e-4
    )


def test_srgb_by_name_goes_before_primaries(tmp_path):
    plain = read(tmp_path)
    for chunks in ((primaries(*SRGB),), (chunk(b"sRGB", b"\0"), primaries(*P3))):
        np.testing.assert_array_equal(read(tmp_path, *chunks), plain)
    np.testing.assert_array_equal(read(tmp_path, primaries(*P3), color_space="srgb"), plain)
    np.testing.assert_allclose(read(tmp_path, primaries(*P3), is_data=True), np.array(RGB) / 255, rtol=1e-6)


@pytest.mark.parametrize("value", [0.3, 0])
def test_primaries_that_span_nothing_are_refused(tmp_path, value):
    with pytest.raises(InputError, match=r"map\.png: expected chromaticities that span colours"):
        read(tmp_path, primaries(*[value] * 8))


@pytest.mark.parametrize("kind", ["jpg", "webp"])
@pytest.mark.parametrize("said", ["R03", "R98"])
def test_a_photograph_in_adobe_rgb_is_told_by_its_exif(tmp_path, monkeypatch, kind, said):
    """As cameras write it, without a profile; others that are no sRGB say nothing more."""
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA001: 65535, 0xA005: {1: said}})
    path = tmp_path / f"photo.{kind}"
    Image.new("RGB", (16, 16), RGB).save(path, exif=exif, quality=100)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1)  # textures are larger than what Pillow opens
    stored = read_stored(path)
    encoded = stored.pixels[4, 4] / 255
    found = decode(path, stored.pixels, stored.attributes, "auto", False)[0][4, 4]
    expected = np.array(ADOBE_TO_REC709) @ encoded**2.2 if said == "R03" else srgb_to_linear(encoded)
    np.testing.assert_allclose(found, expected, atol=3e-4)


def tiff(path, tags, depth=8):
    """A TIFF of `RGB` with tags by number: their type, and values."""
    if depth == 16:  # also of more than 4 GiB, as far as its directory goes
        pixels = np.full((4, 4, 3), [value * 257 for value in RGB], np.uint16)
        extra = [(tag, kind, len(values) // (1 + (kind == 5)), values, True) for tag, (kind, values) in tags.items()]
        tifffile.imwrite(path, pixels, photometric="rgb", bigtiff=True, byteorder=">", extratags=extra)
    else:
        directory = TiffImagePlugin.ImageFileDirectory_v2()
        for tag, (kind, values) in tags.items():
            whole = [Fraction(*pair) for pair in zip(values[::2], values[1::2], strict=True)] if kind == 5 else values
            directory[tag], directory.tagtype[tag] = tuple(whole), kind
        Image.new("RGB", (4, 4), RGB).save(path, tiffinfo=directory)
    stored = read_stored(path)
    return decode(path, stored.pixels, stored.attributes, "auto", False)[0][1, 2]


def rationals(*values):
    return 5, [number for value in values for number in (round(1e5 * value), 100000)]


@pytest.mark.parametrize("depth", [8, 16])
def test_the_primaries_of_a_tiff_count(tmp_path, depth):
    """P3 by its tags alone was taken for Rec.709."""
    encoded = np.array(RGB) / 255
    white, primaries = rationals(*P3[:2]), rationals(*P3[2:])
    moved = np.array(P3_TO_REC709) @ srgb_to_linear(encoded)
    for tags in ({318: white, 319: primaries}, {319: primaries}):
        np.testing.assert_allclose(tiff(tmp_path / "p3.tif", tags, depth), moved, atol=2e-4)
    same = {318: rationals(*SRGB[:2]), 319: rationals(*SRGB[2:])}
    for tags in (same, {318: same[318]}, {}):
        np.testing.assert_allclose(tiff(tmp_path / "srgb.tif", tags, depth), srgb_to_linear(encoded), atol=1e-6)


@pytest.mark.parametrize("depth", [8, 16])
def test_a_curve_of_a_tiff_that_is_not_srgb_is_refused_by_name(tmp_path, depth):
    """Unless the look says what the file is."""
    levels = np.linspace(0, 1, 1 << depth)
    srgb, power = ([round(x) for x in 65535 * curve] for curve in (srgb_to_linear(levels), levels**1.8))
    expected = srgb_to_linear(np.array(RGB) / 255)
    for same in (srgb, 3 * srgb):
        np.testing.assert_allclose(tiff(tmp_path / "srgb.tif", {301: (3, same)}, depth), expected, atol=1e-6)
    for other in (power, 2 * srgb + power):
        with pytest.raises(InputError, match=r"own\.tif: its TransferFunction is not that of sRGB"):
            tiff(tmp_path / "own.tif", {301: (3, other)}, depth)
    stored = read_stored(tmp_path / "own.tif")
    found = decode(tmp_path / "own.tif", stored.pixels, stored.attributes, "srgb", False)[0][1, 2]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_primaries_of_a_tiff_that_are_damaged_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"chromaticities are damaged: expected 8 floats"):
        tiff(tmp_path / "cut.tif", {319: rationals(0.64, 0.33, 0.3)})
    with pytest.raises(InputError, match="chromaticities that span colours"):
        tiff(tmp_path / "none.tif", {318: rationals(0, 0)})
    tiff(tmp_path / "text.tif", {319: (2, ["P3"])})


@pytest.mark.parametrize("kind", [b"DEBM", b"BGRs"])
def test_the_profile_of_a_bmp_counts(tmp_path, kind):
    """Behind the pixels, where the header's fifth version says so; other versions and kinds of colours have none."""
    profile, pixels = icc_profile(ADOBE_RGB), bytes(RGB[::-1]) * 4
    head = struct.pack("<IiiHHII16x16x4s48xIII4x", 124, 4, 1, 1, 24, 0, 12, kind, 4, 124 + 12, len(profile))
    path = tmp_path / "map.bmp"
    path.write_bytes(b"BM" + struct.pack("<I4xI", 138 + 12 + len(profile), 138) + head + pixels + profile)
    stored = read_stored(path)
    found = decode(path, stored.pixels, stored.attributes, "auto", False)[0][0, 0]
    linear = srgb_to_linear(np.array(RGB) / 255)
    wanted = np.array(ADOBE_TO_REC709) @ linear if kind == b"DEBM" else linear
    np.testing.assert_allclose(found, wanted, atol=2e-3)
