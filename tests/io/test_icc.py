"""ICC profiles of cameras and screens are curves and a matrix, and end in linear Rec.709."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.io.colour import REC709
from skinbake.io.icc import parse_icc
from tests.images import ADOBE_RGB, P3_D65, icc_profile, parametric_curve, table_curve, to_xyz

X = np.linspace(0, 1, 33)


@pytest.mark.parametrize("primaries", [P3_D65, ADOBE_RGB])
def test_the_matrix_is_that_of_the_primaries(primaries):
    """Both have the white of Rec.709: through XYZ, without any adaptation."""
    exact = np.linalg.solve(to_xyz(REC709), to_xyz(primaries))
    np.testing.assert_allclose(parse_icc(icc_profile(primaries)).matrix, exact, atol=5e-4)


@pytest.mark.parametrize(
    ("curve", "exact"),
    [
        (table_curve([]), X),
        (table_curve([2.2]), X ** (563 / 256)),
        (table_curve(np.linspace(0, 1, 1024) ** 1.8), X**1.8),
        (parametric_curve(0, 2.2), X**2.2),
        (parametric_curve(1, 2.0, 0.8, 0.2), np.where(X >= -0.25, (0.8 * X + 0.2) ** 2, 0)),
        (parametric_curve(2, 2.0, 0.8, 0.1, 0.05), (0.8 * X + 0.1) ** 2 + 0.05),
        (
            parametric_curve(4, 2.0, 0.9, 0.1, 0.5, 0.2, 0.0, 0.01),
            np.where(X >= 0.2, (0.9 * X + 0.1) ** 2, 0.5 * X + 0.01),
        ),
    ],
)
def test_every_form_of_curve(curve, exact):
    """Identity, gamma, table, and the parametric ones."""
    np.testing.assert_allclose(parse_icc(icc_profile(curve=curve)).curves[1](X), exact, atol=3e-4)


def test_srgb_is_known_for_what_it_is():
    """By its numbers, not by its name; others are not taken for it."""
    assert parse_icc(icc_profile(REC709)).is_srgb
    assert not parse_icc(icc_profile(P3_D65, name="sRGB IEC61966-2.1")).is_srgb
    assert not parse_icc(icc_profile(REC709, table_curve([1.8]))).is_srgb


def test_a_grey_profile_has_a_curve_alone():
    """Dot gain and gamma of grey pictures."""
    found = parse_icc(icc_profile(space=b"GRAY", curve=table_curve([1.8])))
    np.testing.assert_allclose(found.curves[0](X), X ** (461 / 256), atol=1e-4)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "damaged"),
        (icc_profile()[:100], "damaged"),
        (icc_profile(space=b"CMYK"), "describes CMYK colours"),
        (icc_profile().replace(b"rTRC", b"A2B0"), "made of tables"),
        (icc_profile(curve=b"mmmm" + b"\0" * 20), "unknown form"),
        (icc_profile(curve=parametric_curve(4, 2.4)), "damaged"),
    ],
)
def test_what_is_no_such_profile_is_said(data, message):
    """By what it is instead."""
    with pytest.raises(ValueError, match=message):
        parse_icc(data)
