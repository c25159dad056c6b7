"""Images are read between their texels as a GPU reads them."""

import numpy as np

from skinbake.bilinear import read_bilinear


def test_reading_is_bilinear_and_rounds_to_half():
    """A ramp reads as itself; half rounds it by at most 2^-11."""
    image = np.linspace(0.5, 1, 8, dtype=np.float32)[None, None, :, None] * np.ones((1, 5, 8, 3), np.float32)
    place = np.array([[0.5, 0.31], [0.1, 0.93]])
    want = 0.5 + 0.5 / 7 * (place[:, 1] * 8 - 0.5)
    np.testing.assert_allclose(read_bilinear(image, place)[:, 0], want, rtol=1e-6)
    np.testing.assert_allclose(read_bilinear(image, place, half=True)[:, 0], want, rtol=2**-11)
