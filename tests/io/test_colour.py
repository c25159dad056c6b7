"""Colours come out linear Rec.709, by what is said of them, or are refused by the name of their space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.errors import InputError
from skinbake.io.colour import REC709, decode, known_color_space, primaries_matrix, srgb_to_linear
from tests.images import ACES_AP1, P3_D65, icc_profile, to_xyz

PATH = Path("map.png")
SKIN = np.array([[[0.6, 0.3, 0.1]]])
EIGHT = np.array([[[200, 130, 100]]], np.uint8)


def test_srgb_matches_its_definition():
    """The curve's two branches meet, 0 and 1 stay, 0.5 is 0.21404 (IEC 61966-2-1)."""
    np.testing.assert_allclose(srgb_to_linear(np.array([0, 0.5, 1.0])), [0, 0.21404114, 1], atol=1e-7)
    low, high = srgb_to_linear(np.array([0.04045 - 1e-9, 0.04045 + 1e-9]))
    assert abs(low - high) < 1e-6


def test_primaries_are_converted_as_opencolorio_does():
    """AP1 (white D60), P3 and Rec.2020, against the matrices of OpenImageIO's own OCIO configuration."""
    rec2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    spaces = (("ACEScg", ACES_AP1), ("Linear P3-D65", P3_D65), ("Linear Rec.2020", rec2020))
    for name, primaries in spaces:
        axes = oiio.ImageBuf(np.eye(3, dtype=np.float32).reshape(1, 3, 3))
        ocio = oiio.ImageBufAlgo.colorconvert(axes, name, "lin_rec709_scene", False).get_pixels(oiio.FLOAT)[0].T
        np.testing.assert_allclose(primaries_matrix(primaries), ocio, atol=2e-4, err_msg=name)
    np.testing.assert_allclose(primaries_matrix(REC709), np.eye(3), atol=1e-12)


def test_xyz_are_tristimulus_values():
    """Primaries that are the axes of XYZ: the matrix of Rec.709 undone, whatever white is said."""
    xyz = (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)
    np.testing.assert_allclose(primaries_matrix(xyz) @ to_xyz(REC709), np.eye(3), atol=1e-9)


@pytest.mark.parametrize("primaries", [ACES_AP1, P3_D65])
def test_an_exr_says_its_primaries(primaries):
    """Floats of a colour that is .6 .3 .1 in Rec.709 come back as that."""
    stored = SKIN @ np.linalg.inv(primaries_matrix(primaries)).T
    found, moved = decode(PATH, stored.astype(np.float32), {"chromaticities": primaries}, "auto", False)
    np.testing.assert_allclose(found, SKIN, atol=1e-6)
    assert moved
    as_told, _ = decode(PATH, stored.astype(np.float32), {"chromaticities": primaries}, "linear", False)
    np.testing.assert_allclose(as_told, stored, atol=1e-6)


def test_display_p3_by_its_profile():
    """sRGB's curve, P3's primaries: (200, 130, 100) is .657 .208 .111 and not .578 .223 .127."""
    exact = srgb_to_linear(EIGHT / 255) @ primaries_matrix(P3_D65).T
    np.testing.assert_allclose(exact[0, 0], [0.657, 0.208, 0.111], atol=5e-4)
    attributes = {"ICCProfile": np.frombuffer(icc_profile(), np.uint8), "oiio:ColorSpace": "srgb_rec709_scene"}
    for pixels in (EIGHT, EIGHT.astype(np.uint16) * 257, (EIGHT / 255).astype(np.float32)):
        found, moved = decode(PATH, pixels, attributes, "auto", False)
        np.testing.assert_allclose(found, exact, atol=4e-4)
        assert moved
    as_told, _ = decode(PATH, EIGHT, attributes, "srgb", False)
    np.testing.assert_allclose(as_told, srgb_to_linear(EIGHT / 255), atol=1e-6)


def test_a_profile_of_srgb_changes_nothing():
    """To the last bit: cameras embed it in what they would write without."""
    profile = np.frombuffer(icc_profile(REC709), np.uint8)
    plain, _ = decode(PATH, EIGHT, {}, "auto", False)
    found, moved = decode(PATH, EIGHT, {"ICCProfile": profile}, "auto", False)
    np.testing.assert_array_equal(found, plain)
    assert not moved


def test_linear_floats_with_an_srgb_tag_stay_linear():
    """maketx --colorconvert leaves the tag of what it read; integers with the tag are encoded."""
    tag = {"oiio:ColorSpace": "srgb_rec709_scene"}
    found, _ = decode(PATH, SKIN.astype(np.float16), tag, "auto", False)
    np.testing.assert_allclose(found, SKIN, atol=1e-3)
    found, _ = decode(PATH, EIGHT, tag, "auto", False)
    np.testing.assert_allclose(found, srgb_to_linear(EIGHT / 255), atol=1e-6)
    found, _ = decode(PATH, EIGHT, {"oiio:ColorSpace": "lin_rec709_scene"}, "auto", False)
    np.testing.assert_allclose(found, EIGHT / 255, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "curve", "primaries"),
    [
        ("acescg", lambda x: x, ACES_AP1),
        ("ACEScg", lambda x: x, ACES_AP1),
        ("srgb_p3d65_scene", srgb_to_linear, P3_D65),
        ("Gamma 2.2 Encoded Rec.709", lambda x: x**2.2, REC709),
    ],
)
def test_any_name_that_opencolorio_knows(name, curve, primaries):
    """In the configuration, or in the file's own header."""
    exact = curve(EIGHT / 255) @ primaries_matrix(primaries).T
    found, _ = decode(PATH, EIGHT, {}, name, False)
    np.testing.assert_allclose(found, exact, atol=3e-4)
    in_header, _ = decode(PATH, EIGHT, {"oiio:ColorSpace": name}, "auto", False)
    np.testing.assert_allclose(in_header, exact, atol=3e-4)


def test_data_are_taken_as_they_are():
    """Whatever a profile or a tag says of colours, unless the configuration says it."""
    said = {"ICCProfile": np.frombuffer(icc_profile(), np.uint8), "oiio:ColorSpace": "srgb_rec709_scene"}
    np.testing.assert_allclose(decode(PATH, EIGHT, said, "auto", True)[0], EIGHT / 255, atol=1e-7)
    grey = EIGHT[..., :1]
    np.testing.assert_allclose(decode(PATH, grey, {}, "g22_rec709_scene", True)[0], (grey / 255) ** 2.2, atol=3e-4)


@pytest.mark.parametrize(
    ("attributes", "color_space", "message"),
    [
        ({}, "sgrb", "color_space: expected auto, srgb, linear, .* got 'sgrb'; did you mean srgb"),
        ({"oiio:ColorSpace": "Sony S-Log9"}, "auto", "oiio:ColorSpace: .* got 'Sony S-Log9'"),
        ({"ICCProfile": np.frombuffer(icc_profile(space=b"CMYK"), np.uint8)}, "auto", "ICC profile .* CMYK"),
        ({"chromaticities": (0.3,) * 8}, "auto", "chromaticities that span colours"),
    ],
)
def test_what_cannot_be_converted_is_refused_by_name(attributes, color_space, message):
    """File, who says it, and what it is."""
    pixels = EIGHT if "chromaticities" not in attributes else EIGHT.astype(np.float32)
    with pytest.raises(InputError, match=rf"map\.png: .*{message}"):
        decode(PATH, pixels, attributes, color_space, False)


def test_names_are_judged_without_a_file():
    """For the line of the configuration that has them."""
    assert all(known_color_space(name) is None for name in ("auto", "srgb", "linear", "ACEScg", "lin_ap1_scene", "raw"))
    assert "did you mean" in str(known_color_space("acesgc"))
