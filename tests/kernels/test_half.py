import numpy as np
import pytest

from skinbake.kernels.half import as_half, as_half_with_sum, largest_bits

HALVES = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32)  # every finite one above or equal 0


def bits(half):
    return half.view(np.uint16)


@pytest.mark.filterwarnings("ignore:overflow")
def test_every_float_is_rounded_as_numpy_rounds_it():
    """Every half, the ties between two and what lies beside them, both signs; and floats from the whole range."""
    ties = (HALVES[1:] + HALVES[:-1]) / 2
    beside = [np.nextafter(ties, np.float32(to)) for to in (0, np.inf)]
    limits = np.array([65504, 65519.99, 65520, 65536, 1e30, np.inf, 1e-45, 2**-25, 2**-26], np.float32)
    spread = np.arange(0, 0x7F800000, 4099, dtype=np.uint32).view(np.float32)
    values = np.concatenate([HALVES, ties, *beside, limits, spread])
    for signed in (values, -values):
        np.testing.assert_array_equal(bits(as_half(signed)), bits(signed.astype(np.float16)))
    assert np.isnan(as_half(np.array([np.nan, -np.nan], np.float32))).all()


def test_views_of_any_shape_come_back_contiguous():
    """Turned, strided, one texel, none."""
    image = np.random.default_rng(3).random((7, 11, 3), dtype=np.float32)
    for view in (image, image[::-1, ::2], image[..., 1].T, image[:1, :1], image[:0]):
        half = as_half(view)
        assert half.flags.c_contiguous
        np.testing.assert_array_equal(half, view.astype(np.float16))


def test_images_are_rounded_and_summed_as_numpy_does_it(monkeypatch):
    """The sum is taken in float32 and in the images' order before it is rounded, wherever threads cut it."""
    random = np.random.default_rng(4)
    for count, share in ((1, 100), (3, 7000), (5, 2**20)):
        monkeypatch.setattr("skinbake.kernels.half._SHARE", share)
        images = (random.normal(size=(count, 53, 97, 3)) * 10.0 ** random.uniform(-6, 4, 3)).astype(np.float32)
        half, total = np.empty(images.shape, np.float16), np.empty(images.shape[1:], np.float16)
        as_half_with_sum(images, half, total)
        np.testing.assert_array_equal(bits(half), bits(images.astype(np.float16)))
        np.testing.assert_array_equal(bits(total), bits(images.sum(axis=0, dtype=np.float32).astype(np.float16)))


def test_the_largest_magnitude_is_found_whatever_its_sign():
    """In any row, channel by channel; a NaN is more than infinity, and nothing is 0."""
    half = np.random.default_rng(5).normal(size=(71, 13, 4)).astype(np.float16)
    half[70, 12, 1], half[33, 0, 2], half[0, 5, 3] = -200, np.nan, -np.inf
    found = largest_bits(half).view(np.float16)
    np.testing.assert_array_equal(found[:2], np.abs(half[..., :2]).max(axis=(0, 1)))
    assert np.isnan(found[2])
    assert found[3] == np.inf
    assert not largest_bits(half[:0]).any()
