"""Separable blurs of interleaved images, both passes on one block of rows while it is in cache."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, broadcast, load, mul_add, store
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Zeros

_ROWS = 16
_CHUNK = 64  # rows that share their scratch memory
_STRIP = 512
_ZERO = np.float32(0)


def masked_light(
    light: NDArray[np.float32], coverage: NDArray[np.float32], zeros: Zeros = np.zeros
) -> NDArray[np.float32]:
    """Light times coverage, then coverage itself; (H, W, 3 L + 1).

    Parameters
    ----------
    light : ndarray of shape (L, H, W, 3), float32
    coverage : ndarray of shape (H, W), float32
    zeros : callable, optional
        Makes the array.
    """
    lights, height, width, _ = light.shape
    out = zeros((height, width, 3 * lights + 1), np.float32)
    parallel_for(_mask, height, light, coverage, out)
    return out


@kernel
def _mask(first, stop, light, coverage, out):  # type: ignore[no-untyped-def]
    """`masked_light` of rows `first` to `stop`."""
    lights, _, width, _ = light.shape
    for row in range(first, stop):
        for col in range(width):
            m = coverage[row, col]
            for k in range(lights):
                for c in range(3):
                    # Not m * light: gutter texels hold light that no sum may see, even an infinite one
                    out[row, col, 3 * k + c] = m * light[k, row, col, c] if m > 0 else np.float32(0)
            out[row, col, 3 * lights] = m


def normalised_blur(
    image: NDArray[np.float32],
    margin: int,
    half_y: NDArray[np.float32],
    half_x: NDArray[np.float32],
    fallback: NDArray[np.float32],
    epsilon: float,
    out: NDArray[np.float32],
    mass: NDArray[np.float32],
) -> None:
    """K[M E] / K[M] of an image of premultiplied light and mask; theory.md 5.7.

    Parameters
    ----------
    image : ndarray of shape (H + 2 margin, W + 2 margin, 3L + 1), float32
        Outside it there is no coverage.
    margin : int
        Texels around what is written.
    half_y, half_x : ndarray, float32
        Symmetric kernels from their middle on.
    fallback : ndarray of shape (L, H, W, 3) or (L, 0, 0, 3)
        What stands where K[M] <= epsilon; zero if empty.
    epsilon : float
    out : ndarray of shape (L, H, W, 3)
    mass : ndarray of shape (H, W) or (0, 0)
        Takes K[M], unless empty.
    """
    kernel_y, kernel_x = (np.concatenate((half[:0:-1], half)) for half in (half_y, half_x))
    chunks = -(-out.shape[1] // _CHUNK)
    blur = _Blur(kernel_y, kernel_x, fallback, np.float32(epsilon))
    parallel_for(_blur, chunks, image, margin, blur, out, mass)


class _Blur(NamedTuple):
    """A blur of both axes.

    Attributes
    ----------
    kernel_y, kernel_x : ndarrays, float32
        Whole, of odd lengths.
    fallback : ndarray of shape (L, H, W, 3) or (L, 0, 0, 3), float32
    epsilon : float32
        As in `normalised_blur`.
    """

    kernel_y: NDArray[np.float32]
    kernel_x: NDArray[np.float32]
    fallback: NDArray[np.float32]
    epsilon: np.float32


@kernel
def _blur(first, stop, image, margin, blur, out, mass):  # type: ignore[no-untyped-def]
    """`normalised_blur` of chunks of `_CHUNK` rows.

    Parameters
    ----------
    first, stop : int
        Chunks.
    image : ndarray of shape (H + 2 margin, W + 2 margin, 3L + 1), float32
    margin : int
    blur : _Blur
    out : ndarray of shape (L, H, W, 3), float32
        Written.
    mass : ndarray of shape (H, W) or (0, 0), float32
        Written, unless empty.
    """
    kernel_y, kernel_x, fallback, epsilon = blur.kernel_y, blur.kernel_x, blur.fallback, blur.epsilon
    height, width, channels = image.shape
    lights = (channels - 1) // 3
    n = width * channels
    reach_y, reach_x = len(kernel_y) // 2, len(kernel_x) // 2
    flat = image.reshape(-1)
    start = reach_x * channels
    length = n + 2 * start
    for chunk in range(first, stop):
        lines = np.zeros(_ROWS * length, np.float32)
        both = np.empty(n, np.float32)
        for top_row in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, out.shape[1]), _ROWS):
            rows = min(_ROWS, out.shape[1] - top_row)
            for left in range(0, n, _STRIP):  # so narrow that all taps' rows of it stay in the nearest cache
                for i in range(rows):
                    top = top_row + i + margin - reach_y
                    begin, end = max(-top, 0), min(len(kernel_y), height - top)
                    to, count = i * length + start + left, min(_STRIP, n - left)
                    _weigh(flat, (top + begin) * n + left, n, kernel_y[begin:end], lines, to, count)
            for i in range(rows):
                _weigh(lines, i * length, channels, kernel_x, both, np.int64(0), n)
                _divide(both, margin, lights, top_row + i, epsilon, fallback, out)
                if len(mass):
                    for col in range(mass.shape[1]):
                        mass[top_row + i, col] = both[(col + margin + 1) * channels - 1]


@kernel
def _divide(both, margin, lights, row, epsilon, fallback, out):  # type: ignore[no-untyped-def]
    """Write a row of blurred light, divided by the blurred mask, or what stands in its place.

    Parameters
    ----------
    both : ndarray, float32
        Blurred light and mask of the row with its margins, flat.
    margin, lights, row : int
    epsilon, fallback, out
        As in `normalised_blur`.
    """
    channels = 3 * lights + 1
    if lights == 1:  # constant strides: the compiler shuffles whole registers
        to, width = out[0, row].reshape(-1), out.shape[2]
        here = both[margin * 4 : (margin + width) * 4]
        bare = False
        for col in range(width):
            mass = here[4 * col + 3]
            covered = mass > epsilon
            inverse = np.float32(1) / mass if covered else _ZERO
            to[3 * col] = here[4 * col] * inverse
            to[3 * col + 1] = here[4 * col + 1] * inverse
            to[3 * col + 2] = here[4 * col + 2] * inverse
            bare |= not covered
        if not bare:
            return
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


@kernel(inner=True)
def _weigh(source, start, stride, weights, to, at, count):  # type: ignore[no-untyped-def]
    """to[at + i] = sum_k weights[k] source[start + k stride + i] for i < count, all flat.

    Parameters
    ----------
    source : ndarray, float32
    start, stride : int
    weights, to : ndarrays, float32
    at, count : int
    """
    i = 0
    while i + 4 * LANES <= count:  # four sums at once, as each waits for its last multiply-add
        a, b, c, d = broadcast(_ZERO), broadcast(_ZERO), broadcast(_ZERO), broadcast(_ZERO)
        here = start + i
        for k in range(len(weights)):
            w = weights[k]
            a = mul_add(w, load(source, here), a)
            b = mul_add(w, load(source, here + LANES), b)
            c = mul_add(w, load(source, here + 2 * LANES), c)
            d = mul_add(w, load(source, here + 3 * LANES), d)
            here += stride
        store(to, at + i, a)
        store(to, at + i + LANES, b)
        store(to, at + i + 2 * LANES, c)
        store(to, at + i + 3 * LANES, d)
        i += 4 * LANES
    while i < count:
        total = _ZERO
        for k in range(len(weights)):
            total = mul_add(weights[k], source[start + k * stride + i], total)
        to[at + i] = total
        i += 1


def decimate(
    image: NDArray[np.float32],
    first_y: NDArray[np.int64],
    weight_y: NDArray[np.float32],
    first_x: NDArray[np.int64],
    weight_x: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """out[i, j] = sum over weights of image[first_y[i] + k, first_x[j] + l]; outside the image is zero.

    Parameters
    ----------
    image : ndarray of shape (H, W, C), float32
    first_y, first_x : ndarray of shape (h,), (w,), int64
    weight_y, weight_x : ndarray of shape (h, taps), (w, taps), float32
    out : ndarray of shape (h, w, C), float32
        Written.
    """
    halves = _Halves(*(np.ascontiguousarray(weight_x[0, side::2]) for side in (0, 1)))
    rows, cols = _Taps(first_y, weight_y), _Taps(first_x, weight_x)
    parallel_for(_decimate, -(-len(out) // _ROWS), image, rows, cols, halves, out)


class _Taps(NamedTuple):
    """Weights along one axis.

    Attributes
    ----------
    first : ndarray of shape (n,), int64
        First row, or column, that each output takes; may lie outside the image.
    weight : ndarray of shape (n, taps), float32
    """

    first: NDArray[np.int64]
    weight: NDArray[np.float32]


class _Halves(NamedTuple):
    """Every other weight of the first column, from the first one and from the second one on."""

    even: NDArray[np.float32]
    odd: NDArray[np.float32]


@kernel
def _decimate(first, stop, image, taps_y, taps_x, halves, out):  # type: ignore[no-untyped-def]
    """`decimate` of blocks of `_ROWS` rows: along y into lines in the nearest caches, then along x.

    Parameters
    ----------
    first, stop : int
        Blocks of rows of `out`.
    image : ndarray of shape (H, W, C), float32
    taps_y, taps_x : _Taps
    halves : _Halves
    out : ndarray of shape (h, w, C), float32
        Written.
    """
    first_y, weight_y, first_x, weight_x = taps_y.first, taps_y.weight, taps_x.first, taps_x.weight
    weight_even, weight_odd = halves.even, halves.odd
    height, width, channels = image.shape
    n = width * channels
    flat = image.reshape(-1)
    taps = weight_x.shape[1]
    pad = taps * channels
    columns = out.shape[1]
    # An even texture is halved with the same weights everywhere: even and odd columns apart, whole rows are summed
    halved = columns > 1 and first_x[columns - 1] - first_x[0] == 2 * (columns - 1)
    length = n + 2 * pad
    for chunk in range(first, stop):
        top_row, rows = chunk * _ROWS, min(_ROWS, out.shape[0] - chunk * _ROWS)
        lines = np.zeros(_ROWS * length, np.float32)
        parts = np.zeros((2, (columns + (taps + 1) // 2) * channels), np.float32)
        odd = np.empty(columns * channels, np.float32)
        for left in range(0, n, _STRIP):
            for i in range(rows):
                top = first_y[top_row + i]
                begin, end = max(-top, 0), min(weight_y.shape[1], height - top)
                if begin < end:
                    weights = weight_y[top_row + i, begin:end]
                    to, count = i * length + pad + left, min(_STRIP, n - left)
                    _weigh(flat, (top + begin) * n + left, n, weights, lines, to, count)
        for i in range(rows):
            whole = out[top_row + i].reshape(columns * channels)
            if halved:
                line = lines[i * length + pad : i * length + pad + n]
                for m in range(parts.shape[1] // channels):
                    for side in range(2):
                        col = first_x[0] + 2 * m + side
                        if 0 <= col < width:
                            for c in range(channels):
                                parts[side, m * channels + c] = line[col * channels + c]
                none = np.int64(0)
                _weigh(parts[0], none, channels, weight_even, whole, none, columns * channels)
                _weigh(parts[1], none, channels, weight_odd, odd, none, columns * channels)
                for k in range(columns * channels):
                    whole[k] += odd[k]
                continue
            for j in range(columns):
                start = i * length + pad + min(max(first_x[j], -taps), width) * channels
                _weigh(lines, start, channels, weight_x[j], whole, j * channels, channels)


def decimation_weights(
    size: int, smaller: int, margin: int, smaller_margin: int, variance_texels2: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Gaussian of a given variance around each texel centre of a smaller size.

    Parameters
    ----------
    size, smaller : int
        Texels along the axis.
    margin, smaller_margin : int
        Texels around each.
    variance_texels2 : float
        In texels of `size`.

    Returns
    -------
    first : ndarray of shape (smaller + 2 smaller_margin,), int64
        First texel that has a weight, margin included.
    weight : ndarray of shape (smaller + 2 smaller_margin, taps), float32
        Of sum 1.
    """
    centre = (np.arange(-smaller_margin, smaller + smaller_margin) + 0.5) * (size / smaller) - 0.5 + margin
    reach = np.sqrt(-2 * variance_texels2 * np.log(1e-7))
    first = np.ceil(centre - reach).astype(np.int64)
    taps = int(np.ceil(2 * reach)) + 1
    offset = first[:, None] + np.arange(taps)[None, :] - centre[:, None]
    weight = np.exp(-(offset**2) / (2 * variance_texels2))
    return first, (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)
