"""R(mu) of layers: doubling and walks against the closed form, each other, and photons that go the other way."""

import numpy as np
import pytest

from skinbake.profile.chandrasekhar import half_space_reflectance
from skinbake.profile.incidence import NODES, reflect_slanted
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.transport import trace_layers

WALKED = 1e-9  # a g that changes nothing but the way in which R(mu) is found
SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))


@pytest.mark.slow
def test_walks_give_the_closed_form():
    """A tiny part of the medium set apart as a layer of its own makes the walks do what Chandrasekhar's H does."""
    found = reflect_slanted([Layer(SKIN, 0.3, 1.0, WALKED), Layer(SKIN, np.inf, 1.0)], 40_000, 3)
    want = half_space_reflectance(found.cosine[:, None], SKIN.albedo)
    ratio = found.reflectance_rgb / want
    assert np.abs(ratio[8:] - 1).max() < 0.012
    assert np.abs(ratio[1:8] - 1).max() < 0.025
    closed = reflect_slanted([Layer(SKIN, np.inf, 1.0)])
    np.testing.assert_allclose(closed.reflectance_rgb, want)
    np.testing.assert_allclose(found.diffuse_rgb, closed.diffuse_rgb, rtol=0.012)


@pytest.mark.parametrize("g", [0.0, 0.6])
def test_a_beam_along_the_normal_gives_the_total_of_photons(g):
    """Three layers with an index ratio, the top one thinner than its free path."""
    layers = [
        Layer(Medium(np.array([0.21, 0.21, 0.5]), np.array([4.8, 6.0, 6.5])), 0.25, 1.4, g),
        Layer(Medium(np.array([0.016, 0.019, 0.03]), np.array([3.2, 4.0, 4.6])), 0.2, 1.4, g),
        Layer(Medium(np.array([0.0085, 0.1, 2.5]), np.array([0.45, 0.47, 0.48])), np.inf, 1.4),
    ]
    found = reflect_slanted(layers, 32_000)
    photons = trace_layers(layers, 40_000)
    deviation = found.reflectance_rgb[-1] - photons.total_reflectance
    assert np.all(np.abs(deviation) < 3.5 * np.hypot(photons.total_stderr, 0.006 * photons.total_reflectance))
    assert np.all(np.diff(found.reflectance_rgb, axis=0) < 1e-3)  # rises towards grazing


def test_light_from_everywhere_is_the_mean_of_the_slants():
    """2 int R(mu) mu dmu, and it lies between the beam along the normal and the grazing one."""
    found = reflect_slanted([Layer(SKIN, np.inf, 1.4)], 16_000)
    fine = np.linspace(0, 1, 20001)
    mean = [2 * np.trapezoid(np.interp(fine, found.cosine, r) * fine, fine) for r in found.reflectance_rgb.T]
    np.testing.assert_allclose(found.diffuse_rgb, mean, rtol=1e-6)
    assert len(found.cosine) == NODES


def test_the_same_table_on_any_threads():
    """Bit for bit; another seed gives another."""
    layers = [Layer(SKIN, np.inf, 1.3, WALKED)]
    one, three = (reflect_slanted(layers, 320, 4, threads).reflectance_rgb for threads in (1, 3))
    assert np.array_equal(one, three)
    assert not np.array_equal(one, reflect_slanted(layers, 320, 5).reflectance_rgb)


def test_what_it_cannot_do_is_refused():
    """Layers of several indices, where a beam is reflected between them; no walks."""
    with pytest.raises(ValueError, match=r"one index, got 1\.4, 1\.3"):
        reflect_slanted([Layer(SKIN, 1.0, 1.4), Layer(SKIN, np.inf, 1.3)])
    with pytest.raises(ValueError, match="walks"):
        reflect_slanted([Layer(SKIN, np.inf, 1.4)], 0)
