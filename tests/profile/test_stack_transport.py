"""Stacks by doubling: the closed form, walks through layers, and what neither loses nor gains."""

import numpy as np
import pytest

from skinbake.profile.chandrasekhar import half_space_reflectance
from skinbake.profile.incidence import reflect_slanted
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.slab_transport import slab_transport
from skinbake.profile.stack_transport import stack_reflectance
from skinbake.profile.transport import trace_layers

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
DARK = Medium(np.array([0.21, 1.4, 5.0]), np.array([4.8, 6.0, 6.5]))
COSINE = np.linspace(0, 1, 9)


@pytest.mark.parametrize("parts", [(np.inf,), (0.3, np.inf), (0.05, 2.0, np.inf)])
def test_equal_layers_are_a_half_space(parts):
    """However a medium is cut into layers, R(mu) is Chandrasekhar's."""
    found = stack_reflectance([[Layer(SKIN, each, 1.0) for each in parts]], COSINE)[0]
    want = half_space_reflectance(COSINE[:, None], SKIN.albedo)
    np.testing.assert_allclose(found[1:], want[1:], rtol=4e-5)
    np.testing.assert_allclose(found[0], want[0], rtol=5e-4)  # grazing light is that of a cosine of 1e-4


def test_a_dark_layer_above_another_medium_as_walks_say():
    """Two media with an index of 1.4, at every slant but the most grazing ones, of which walks see few."""
    stack = [Layer(DARK, 0.25, 1.4), Layer(SKIN, np.inf, 1.4)]
    walked = reflect_slanted([Layer(DARK, 0.25, 1.4, 1e-9), stack[1]], 32_000)  # without a g nobody walks
    found = stack_reflectance([stack], walked.cosine)[0]
    np.testing.assert_allclose(found[4:], walked.reflectance_rgb[4:], rtol=0.012)


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_what_leaves_by_the_far_face_is_gone(eta):
    """A thin stack along the normal, by photons; the face below reflects, beams too."""
    stack = [Layer(DARK, 0.1, eta), Layer(SKIN, 0.4, eta)]
    photons = trace_layers(stack, 40_000)
    found = stack_reflectance([stack], COSINE)[0, -1]
    assert np.all(np.abs(found - photons.total_reflectance) < 4 * photons.total_error[0])


def test_one_layer_is_that_of_slabs():
    """The other solver's half-space with an index; it has twice as many directions, which are not these."""
    found = stack_reflectance([[Layer(SKIN, np.inf, 1.4)]], np.linspace(0, 1, 17))[0]
    np.testing.assert_allclose(found, slab_transport(SKIN, 1.4, np.array([1.0])).back, rtol=2e-4)


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_nothing_is_lost_where_nothing_absorbs(eta):
    """All comes back of a clear half-space below a clear layer."""
    clear = Medium(np.zeros(1), np.ones(1))
    found = stack_reflectance(
        [[Layer(clear, 0.7, eta), Layer(Medium(np.zeros(1), np.full(1, 3.0)), np.inf, eta)]], COSINE
    )
    np.testing.assert_allclose(found, 1, rtol=2e-5)


def test_stacks_are_solved_as_if_alone():
    """Layers that stacks share change nothing."""
    stacks = [[Layer(DARK, a, 1.4), Layer(b, np.inf, 1.4)] for a in (0.1, 0.3) for b in (SKIN, DARK)]
    together = stack_reflectance(stacks, COSINE)
    for each, stack in zip(together, stacks, strict=True):
        np.testing.assert_array_equal(each, stack_reflectance([stack], COSINE)[0])
    assert len({each.tobytes() for each in together}) == 4


def test_what_it_cannot_do_is_refused():
    """Several indices, an index below 1, and light that scatters forwards."""
    for stack in (
        [Layer(SKIN, 1.0, 1.4), Layer(SKIN, np.inf, 1.3)],
        [Layer(SKIN, np.inf, 0.9)],
        [Layer(SKIN, np.inf, 1.4, 0.5)],
    ):
        with pytest.raises(ValueError, match="one index"):
            stack_reflectance([stack], COSINE)
