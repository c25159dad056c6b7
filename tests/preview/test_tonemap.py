"""The view transform is sRGB exactly, linear in the mids, and never turns the hue of a highlight."""

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbake.preview.tonemap import KNEE, roll_off, srgb_encode, tonemap

level = st.floats(0, 100)


def test_srgb_inverts_the_standards_decoding_for_every_byte():
    encoded = np.arange(256) / 255
    decoded = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(srgb_encode(decoded), encoded, atol=1e-7)
    np.testing.assert_array_equal(np.rint(255 * srgb_encode(decoded)), np.arange(256))


def test_below_the_knee_nothing_is_bent():
    rgb = np.random.default_rng(1).uniform(0, KNEE, (7, 5, 3))
    np.testing.assert_allclose(roll_off(rgb), rgb, rtol=1e-15)


def test_the_curve_is_monotonic_smooth_at_the_knee_and_stays_below_one():
    x = np.linspace(0, 50, 200001)
    y = roll_off(np.repeat(x[:, None], 3, 1))[:, 0]
    slope = np.diff(y) / np.diff(x)
    assert y.max() < 1
    assert slope.min() > 0
    assert np.abs(np.diff(slope)).max() < 2e-3


@given(level, level, level)
def test_hue_stays(r, g, b):
    shown = roll_off([r, g, b])
    assert (shown >= 0).all()
    assert (shown <= 1).all()
    before, after = colorsys.rgb_to_hsv(r, g, b), colorsys.rgb_to_hsv(*shown)
    if after[1] > 1e-6 and max(r, g, b) > 1e-6:
        turn = abs(before[0] - after[0])
        assert min(turn, 1 - turn) < 1e-6


def test_exposure_counts_in_stops_and_extremes_are_shown():
    np.testing.assert_array_equal(tonemap([[0.05, 0.1, 0.2]], 1.0), tonemap([[0.1, 0.2, 0.4]]))
    np.testing.assert_array_equal(
        tonemap([[0, 0, 0], [1e30, 1e30, 1e30], [-1e-9, 0, 0]]), [[0] * 3, [255] * 3, [0] * 3]
    )
    with pytest.raises(ValueError, match="finite"):
        tonemap([[np.nan, 0, 0]])
