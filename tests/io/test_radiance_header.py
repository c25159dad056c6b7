"""`.hdr` files come the right way up whatever their resolution line says, in the colours that they name."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.image_file import read_header, read_stored
from skinbake.io.radiance_header import read_radiance_header
from tests.images import radiance_file

IMAGE = np.arange(1, 4 * 8 * 3 + 1, dtype=np.float32).reshape(4, 8, 3) / 64


@pytest.mark.parametrize(
    ("line", "stored"),
    [
        ("-Y 4 +X 8", IMAGE),
        ("+Y 4 +X 8", IMAGE[::-1]),
        ("-Y 4 -X 8", IMAGE[:, ::-1]),
        ("+Y 4 -X 8", IMAGE[::-1, ::-1]),
        ("+X 8 -Y 4", IMAGE.swapaxes(0, 1)),
        ("+X 8 +Y 4", IMAGE.swapaxes(0, 1)[:, ::-1]),
        ("-X 8 -Y 4", IMAGE.swapaxes(0, 1)[::-1]),
        ("-X 8 +Y 4", IMAGE.swapaxes(0, 1)[::-1, ::-1]),
    ],
)
def test_any_resolution_line(tmp_path, line, stored):
    """Rows or columns first, from either end: row 0 on top, column 0 on the left, eight wide and four high."""
    path = radiance_file(tmp_path / "sky.hdr", stored, line)
    header = read_header(path)
    assert (header.width, header.height) == (8, 4)
    np.testing.assert_allclose(read_stored(path).pixels, IMAGE, rtol=0.02)


def test_colours_that_are_not_the_usual_ones(tmp_path):
    """XYZE files, and primaries that the header names; without either nothing is said."""
    plain = radiance_file(tmp_path / "a.hdr", IMAGE, "-Y 4 +X 8")
    assert "chromaticities" not in read_stored(plain).attributes
    xyz = radiance_file(tmp_path / "b.hdr", IMAGE, "-Y 4 +X 8", "FORMAT=32-bit_rle_xyze")
    assert read_radiance_header(xyz).chromaticities[:6] == (1, 0, 0, 1, 0, 0)
    p3 = "PRIMARIES= .68 .32 .265 .69 .15 .06 .3127 .329"
    named = radiance_file(tmp_path / "c.hdr", IMAGE, "-Y 4 +X 8", f"FORMAT=32-bit_rle_rgbe\n{p3}")
    assert read_stored(named).attributes["chromaticities"] == (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)


def test_exposures_and_corrections_are_undone(tmp_path):
    """Pixels were multiplied by them, once a line; one that is no number is told."""
    said = "FORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\nEXPOSURE= 4\nCOLORCORR= 1 2 .5"
    path = radiance_file(tmp_path / "sky.hdr", IMAGE, "-Y 4 +X 8", said)
    np.testing.assert_allclose(read_stored(path).pixels, IMAGE / [8, 16, 4], rtol=0.02)
    for wrong in ("EXPOSURE=bright", "EXPOSURE=0", "COLORCORR=1 1", "EXPOSURE=nan"):
        path = radiance_file(tmp_path / "b.hdr", IMAGE, "-Y 4 +X 8", f"FORMAT=32-bit_rle_rgbe\n{wrong}")
        with pytest.raises(
            InputError, match=r"b\.hdr: expected [13] number\(s\) above 0 after (EXPOSURE|COLORCORR), got"
        ):
            read_stored(path)


def test_a_damaged_header_is_refused(tmp_path):
    """By what was expected."""
    path = tmp_path / "sky.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 -Y 8\n")
    with pytest.raises(InputError, match=r"sky\.hdr: expected a resolution line"):
        read_radiance_header(path)
    path.write_bytes(b"#?RADIANCE\nPRIMARIES= .64 .33\n\n-Y 4 +X 8\n")
    with pytest.raises(InputError, match="PRIMARIES of eight numbers"):
        read_radiance_header(path)
