"""Doubled layers against closed forms and against photons."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance, half_space_reflectance
from skinbake.profile.incidence import reflect_slanted
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.photons import fresnel
from skinbake.profile.slab_transport import diffuse_mean, slab_transport
from skinbake.profile.transport import trace_layers

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))


def unscattered(medium, thickness_mm, eta, g=0.0):
    """Share of a beam along the normal that passes a slab without an event, its images in the faces included."""
    depth = (medium.sigma_a_per_mm + medium.sigma_sp_per_mm / (1 - g)) * thickness_mm
    back = fresnel.py_func(eta, 1.0, 1.0)[0]
    return (1 - back) * np.exp(-depth) / (1 - (back * np.exp(-depth)) ** 2)


def test_a_half_space_reflects_what_chandrasekhar_says():
    """Equal indices, at every node but the grazing one, and of light from everywhere."""
    found = slab_transport(SKIN, 1.0, np.array([1.0]))
    want = half_space_reflectance(found.cosine[1:, None], SKIN.albedo)
    np.testing.assert_allclose(found.back[1:], want, rtol=1e-6)
    np.testing.assert_allclose(
        diffuse_mean(found.cosine, found.back), half_space_diffuse_reflectance(SKIN.albedo), rtol=5e-4
    )


@pytest.mark.parametrize(("eta", "g"), [(1.4, 0.0), (1.4, 0.8)])
def test_photons_along_the_normal_come_through(eta, g):
    """What leaves below, less what was never scattered, within the photons' noise; and what a half-space sends back."""
    found = slab_transport(SKIN, eta, np.array([0.5, 3.0]), g=g)
    for k, thickness in enumerate((0.5, 3.0)):
        photons = trace_layers([Layer(SKIN, thickness, eta, g)], 20_000)
        want = photons.total_transmittance - unscattered(SKIN, thickness, eta, g)
        assert np.all(np.abs(found.through[k, -1] - want) < 4 * photons.total_error[1] + 2e-3 * want)
    photons = trace_layers([Layer(SKIN, np.inf, eta, g)], 20_000)
    assert np.all(np.abs(found.back[-1] - photons.total_reflectance) < 4 * photons.total_error[0])


def test_slants_come_back_as_walks_say():
    """R(mu) of an index of 1.4 at every second node, by walks against the light."""
    found = slab_transport(SKIN, 1.4, np.array([1.0]))
    walked = reflect_slanted([Layer(SKIN, np.inf, 1.4, 1e-9)], 32_000)  # without a g nobody walks
    np.testing.assert_allclose(found.back[2:], walked.reflectance_rgb[4::2], rtol=0.012)


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_nothing_is_lost_where_nothing_absorbs(eta):
    """A slab without absorption lets through what it does not send back: of 1, T falls to 0 as it gets thicker."""
    clear = Medium(np.zeros(1), np.ones(1))
    thickness = np.geomspace(0.1, 300, 12)
    found = slab_transport(clear, eta, thickness)
    np.testing.assert_allclose(found.back, 1, rtol=2e-3)
    total = found.through[:, -1, 0] + unscattered(clear, thickness, eta)
    assert np.all(np.diff(total) < 0)
    assert total[0] == pytest.approx(1, abs=0.08)
    if eta == 1:  # light that first scatters a free path down, both faces extrapolated by Milne's 0.7104
        for k in (8, 10):
            assert found.through[k, -1, 0] == pytest.approx((1 + 0.7104) / (thickness[k] + 2 * 0.7104), rel=0.03)


def test_what_it_cannot_do_is_refused():
    """An index below that of air, thicknesses that do not ascend."""
    with pytest.raises(ValueError, match="eta"):
        slab_transport(SKIN, 0.9, np.array([1.0]))
    for bad in ([0.0, 1.0], [2.0, 1.0]):
        with pytest.raises(ValueError, match="thickness"):
            slab_transport(SKIN, 1.4, np.array(bad))
