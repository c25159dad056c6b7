"""Arithmetic that nothing else tests by itself."""

import numpy as np

from skinbake.numerics import even_stride


def test_a_stride_visits_all_once_and_deals_out_evenly():
    """Either half of the turns gets half of what lies in either half, to a few."""
    assert even_stride(0) == even_stride(1) == 1
    for count in range(1, 400):
        turns = np.arange(count) * even_stride(count) % count
        assert sorted(turns) == list(range(count))
        if count > 8:
            early = np.count_nonzero(turns[: count // 2] < count / 2)
            assert abs(early - count / 4) <= 0.1 * count
