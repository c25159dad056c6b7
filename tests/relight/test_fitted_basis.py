"""Fitted bases against numpy's decomposition."""

import numpy as np
import pytest

from skinbake.relight.fitted_basis import fitted_basis, gram


@pytest.fixture(scope="module")
def matrix():
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((300, 49)) * (0.8 ** np.arange(49))
    return columns @ np.linalg.qr(rng.standard_normal((49, 49)))[0]


def test_gram_is_the_product(matrix):
    """H^T H in a fixed order is that of BLAS to rounding."""
    np.testing.assert_allclose(gram(matrix), matrix.T @ matrix, rtol=1e-10, atol=1e-10)


def test_leading_vectors_lose_what_the_other_singular_values_hold(matrix):
    """The best 9 of 49: what is lost is the root of the squares of the other singular values."""
    basis = fitted_basis(gram(matrix), 9, 0)
    lost = np.linalg.norm(matrix - matrix @ basis.radiance @ basis.of_harmonics)
    singular = np.linalg.svd(matrix, compute_uv=False)
    assert lost == pytest.approx(np.sqrt((singular[9:] ** 2).sum()), rel=1e-4)


def test_irradiance_is_orthonormal(matrix):
    """Lights of the basis light the points at right angles, each with 1."""
    lit = matrix @ fitted_basis(gram(matrix), 9, 0).radiance
    np.testing.assert_allclose(lit.T @ lit, np.eye(9), atol=1e-8)


def test_any_seed_gives_the_same_lights(matrix):
    """The random beginning is forgotten."""
    first, second = (fitted_basis(gram(matrix), 5, seed).of_harmonics for seed in (0, 7))
    np.testing.assert_allclose(first, second, atol=1e-5 * abs(first).max())
