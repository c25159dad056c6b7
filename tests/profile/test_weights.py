import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from skinbake.profile.weights import best_weights, zero_sum_basis


def problem(seed, rows=9, count=5):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, count)) + 0.7, rng.normal(size=rows) + 0.3


@pytest.mark.parametrize("seed", range(30))
def test_free_sum_equals_the_textbook_solver(seed):
    """Without a given sum the result is that of non-negative least squares."""
    columns, wanted = problem(seed)
    np.testing.assert_allclose(best_weights(columns, wanted), nnls(columns, wanted)[0], atol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_given_sum_equals_a_general_solver(seed):
    """With a given sum the weights meet it exactly and nothing feasible fits better."""
    columns, wanted = problem(seed)
    weights = best_weights(columns, wanted, total=1.3)
    assert (weights >= 0).all()
    assert weights.sum() == pytest.approx(1.3, rel=1e-13)
    other = minimize(
        lambda w: np.sum((columns @ w - wanted) ** 2),
        np.full(5, 1.3 / 5),
        jac=lambda w: 2 * columns.T @ (columns @ w - wanted),
        bounds=[(0, None)] * 5,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1.3},
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert np.sum((columns @ weights - wanted) ** 2) <= other.fun * (1 + 1e-9)


def test_signed_weights_are_plain_least_squares():
    """Signed weights with and without a given sum satisfy the normal equations."""
    columns, wanted = problem(3)
    free = best_weights(columns, wanted, signed=True)
    np.testing.assert_allclose(columns.T @ (columns @ free - wanted), 0, atol=1e-10)
    tied = best_weights(columns, wanted, total=2.0, signed=True)
    assert tied.sum() == pytest.approx(2)
    gradient = columns.T @ (columns @ tied - wanted)
    np.testing.assert_allclose(gradient, gradient.mean(), atol=1e-10)


def test_one_column():
    """One Gaussian with a given sum has no choice."""
    assert best_weights(np.ones((1, 1)), np.array([5.0]), total=0.4).tolist() == [0.4]


def test_zero_sum_basis():
    """Its columns are orthonormal and sum to 0."""
    basis = zero_sum_basis(6)
    np.testing.assert_allclose(basis.T @ basis, np.eye(5), atol=1e-14)
    np.testing.assert_allclose(basis.sum(axis=0), 0, atol=1e-14)
