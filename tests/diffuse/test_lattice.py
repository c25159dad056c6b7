"""Kernels have the variance they are asked for, however narrow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ive

from skinbake.diffuse.lattice import (
    TAIL,
    discrete_gaussian,
    lattice_gain,
    lattice_table,
    lattice_variance,
    residual_kernel,
    sampled_gaussian,
)


def _moments(half):
    full = np.concatenate([half[:0:-1], half])
    n = np.arange(len(full)) - (len(half) - 1)
    return full, full.sum(), (full * n**2).sum()


def test_discrete_gaussian_equals_the_theory_s_test_vector():
    """T(n; 0.09) of theory.md 5.6."""
    np.testing.assert_allclose(
        discrete_gaussian(0.09)[:4], [0.9157828331, 0.0411685584, 9.2598010e-4, 1.3887e-5], rtol=1e-4
    )


@given(st.floats(0, 3e4))
def test_discrete_gaussian_sums_to_one_and_spreads_by_t(t):
    """For every width; the tail that is cut off lies just outside."""
    half = discrete_gaussian(t)
    _, total, variance = _moments(half)
    assert total == pytest.approx(1, abs=1e-12)
    assert variance == pytest.approx(t, abs=2 * TAIL * len(half) ** 2)


@given(st.floats(1e-6, 1e4))
def test_discrete_gaussian_is_scipy_s_bessel_function(t):
    """Of all orders that are kept."""
    half = discrete_gaussian(t)
    np.testing.assert_allclose(half / half[0], ive(np.arange(len(half)), t) / ive(0, t), rtol=1e-11, atol=1e-300)


def test_discrete_gaussian_is_additive():
    """T(3) * T(4) = T(7)."""
    three, four = (_moments(discrete_gaussian(t))[0] for t in (3, 4))
    both = np.convolve(three, four)
    seven = discrete_gaussian(7)
    np.testing.assert_allclose(both[len(both) // 2 :][: len(seven)], seven, atol=TAIL)


def test_residual_kernel_has_both_cumulants():
    """Variance and fourth cumulant are the wanted ones."""
    full, _, variance = _moments(residual_kernel(2.5, 0.7))
    n = np.arange(len(full)) - len(full) // 2
    assert variance == pytest.approx(2.5, rel=1e-4)
    assert (full * n**4).sum() - 3 * variance**2 == pytest.approx(0.7, rel=5e-3)


def test_sampled_gaussian_spreads_by_t():
    """About its middle."""
    weights = sampled_gaussian(1.75)
    n = np.arange(len(weights)) - len(weights) // 2
    assert weights.sum() == pytest.approx(1)
    assert (weights * n**2).sum() == pytest.approx(1.75, rel=1e-4)


@pytest.mark.parametrize("t", [3e-3, 0.02, 0.09, 0.3, 0.6, 0.88, 1.0, 5.0])
def test_lattice_variance_spreads_a_lattice_by_what_was_asked(t):
    """The variance of the sampled, widened Gaussian is t, and `gain` makes its sum 2 pi t."""
    n = np.arange(-40, 41)
    w = np.exp(-(n**2) / (2 * lattice_variance(t, 1.0, lattice_table())))
    assert (w * n**2).sum() / w.sum() == pytest.approx(t, rel=2e-3)
    assert w.sum() ** 2 * lattice_gain(t, 1.0, lattice_table()) == pytest.approx(2 * np.pi * t, rel=2e-3)


def test_a_sum_of_no_lattice_is_left_alone():
    """texel 0 means: not a texel."""
    assert lattice_variance(0.01, 0.0, lattice_table()) == 0.01
    assert lattice_gain(0.01, 0.0, lattice_table()) == 1


def test_negative_variance_is_refused():
    """A fault upstream, not a kernel."""
    with pytest.raises(ValueError, match=">= 0"):
        discrete_gaussian(-1)
