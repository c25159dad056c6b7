import numpy as np
import pytest
from scipy.integrate import quad

from skinbake.profile.fresnel import boundary_factor, diffuse_reflectance_polynomial, fresnel_moments


def fresnel(eta, mu):
    """Textbook unpolarised Fresnel reflectance, light inside."""
    sin2 = eta**2 * (1 - mu**2)
    if sin2 >= 1:
        return 1.0
    t = np.sqrt(1 - sin2)
    return 0.5 * (((eta * mu - t) / (eta * mu + t)) ** 2 + ((mu - eta * t) / (mu + eta * t)) ** 2)


def closed_form(n):
    """theory.md 1.8: diffuse reflectance from the thin side."""
    m = n * n
    return (
        0.5
        + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
        + m * (m - 1) ** 2 / (m + 1) ** 3 * np.log((n - 1) / (n + 1))
        - 2 * n**3 * (m + 2 * n - 1) / ((m + 1) * (m * m - 1))
        + 8 * m * m * (m * m + 1) / ((m + 1) * (m * m - 1) ** 2) * np.log(n)
    )


@pytest.mark.parametrize("eta", [1 / 1.5, 1 / 1.4, 1.05, 1.3, 1.4, 2.0])
def test_moments_equal_brute_force(eta):
    """Both Fresnel moments equal adaptive quadrature of the textbook reflectance."""
    critical = [np.sqrt(1 - 1 / eta**2)] if eta > 1 else None
    first = quad(lambda mu: 2 * fresnel(eta, mu) * mu, 0, 1, points=critical, epsabs=1e-12, limit=400)[0]
    second = quad(lambda mu: 3 * fresnel(eta, mu) * mu**2, 0, 1, points=critical, epsabs=1e-12, limit=400)[0]
    np.testing.assert_allclose(fresnel_moments(eta), [first, second], rtol=1e-8)


@pytest.mark.parametrize("eta", [1.1, 1.3, 1.4, 2.0, 2.9])
def test_first_moment_equals_closed_form(eta):
    """F_dr by quadrature is the closed form of Walsh and Duntley, on both sides."""
    assert fresnel_moments(eta)[0] == pytest.approx(1 - (1 - closed_form(eta)) / eta**2, rel=1e-11)
    assert fresnel_moments(1 / eta)[0] == pytest.approx(closed_form(eta), rel=1e-11)


def test_matched_face_reflects_nothing():
    """At eta = 1 the boundary factor is exactly 1 by every method, though no polynomial is; near it all is tame."""
    assert {boundary_factor(1.0, method) for method in ("polynomial", "exact", "better")} == {1.0}
    assert 1 < boundary_factor(1.0001, "exact") < 1.001
    assert boundary_factor(1.0001) == pytest.approx(1, abs=0.004)


@pytest.mark.parametrize("eta", [1 / 1.5, 1.3, 1.4, 1.5])
def test_polynomial_is_near_the_integral(eta):
    """The published polynomial is within 0.0012 of the integral, on either side of 1."""
    assert diffuse_reflectance_polynomial(eta) == pytest.approx(fresnel_moments(eta)[0], abs=1.2e-3)


@pytest.mark.parametrize("eta", [0.2, 3.1, float("nan"), 0.0])
def test_index_outside_the_fit_is_refused(eta):
    """Indices where the polynomial runs off are refused by name."""
    with pytest.raises(ValueError, match="eta: expected a ratio"):
        boundary_factor(eta)


def test_vectors(agrees):
    """Published values of section 1."""
    agrees("fdr_poly_1.4", diffuse_reflectance_polynomial(1.4))
    agrees("fdr_poly_inv1.4", diffuse_reflectance_polynomial(1 / 1.4))
    agrees("fdr_exact_1.4", fresnel_moments(1.4)[0])
    agrees("fresnel_3C2_1.4", fresnel_moments(1.4)[1])
    agrees("A_three_1.4", [boundary_factor(1.4, method) for method in ("polynomial", "exact", "better")])
