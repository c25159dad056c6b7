"""Light of any brightness comes to the diffusion in a range that float32 can sum, and goes back as it came."""

import numpy as np
import pytest

from skinbake.diffuse.source_light import scaled_source, unscaled


@pytest.mark.parametrize("peak", [1e-30, 3e-13, 1.0, 7e11, 1e30])
def test_scaling_is_undone_to_the_last_bit(peak):
    """By powers of two; only lights outside 1e-12 ... 1e12 are scaled, each by itself."""
    rng = np.random.default_rng(0)
    rgb = rng.uniform(0.1, 1, (2, 5, 7, 3)).astype(np.float32)
    rgb[1] *= np.float32(peak)
    scaled, exponents = scaled_source({1001: rgb, 1002: rgb})
    assert exponents[0] == 0
    assert (exponents[1] == 0) == (1e-12 < rgb[1].max() < 1e12)
    assert 0.4 < scaled[1002][1].max() < 1e12
    np.testing.assert_array_equal(unscaled(scaled[1001], exponents), rgb)


def test_light_in_range_is_not_copied():
    """Nothing is scaled: the same arrays."""
    rgb = np.ones((1, 3, 4, 3), np.float32)
    scaled, exponents = scaled_source({1001: rgb})
    assert scaled[1001] is rgb
    assert unscaled(rgb, exponents) is rgb
