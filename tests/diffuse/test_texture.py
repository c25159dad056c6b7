"""Texture-space blurs equal the exact convolution at any width and cost."""

import numpy as np
import pytest

from skinbake.bilinear import bilinear_texels
from skinbake.diffuse.texture_space.blur import (
    blur_at,
    level_size,
    mean_mm_per_texel,
    stored_variance,
    texture_blur,
    texture_pyramid,
    widest_level,
)
from tests.diffuse.exact import fft_blur
from tests.shapes import quad


def _light(height, width):
    rng = np.random.default_rng(1)
    light = rng.random((1, height, width, 3)).astype(np.float32)
    light[0, : height // 2] *= 0.1
    light[0, ..., 1] = np.add.outer(np.arange(height), np.arange(width)) % 64 < 32
    light[0, ..., 2] = 0
    light[0, height // 3, width // 4, 2] = 1
    return light


@pytest.mark.parametrize("shape", [(96, 224), (90, 130), (71, 53)])
@pytest.mark.parametrize("sigma", [0.05, 0.3, 1, 2.1, 3.3, 5.7, 17, 60, 500])
def test_equals_the_exact_convolution(shape, sigma):
    """Within 1e-3 of the range, for noise, a hard edge and an impulse, at each stored texel: of what reading leaves."""
    light = _light(*shape)
    t = (sigma**2, (0.8 * sigma) ** 2)
    pyramid = texture_pyramid(light, np.ones(shape, np.float32))
    level = widest_level(t)
    got = texture_blur(pyramid, t, level)[0]
    held = stored_variance(t, level)
    image = np.concatenate([light[0], np.ones((*shape, 1))], axis=2)
    rows, columns = level_size(shape, level)
    worst = 0.0
    for i in range(rows):
        y = (i + 0.5) * shape[0] / rows - 0.5
        if i % max(1, rows // 12):
            continue
        line = fft_blur(image, t, (y - int(y), 0.0))[int(y)] if level == 0 else None
        for j in range(0, columns, max(1, columns // 12)):
            x = (j + 0.5) * shape[1] / columns - 0.5
            exact = line[j] if line is not None else _at(image, held, y, x, t)
            worst = max(worst, np.abs(got[i, j] - exact[:3] / exact[3]).max())
    assert worst < 1e-3


def _at(image, t, y, x, fourth):
    """One value of the exact blur between texels: continuous Gaussians, which wide discrete ones are."""
    height, width = image.shape[:2]
    wy = np.exp(-((np.arange(height) - y) ** 2) / (2 * t[0])) / np.sqrt(2 * np.pi * t[0])
    wx = np.exp(-((np.arange(width) - x) ** 2) / (2 * t[1])) / np.sqrt(2 * np.pi * t[1])
    # Fourth cumulant of the discrete Gaussian, to first order: t/24 times the fourth derivative
    for w, n, centre, v, four in (
        (wy, np.arange(height), y, t[0], fourth[0]),
        (wx, np.arange(width), x, t[1], fourth[1]),
    ):
        z = (n - centre) / np.sqrt(v)
        w *= 1 + four * (z**4 - 6 * z**2 + 3) / (24 * v * v)
    return np.einsum("i,ijc,j->c", wy, image, wx)


def test_a_wide_blur_of_a_wave_is_the_continuous_one():
    """exp(-v k^2 / 2) of the amplitude, far from the border."""
    x = np.arange(512)
    k = 2 * np.pi / 64
    light = np.broadcast_to(0.5 + 0.4 * np.cos(k * x)[None, None, :, None], (1, 96, 512, 3)).astype(np.float32)
    pyramid = texture_pyramid(np.ascontiguousarray(light), np.ones((96, 512), np.float32))
    got = texture_blur(pyramid, (81.0, 81.0), 2)[0, 12, :, 0]
    at = (np.arange(128) + 0.5) * 4 - 0.5
    want = 0.5 + 0.4 * np.exp(-(81 - 16 / 6) * k**2 / 2) * np.cos(k * at)  # reading adds a tent's variance
    np.testing.assert_allclose(got[20:-20], want[20:-20], atol=2e-4)


@pytest.mark.parametrize("sigma", [2.4, 4.0, 9.0])
def test_read_between_its_texels_a_smaller_size_shows_the_lobe(sigma):
    """theory.md 5.2: half the error, or less, that the same lobe has with all of its variance in the texels."""
    light = np.random.default_rng(5).random((1, 128, 128, 3)).astype(np.float32)
    pyramid, t, level = texture_pyramid(light, np.ones((128, 128), np.float32)), (sigma**2,) * 2, 1
    row, col = (np.random.default_rng(k).uniform(0.2, 0.8, 3000) for k in (6, 7))
    flat, weight = bilinear_texels(np.stack([row, col], axis=1), 64, 64)
    whole = tuple(2 * v - held for v, held in zip(t, stored_variance(t, level), strict=True))

    def read(variance):
        image = texture_blur(pyramid, variance, level)[0].reshape(-1, 3)
        return np.einsum("pkc,pk->pc", image[flat], weight)

    want, _ = blur_at(pyramid, t, level, (row * 64 - 0.5, col * 64 - 0.5))
    off, off_whole = (np.sqrt(np.mean((read(v) - want) ** 2)) for v in (t, whole))
    assert off < (0.52 if sigma > 3 else 0.65) * off_whole


@pytest.mark.parametrize("level", [0, 1, 2])
def test_constant_light_stays_constant_on_any_coverage(level):
    """To 1e-5, holes and partly covered texels included."""
    rng = np.random.default_rng(2)
    coverage = (rng.random((75, 130)) > 0.6).astype(np.float32) * rng.random((75, 130)).astype(np.float32)
    light = np.full((2, 75, 130, 3), 3.7, np.float32)
    got = texture_blur(texture_pyramid(light, coverage), (50.0, 50.0), level)
    np.testing.assert_allclose(got[got > 0], 3.7, rtol=1e-5)


def test_what_lies_in_the_gutter_does_not_bleed():
    """An infinite gutter texel changes nothing."""
    light = np.ones((1, 20, 31, 3), np.float32)
    light[0, :, 16:] = np.inf
    coverage = np.zeros((20, 31), np.float32)
    coverage[:, :16] = 1
    got = texture_blur(texture_pyramid(light, coverage), (2.0, 2.0))
    np.testing.assert_allclose(got[0, :, :16], 1, rtol=1e-5)


def test_without_coverage_in_reach_the_fallback_stands():
    """theory.md 5.7: K[M] = 0 keeps E."""
    light = np.full((1, 9, 60, 3), 2.0, np.float32)
    coverage = np.zeros((9, 60), np.float32)
    coverage[:, :5] = 1
    got = texture_blur(texture_pyramid(light, coverage), (0.5, 0.5), 0, light)
    np.testing.assert_array_equal(got[0, :, 40:], 2)


def test_one_texel_is_its_own_blur():
    """Sizes of one in either direction."""
    for shape in ((1, 1), (1, 40), (37, 1)):
        light = np.full((1, *shape, 3), 0.25, np.float32)
        for sigma in (0.01, 1.0, 1000.0):
            t = (sigma**2, sigma**2)
            got = texture_blur(texture_pyramid(light, np.ones(shape, np.float32)), t, widest_level(t))
            np.testing.assert_allclose(got, 0.25, rtol=1e-5)


def test_mm_per_texel_of_a_quad_is_its_own():
    """A 200 x 50 mm quad at 100 x 40 texels: 2 mm along u, 1.25 mm along v."""
    assert mean_mm_per_texel(quad(200, 50), (40, 100)) == pytest.approx((1.25, 2.0))
