"""Separable blurs of interleaved images, both passes on one block of rows while it is in cache."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_ROWS = 32
_RUN = 512


@njit(cache=True, parallel=True)
def masked_light(light, coverage, out):  # type: ignore[no-untyped-def]
    """out (H, W, 3L + 1) = light (L, H, W, 3) times coverage, then coverage itself."""
    lights, height, width, _ = light.shape
    for row in prange(height):
        for col in range(width):
            m = coverage[row, col]
            for k in range(lights):
                for c in range(3):
                    # Not m * light: gutter texels hold light that no sum may see, even an infinite one
                    out[row, col, 3 * k + c] = m * light[k, row, col, c] if m > 0 else np.float32(0)
            out[row, col, 3 * lights] = m


@njit(cache=True, parallel=True)
def normalised_blur(image, margin, half_y, half_x, fallback, epsilon, out):  # type: ignore[no-untyped-def]
    """K[M E] / K[M] of an image of premultiplied light and mask; THEORY (5.7).

    Parameters
    ----------
    image : ndarray of shape (H + 2 margin, W + 2 margin, 3L + 1), float32
        Outside it there is no coverage.
    half_y, half_x : ndarray, float32
        Symmetric kernels from their middle on.
    fallback : ndarray of shape (L, H, W, 3) or (L, 0, 0, 3)
        What stands where K[M] <= epsilon; zero if empty.
    out : ndarray of shape (L, H, W, 3)
    """
    height, width, channels = image.shape
    lights = (channels - 1) // 3
    n = width * channels
    reach_y, reach_x = len(half_y) - 1, len(half_x) - 1
    flat = image.reshape(height, n)
    for block in prange((out.shape[1] + _ROWS - 1) // _ROWS):
        line = np.zeros(n + 2 * reach_x * channels, np.float32)
        both = np.empty(n, np.float32)
        nothing = np.zeros(n, np.float32)
        start = reach_x * channels
        for row in range(block * _ROWS, min(block * _ROWS + _ROWS, out.shape[1])):
            _column_pass(flat, row + margin, half_y, reach_y, height, n, nothing, line, start)
            _row_pass(line, half_x, reach_x, channels, n, start, both)
            for col in range(out.shape[2]):
                base = (col + margin) * channels
                mass = both[base + channels - 1]
                if mass > epsilon:
                    inverse = np.float32(1) / mass
                    for k in range(lights):
                        for c in range(3):
                            out[k, row, col, c] = both[base + 3 * k + c] * inverse
                elif fallback.shape[1] > 0:
                    for k in range(lights):
                        for c in range(3):
                            out[k, row, col, c] = fallback[k, row, col, c]
                else:
                    for k in range(lights):
                        for c in range(3):
                            out[k, row, col, c] = np.float32(0)


@njit(cache=True)
def _column_pass(flat, row, half, reach, height, n, nothing, line, start):  # type: ignore[no-untyped-def]
    for left in range(0, n, _RUN):
        right = min(left + _RUN, n)
        acc = line[start + left : start + right]
        here = flat[row, left:right]
        h = half[0]
        for i in range(right - left):
            acc[i] = h * here[i]
        k = 1
        while k <= reach:
            # Two taps at a time: the sums stay in registers for longer
            k2 = min(k + 1, reach)
            h1, h2 = half[k], (half[k2] if k2 > k else np.float32(0))
            a1 = flat[row - k, left:right] if row - k >= 0 else nothing[left:right]
            b1 = flat[row + k, left:right] if row + k < height else nothing[left:right]
            a2 = flat[row - k2, left:right] if row - k2 >= 0 else nothing[left:right]
            b2 = flat[row + k2, left:right] if row + k2 < height else nothing[left:right]
            for i in range(right - left):
                acc[i] += h1 * (a1[i] + b1[i]) + h2 * (a2[i] + b2[i])
            k += 2


@njit(cache=True)
def _row_pass(line, half, reach, channels, n, start, both):  # type: ignore[no-untyped-def]
    for left in range(0, n, _RUN):
        right = min(left + _RUN, n)
        acc = both[left:right]
        here = line[start + left : start + right]
        h = half[0]
        for i in range(right - left):
            acc[i] = h * here[i]
        k = 1
        while k <= reach:
            k2 = min(k + 1, reach)
            h1, h2 = half[k], (half[k2] if k2 > k else np.float32(0))
            a1 = line[start + left - k * channels : start + right - k * channels]
            b1 = line[start + left + k * channels : start + right + k * channels]
            a2 = line[start + left - k2 * channels : start + right - k2 * channels]
            b2 = line[start + left + k2 * channels : start + right + k2 * channels]
            for i in range(right - left):
                acc[i] += h1 * (a1[i] + b1[i]) + h2 * (a2[i] + b2[i])
            k += 2


@njit(cache=True, parallel=True)
def decimate(image, first_y, weight_y, first_x, weight_x, out):  # type: ignore[no-untyped-def]
    """out[i, j] = sum over weights of image[first_y[i] + k, first_x[j] + l]; outside the image is zero.

    Parameters
    ----------
    first_y, first_x : ndarray of shape (h,), (w,), int64
    weight_y, weight_x : ndarray of shape (h, taps), (w, taps), float32
    """
    height, width, channels = image.shape
    n = width * channels
    flat = image.reshape(height, n)
    taps = weight_x.shape[1]
    pad = taps * channels
    columns = out.shape[1]
    # An even texture is halved with the same weights everywhere: even and odd columns apart, whole rows are summed
    halved = columns > 1 and first_x[columns - 1] - first_x[0] == 2 * (columns - 1)
    for i in prange(out.shape[0]):
        line = np.zeros(n + 2 * pad, np.float32)
        middle = line[pad : pad + n]
        for k in range(weight_y.shape[1]):
            row = first_y[i] + k
            if 0 <= row < height:
                h = weight_y[i, k]
                here = flat[row]
                for p in range(n):
                    middle[p] += h * here[p]
        if halved:
            length = (columns + taps) * channels
            parts = np.zeros((2, length), np.float32)
            for m in range(columns + taps):
                for side in range(2):
                    col = first_x[0] + 2 * m + side
                    if 0 <= col < width:
                        for c in range(channels):
                            parts[side, m * channels + c] = middle[col * channels + c]
            whole = out[i].reshape(columns * channels)
            for k in range(taps):
                h = weight_x[0, k]
                part = parts[k % 2, k // 2 * channels : (k // 2 + columns) * channels]
                for p in range(columns * channels):
                    whole[p] += h * part[p]
            continue
        for j in range(columns):
            to = out[i, j]
            first = min(max(first_x[j], -taps), width)
            for k in range(taps):
                h = weight_x[j, k]
                base = pad + (first + k) * channels
                for c in range(channels):
                    to[c] += h * line[base + c]


def decimation_weights(
    size: int, smaller: int, margin: int, smaller_margin: int, variance_texels2: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Gaussian of a given variance (texels of `size`) around each texel centre of `smaller`; both with margins."""
    centre = (np.arange(-smaller_margin, smaller + smaller_margin) + 0.5) * (size / smaller) - 0.5 + margin
    reach = np.sqrt(-2 * variance_texels2 * np.log(1e-7))
    first = np.ceil(centre - reach).astype(np.int64)
    taps = int(np.ceil(2 * reach)) + 1
    offset = first[:, None] + np.arange(taps)[None, :] - centre[:, None]
    weight = np.exp(-(offset**2) / (2 * variance_texels2))
    return first, (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)
