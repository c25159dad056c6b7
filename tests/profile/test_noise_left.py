"""Noise of the light, once it is scattered."""

import numpy as np

from skinbake.profile import GaussianSum
from skinbake.profile.noise_left import noise_left


def test_noise_left_is_that_of_blurred_noise():
    """White noise on a lattice of 0.5 mm, blurred by Gaussians of a texel and more: to 2 %; all of it where none is."""
    skin = GaussianSum(np.array([0.5, 4.0]), np.array([[0.8, 0.5, 0.1], [0.2, 0.3, 0.9]]), np.zeros(3), np.ones(3))
    k = np.fft.fftfreq(512, 0.5)
    squared = (2 * np.pi) ** 2 * (k[:, None] ** 2 + k[None, :] ** 2)
    kernel = np.exp(-squared[..., None] * skin.variance_mm2 / 2) @ skin.weight_rgb
    noise = np.fft.fft2(np.random.default_rng(1).normal(size=(512, 512)))
    blurred = np.fft.ifft2(noise[..., None] * kernel, axes=(0, 1)).real
    got = noise_left(skin, [4.0, 0.0])
    # A texel is a square, not a point: that counts as a variance of 1 / (2 pi) of a texel more
    np.testing.assert_allclose(got[0], np.sqrt((blurred**2).mean(axis=(0, 1))), rtol=0.05)
    np.testing.assert_allclose(got[1], skin.weight_rgb.sum(axis=0))
