import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from skinbake.profile.burley import (
    burley_cdf,
    burley_disc_mean,
    burley_hankel,
    burley_reflectance,
    burley_shape,
)
from skinbake.profile.models import BurleyProfile

D = np.array([0.7])
ONE = np.ones(1)


def test_cdf_is_the_integral_of_the_profile():
    """2 pi int_0^a r R dr is the CDF, and all of it is the albedo."""
    for a in (1e-6, 0.3, 2.0, 40.0):
        light = quad(lambda r: 2 * np.pi * r * burley_reflectance(D, ONE, np.array([r]))[0, 0], 0, a, epsabs=1e-14)[0]
        assert burley_cdf(0.7, a) == pytest.approx(light, rel=1e-9)
    assert burley_cdf(0.7, 1e3) == 1.0


def test_hankel_transform():
    """The closed transform is 2 pi int R J0(s r) r dr."""
    for s in (0.0, 0.5, 3.0):
        direct = quad(
            lambda r, s=s: 2 * np.pi * r * j0(s * r) * burley_reflectance(D, ONE, np.array([r]))[0, 0], 0, 60, limit=400
        )[0]
        assert burley_hankel(D, ONE, np.array([s]))[0, 0] == pytest.approx(direct, rel=1e-7)


def test_disc_mean_is_finite_where_the_profile_is_not():
    """At r = 0 the profile rises without bound; its mean over a small disc is finite."""
    assert burley_reflectance(D, ONE, np.full(1, 1e-300))[0, 0] > 1e290
    profile = BurleyProfile(np.full(3, 0.7), np.ones(3))
    assert profile.reflectance(0.0)[0, 0] == pytest.approx(burley_disc_mean(D, ONE, 0.035)[0])


def test_vectors(agrees, vectors):
    """Published values of section 8."""
    found = [burley_reflectance(D, ONE, ONE)[0, 0], burley_cdf(0.7, 1.0)]
    np.testing.assert_allclose(found, vectors["burley"]["expected"][:2], rtol=vectors["burley"]["rtol"])
    agrees("burley_s", [burley_shape(0.6, kind) for kind in ("searchlight", "diffuse", "surface")])
