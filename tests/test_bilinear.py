"""Images are read between their texels as a GPU reads them."""

import numpy as np
import pytest

from skinbake.bilinear import add_magnified, magnify_bilinear, read_bilinear
from skinbake.stored_precision import as_stored


def test_reading_is_bilinear_and_rounds_to_half():
    """A ramp reads as itself; half rounds it by at most 2^-11."""
    image = np.linspace(0.5, 1, 8, dtype=np.float32)[None, None, :, None] * np.ones((1, 5, 8, 3), np.float32)
    place = np.array([[0.5, 0.31], [0.1, 0.93]])
    want = 0.5 + 0.5 / 7 * (place[:, 1] * 8 - 0.5)
    np.testing.assert_allclose(read_bilinear(image, place)[:, 0], want, rtol=1e-6)
    np.testing.assert_allclose(read_bilinear(image, place, half=True)[:, 0], want, rtol=2**-11)


def test_an_image_is_rounded_to_half_whole_or_not_at_all():
    """As its file: one faint channel keeps the digits of all three; another image is rounded."""
    images = np.random.default_rng(2).random((2, 4, 6, 3), np.float32)
    images[1, ..., 2] *= 1e-4
    place = (np.argwhere(np.ones((4, 6))) + 0.5) / (4, 6)
    read = read_bilinear(images, place, half=True).reshape(24, 2, 3).transpose(1, 0, 2).reshape(images.shape)
    np.testing.assert_array_equal(read, as_stored(images, "half"))


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
