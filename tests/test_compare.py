import numpy as np
import pytest

from skinbake.compare import Tolerance, compare, read_at

IMAGE = np.linspace(0, 1, 7 * 5 * 3).reshape(7, 5, 3)


def test_an_image_is_the_same_as_itself():
    """Equal arrays leave nothing over."""
    found = compare(IMAGE, IMAGE, Tolerance(0, 0))
    assert found.same
    assert (found.rms, found.max_absolute, found.over) == (0, 0, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("side", [0, 1, 2])
def test_what_is_not_finite_never_passes(value, side):
    """A NaN on either side fails, and on both sides too: two broken images do not agree."""
    pair = [IMAGE.copy(), IMAGE.copy()]
    for image in pair if side == 2 else [pair[side]]:
        image[3, 2, 1] = value
    found = compare(*pair, Tolerance(1e9, 1e9, 1.0, 1e9))
    assert not found.same
    assert found.worst_at == (3, 2, 1)


def test_a_share_may_differ_a_little_and_none_by_much():
    """`allowed` counts values, `worst` bounds each of them."""
    image = IMAGE + 0.0
    image[0, 0, 0] += 0.02
    assert not compare(image, IMAGE, Tolerance(0.01, 0, allowed=0, worst=3)).same
    assert compare(image, IMAGE, Tolerance(0.01, 0, allowed=0.01, worst=3)).same
    image[0, 0, 0] += 0.02
    assert not compare(image, IMAGE, Tolerance(0.01, 0, allowed=0.01, worst=3)).same


def test_limits_grow_with_the_reference():
    """A relative limit leaves bright values room and black ones none."""
    assert compare(np.array([100.5, 0.0]), np.array([100.0, 0.0]), Tolerance(0, 0.01)).same
    assert not compare(np.array([100.0, 0.5]), np.array([100.0, 0.0]), Tolerance(0, 0.01)).same


def test_figures_are_also_shares_of_the_reference():
    """Rms of its rms, the largest of its largest value; of a black one nothing, or without end."""
    found = compare(np.array([3.0, 4.5, 0.0]), np.array([3.0, 4.0, 0.0]), Tolerance())
    assert found.relative_rms == pytest.approx(0.1)
    assert found.max_relative == pytest.approx(0.125)
    black = compare(np.array([1.0]), np.array([0.0]), Tolerance())
    assert (black.relative_rms, black.max_relative) == (np.inf, np.inf)
    assert compare(np.zeros(3), np.zeros(3), Tolerance()).relative_rms == 0


def test_shapes_must_agree():
    """No broadcasting: a row is not an image."""
    assert "shape" in compare(IMAGE[:1], IMAGE, Tolerance()).why


def test_reading_at_another_size_keeps_a_plane():
    """A linear ramp is linear at any size away from the border, and at its own size nothing changes."""
    u = (np.arange(12) + 0.5) / 12
    v = (np.arange(9) + 0.5) / 9
    plane = (2 * u[None, :, None] + 3 * v[:, None, None] + np.arange(3)).astype(np.float32)
    np.testing.assert_array_equal(read_at(plane, 9, 12), plane)
    u2, v2 = (np.arange(30) + 0.5) / 30, (np.arange(21) + 0.5) / 21
    want = 2 * u2[None, :, None] + 3 * v2[:, None, None] + np.arange(3)
    inner = np.s_[2:-2, 2:-2]
    np.testing.assert_allclose(read_at(plane, 21, 30)[inner], want[inner], rtol=1e-6)
