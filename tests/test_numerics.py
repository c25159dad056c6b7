"""Arithmetic that nothing else tests by itself."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from skinbake.numerics import even_stride, monotone_cubic


def test_a_stride_visits_all_once_and_deals_out_evenly():
    """Either half of the turns gets half of what lies in either half, to a few."""
    assert even_stride(0) == even_stride(1) == 1
    for count in range(1, 400):
        turns = np.arange(count) * even_stride(count) % count
        assert sorted(turns) == list(range(count))
        if count > 8:
            early = np.count_nonzero(turns[: count // 2] < count / 2)
            assert abs(early - count / 4) <= 0.1 * count


@pytest.mark.parametrize("count", [2, 3, 4, 40])
def test_monotone_cubics_are_scipy_s(count):
    """Also where values turn, stay the same or jump, between uneven nodes and beyond them, of several columns."""
    rng = np.random.default_rng(count)
    x = np.cumsum(rng.uniform(0.05, 3, count))
    jumps = np.where(x > x.mean(), 5.0, -1.0)
    values = np.stack([rng.normal(size=count), np.cumsum(rng.uniform(0, 1, count)), jumps, np.zeros(count)], axis=1)
    at = np.concatenate([x, rng.uniform(x[0] - 1, x[-1] + 1, 500)])
    np.testing.assert_allclose(monotone_cubic(x, values, at), PchipInterpolator(x, values)(at), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(monotone_cubic(x, values[:, 0], at), monotone_cubic(x, values, at)[:, 0])
    inside = (at >= x[0]) & (at <= x[-1])
    assert np.abs(monotone_cubic(x, jumps, at[inside])).max() <= 5.0  # no overshoot
