import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium
from skinbake.profile.slab import half_space, sharp_transmittance, slab

A = boundary_factor(1.4)
ZERO = np.zeros((1, 1))


def one(sigma_a, sigma_sp):
    return Medium(np.array([float(sigma_a)]), np.array([float(sigma_sp)]))


def dipole_pairs(m, d, top, bottom, pairs):
    """Totals of theory.md 3.2, every dipole summed; q(z) integrates to sgn(z) exp(-sigma_tr |z|) / 2 (times 4 pi)."""
    zb, zd, length = m.extrapolation_mm(top)[0], m.extrapolation_mm(bottom)[0], m.free_path_mm[0]
    i = np.arange(-pairs, pairs + 1)
    period = 2 * i * (d + zb + zd)
    real, virtual = period + length, period - length - 2 * zb

    def q(z):
        return np.sign(z) * np.exp(-m.sigma_tr_per_mm[0] * np.abs(z))

    share = m.albedo[0] / 2
    return share * np.sum(q(real) - q(virtual)), share * np.sum(q(d - real) - q(d - virtual))


@pytest.mark.parametrize(("d", "top", "bottom"), [(1.0, A, A), (4.0, A, 1.0), (0.999, 1.0, A)])
def test_closed_form_is_the_sum_of_all_dipoles(d, top, bottom):
    """The closed form equals 400 pairs of dipoles, with equal and unequal faces."""
    m = one(0.05, 1)
    response = slab(m, d, top, bottom, ZERO)
    expected = dipole_pairs(m, d, top, bottom, 400)
    np.testing.assert_allclose([response.down_r[0, 0], response.down_t[0, 0]], expected, rtol=1e-11)


@settings(max_examples=200, deadline=None)
@given(st.floats(-6, 4), st.floats(-4, 4), st.floats(1, 2), st.floats(1, 2), st.sampled_from(["guarded", "ballistic"]))
def test_without_absorption_nothing_is_lost(log_sigma, log_d, eta_top, eta_bottom, thin):
    """R + T = 1 for light from above and from below, whatever the thickness, scattering and faces."""
    top, bottom = boundary_factor(eta_top), boundary_factor(eta_bottom)
    out = slab(one(0, 10**log_sigma), 10**log_d, top, bottom, ZERO, thin)
    np.testing.assert_allclose(out.down_r + out.down_t, 1, rtol=1e-12)
    np.testing.assert_allclose(out.up_r + out.up_t, 1, rtol=1e-12)


@settings(max_examples=200, deadline=None)
@given(st.floats(-8, 3), st.floats(-6, 4), st.floats(-4, 4), st.floats(-3, 3))
def test_slab_gives_no_light_away(log_a, log_s, log_d, log_frequency):
    """At every frequency R and T are in [0, 1], R + T <= 1, and the loss carried beside R is 1 - R."""
    s = np.array([[0.0, 10**log_frequency]])
    out = slab(one(10**log_a, 10**log_s), 10**log_d, A, 1.0, s)
    for r, t, loss in ((out.down_r, out.down_t, out.down_loss), (out.up_r, out.up_t, out.up_loss)):
        assert np.isfinite(r).all()
        assert (r >= 0).all()
        assert (t >= 0).all()
        assert (r + t <= 1 + 1e-12).all()
        np.testing.assert_allclose(loss, 1 - r, atol=1e-12)


def test_loss_survives_where_reflectance_rounds_to_one():
    """A thick slab that hardly absorbs: 1 - R keeps the digits of sinh and cosh that subtraction loses."""
    m, d = one(0, 1e4), 1e4
    out = slab(m, d, A, 1.0, ZERO)
    zb0, zbd = m.extrapolation_mm(A)[0], m.extrapolation_mm(1.0)[0]
    assert out.down_loss[0, 0] == pytest.approx((m.free_path_mm[0] + zb0) / (d + zb0 + zbd), rel=1e-12)


def test_thick_slab_is_a_half_space():
    """A slab many diffusion lengths thick reflects as a semi-infinite medium, at every frequency."""
    m, s = one(0.2, 1), np.array([[0.0, 0.3, 5.0]])
    np.testing.assert_allclose(slab(m, 200, A, A, s).down_r, half_space(m, A, s)[0], rtol=1e-12)


def test_nothing_overflows():
    """g L of 1e8 is harmless."""
    out = slab(one(1e2, 1e4), 1e4, A, A, np.array([[0.0, 1e4]]))
    assert np.isfinite(out.down_r).all()
    assert (out.down_t == 0).all()


def test_vanishing_layer_vanishes_and_nothing_jumps():
    """As the thickness goes to 0 all light crosses; between, R changes without a jump."""
    m = one(0.02, 4)
    thickness = np.geomspace(1e-7, 1, 400)
    r = np.array([slab(m, d, 1.0, 1.0, ZERO).down_r[0, 0] for d in thickness])
    assert r[0] < 1e-5
    assert np.abs(np.diff(r)).max() < 0.03
    out = slab(m, 1e-9, A, 1.0, ZERO)
    assert out.down_t[0, 0] == pytest.approx(1, abs=1e-6)
    # from below the air face is still there
    assert out.up_r[0, 0] == pytest.approx((A - 1) / (A + 1), abs=1e-6)


def test_sharp_part_is_the_limit_of_high_frequency():
    """What is left of T at high frequency is the delta, and is zero for layers thicker than the free path."""
    for d, thin in ((0.05, "guarded"), (0.05, "ballistic"), (0.2, "guarded"), (0.8, "guarded")):
        m = one(0.02, 4)
        high = slab(m, d, A, 1.0, np.array([[1e6]]), thin).down_t[0, 0]
        assert high == pytest.approx(sharp_transmittance(m, d, thin)[0], abs=1e-12)


def test_vectors(agrees):
    """Published values of one slab."""
    out = slab(one(0.01, 1), 1, A, A, ZERO)
    agrees("slab_total", [out.down_r[0, 0], out.down_t[0, 0]])
    out = slab(one(0.21, 6), 0.25, A, 1.0, np.array([[0.0, 1.0, 5.0, 40.0]]))
    agrees("slab_hankel_epidermis", [out.down_r[0], out.down_t[0]])
    out = slab(one(0, 2), 3, A, 1.0, ZERO)
    agrees("slab_conservative", [out.down_r[0, 0], out.down_t[0, 0]])
