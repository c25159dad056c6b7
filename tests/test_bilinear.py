"""Images are read between their texels as a GPU reads them."""

import numpy as np
import pytest

from skinbake.bilinear import add_magnified, magnify_bilinear, read_bilinear


def test_reading_is_bilinear_and_rounds_to_half():
    """A ramp reads as itself; half rounds it by at most 2^-11."""
    image = np.linspace(0.5, 1, 8, dtype=np.float32)[None, None, :, None] * np.ones((1, 5, 8, 3), np.float32)
    place = np.array([[0.5, 0.31], [0.1, 0.93]])
    want = 0.5 + 0.5 / 7 * (place[:, 1] * 8 - 0.5)
    np.testing.assert_allclose(read_bilinear(image, place)[:, 0], want, rtol=1e-6)
    np.testing.assert_allclose(read_bilinear(image, place, half=True)[:, 0], want, rtol=2**-11)


@pytest.mark.parametrize("shape", [(7, 5), (14, 10), (20, 5), (3, 9)])
@pytest.mark.parametrize("varies", [False, True])
def test_what_is_added_is_what_is_read_times_a_weight(shape, varies):
    """The same bits as the image at the other size times the weight."""
    rng = np.random.default_rng(4)
    image, out = rng.random((7, 5, 3), np.float32), rng.random((*shape, 3), np.float32)
    weight = rng.random((*(shape if varies else (1, 1)), 3), np.float32)
    want = out + weight * magnify_bilinear(image, shape)
    add_magnified(image, weight, out)
    np.testing.assert_array_equal(out, want)
