import numpy as np
import pytest

from skinbake.profile.layers import Layer, stack_response
from skinbake.profile.medium import Medium

ZERO = np.zeros((1, 1))


def layer(sigma_a, sigma_sp, thickness, eta=1.4):
    return Layer(Medium(np.array([float(sigma_a)]), np.array([float(sigma_sp)])), thickness, eta)


TOP, MIDDLE, BOTTOM = layer(0.21, 6, 0.25), layer(0.019, 4, 0.2), layer(0.1, 0.47, np.inf)


def totals(*layers, **kw):
    r, t = stack_response(layers, ZERO, **kw)
    return r[0, 0], t[0, 0]


def test_layers_of_no_thickness_vanish():
    """A layer of 0 mm changes nothing, wherever it lies."""
    empty = layer(5, 5, 0.0, 2.0)
    assert totals(empty, TOP, empty, BOTTOM) == totals(TOP, BOTTOM)


def test_adding_equals_summed_reflections():
    """The closed form is the sum over all round trips of light between two layers."""
    from skinbake.profile.fresnel import boundary_factor
    from skinbake.profile.slab import half_space, slab

    s = np.array([[0.0, 1.7]])
    upper = slab(TOP.medium, 0.25, boundary_factor(1.4), 1.0, s)
    below, _ = half_space(BOTTOM.medium, 1.0, s)
    trips = sum(below * (upper.up_r * below) ** n for n in range(200))
    np.testing.assert_allclose(
        stack_response([TOP, BOTTOM], s)[0], upper.down_r + upper.down_t * trips * upper.up_t, rtol=1e-12
    )


def test_without_absorption_a_stack_loses_nothing():
    """R + T = 1 through three layers of unequal index, thick, thin and very thin."""
    stack = [layer(0, 3, 2.0, 1.4), layer(0, 5, 0.1, 1.33), layer(0, 1, 1e-4, 1.5), layer(0, 40, 5.0, 1.2)]
    assert sum(totals(*stack)) == pytest.approx(1, abs=1e-12)


def test_half_space_below_lets_nothing_through():
    """Over a semi-infinite layer T is 0, and R is 1 where nothing absorbs."""
    assert totals(layer(0, 3, 2.0), layer(0, 1, np.inf)) == (pytest.approx(1, abs=1e-12), 0)


def test_index_of_neighbours_counts():
    """A step of index between layers changes the result, by less than the step to air."""
    stepped = totals(layer(0.1, 3, 1.0, 1.4), layer(0.1, 3, np.inf, 1.5))[0]
    even = totals(layer(0.1, 3, 1.0, 1.4), layer(0.1, 3, np.inf, 1.4))[0]
    assert stepped != even
    assert stepped == pytest.approx(even, rel=0.1)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([layer(1, 1, 0.0)], "above 0"),
        ([BOTTOM, TOP], "only the last"),
        ([layer(1, 1, -1.0)], ">= 0"),
        ([], "at least"),
    ],
)
def test_impossible_stacks_are_refused(layers, message):
    """Nothing at all, an infinite layer above another, a negative thickness."""
    with pytest.raises(ValueError, match=message):
        stack_response(layers, ZERO)


def test_vectors(agrees, three_layers):
    """Published stacks, guarded and continued."""
    agrees("two_layer", stack_response([TOP, layer(0.019, 4, np.inf)], np.array([[0.0, 2.0]]))[0][0])
    agrees("skin3_total_guarded", stack_response(three_layers, ZERO)[0][:, 0])
    agrees("skin3_total", stack_response(three_layers, ZERO, thin="continued")[0][:, 0])
