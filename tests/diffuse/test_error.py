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


def test_a_dim_light_beside_a_bright_one_has_its_own_error():
    """A sky that is right and a lamp of a thousandth that is off by a tenth: a tenth, were the lamp alone to shine."""
    rng = np.random.default_rng(0)
    exact = rng.uniform(0.5, 1.5, (200, 6)) * [1e3, 1e3, 1e3, 1, 1, 1]
    read = exact * [1, 1, 1, 1.1, 1.1, 1.1]
    assert measure_error(read, exact, exact).rms == pytest.approx(0.1)
    assert measure_error(exact, read, exact).method == pytest.approx(0.1)
    assert measure_error(read, exact, exact).storage == pytest.approx(0.1)
    assert measure_error(read[:, :3], exact[:, :3], exact[:, :3]).rms == 0


def test_a_light_that_hardly_a_probe_sees_is_judged_with_the_others():
    """A spot on two probes of 200, and one on none: nobody knows how wrong they are by themselves."""
    exact = np.ones((200, 9))
    exact[2:, 3:6], exact[:, 6:] = 0, 0
    read = exact.copy()
    read[0, 3:6] = 2
    read[0, 6:] = 1e-3
    assert measure_error(read, exact, exact).rms == pytest.approx(np.sqrt(3 / 606), rel=1e-3)
