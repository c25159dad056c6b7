"""Errors are split into what the method and what the storage adds."""

import numpy as np
import pytest

from skinbake.diffuse.error import measure_error


def test_error_parts_are_what_they_are_called():
    """rms of reading, method and storage against numbers worked by hand."""
    exact = np.array([[3.0], [4.0]])
    error = measure_error(exact + np.array([[0.3], [0.4]]), exact + np.array([[0.3], [0.0]]), exact)
    assert (error.rms, error.method, error.storage) == pytest.approx((0.1, 0.06, 0.08))
    assert error.max == pytest.approx(0.4 / 3.5)
