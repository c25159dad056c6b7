"""Arithmetic with its edge cases decided once; nothing here knows of skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import gcd
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Number = TypeVar("Number", bound=np.number[Any])
Float = NDArray[np.float64]
Zeros = Callable[[tuple[int, ...], DTypeLike], NDArray[Any]]  # `np.zeros`, or another place for large arrays


def sqr(x: ArrayLike) -> Float:
    """x * x."""
    x = np.asarray(x, dtype=np.float64)
    return x * x


def safe_div(num: ArrayLike, den: ArrayLike) -> Float:
    """num / den, and 0 where den is 0: an uncovered texel holds no light, not NaN."""
    num, den = np.broadcast_arrays(np.asarray(num, dtype=np.float64), np.asarray(den, dtype=np.float64))
    return np.divide(num, den, out=np.zeros(num.shape), where=den != 0)


def norm_of_all(values: ArrayLike) -> float:
    """Root of the sum of all squares, added in an order that is the same whatever the number of BLAS's threads.

    `np.linalg.norm` has BLAS multiply an array with itself, which divides a long one among threads.
    """
    values = np.asarray(values, dtype=np.float64)
    return float(np.sqrt(np.sum(values * values)))


def largest_channel(image: NDArray[Number]) -> NDArray[Number]:
    """Largest of three channels, (...) of (..., 3): by planes, a tenth of what NumPy's `max` takes."""
    return np.maximum(np.maximum(image[..., 0], image[..., 1]), image[..., 2])


def normalized(vectors: ArrayLike) -> Float:
    """Vectors of shape (..., 3) scaled to length 1; a zero vector stays zero."""
    vectors = np.asarray(vectors, dtype=np.float64)
    return safe_div(vectors, np.linalg.norm(vectors, axis=-1, keepdims=True))


def memory_of(values: NDArray[Any]) -> object:
    """What holds the memory that an array is a view of."""
    base: object = values
    while isinstance(base, np.ndarray | memoryview):
        base = base.base if isinstance(base, np.ndarray) else base.obj
    return base


def stacked(images: Sequence[NDArray[Any]], zeros: Zeros = np.zeros) -> NDArray[Any]:
    """Images of one shape one behind the other, (L, ...), of the type that holds them all.

    Parameters
    ----------
    images : sequence of L ndarrays
    zeros : callable, optional
        Makes the array.
    """
    return np.stack(images, out=zeros((len(images), *images[0].shape), np.result_type(*images)))


def even_stride(count: int) -> int:
    """Step with which 0, s, 2 s, ... modulo `count` visits all once, neighbours far apart.

    Threads take consecutive turns: dealt out so, each gets its share of what takes long, wherever that lies.
    """
    golden = (5**0.5 - 1) / 2 * count
    return min((s for s in range(1, max(count, 1) + 1) if gcd(s, count) == 1), key=lambda s: abs(s - golden))


def gaussian_2d(variance_mm2: ArrayLike, radius_mm: ArrayLike) -> Float:
    """Radial Gaussian of unit integral over the plane, mm^-2, theory.md 4.1: exp(-r^2/2v) / (2 pi v)."""
    variance_mm2 = np.asarray(variance_mm2, dtype=np.float64)
    return np.exp(-sqr(radius_mm) / (2 * variance_mm2)) / (2 * np.pi * variance_mm2)


def monotone_cubic(x: Float, values: Float, at: Float) -> Float:
    """Values between nodes by cubics that do not overshoot, (M, ...): what scipy's `PchipInterpolator` gives.

    That one takes a tenth of a second to import, for `scipy.interpolate` loads `scipy.optimize`.

    Parameters
    ----------
    x : ndarray of shape (N,)
        Ascending, at least 2.
    values : ndarray of shape (N, ...)
    at : ndarray of shape (M,)
        Beyond the ends the last cubic goes on.

    References
    ----------
    [Fritsch1984]
    """
    sides = (...,) + (None,) * (values.ndim - 1)
    step = np.diff(x)[sides]
    secant = np.diff(values, axis=0) / step
    slope = np.zeros_like(values)
    # Where both secants rise or both fall, their harmonic mean, the shorter interval's counting more; else flat
    before, after = step[:-1] + 2 * step[1:], 2 * step[:-1] + step[1:]
    same = secant[:-1] * secant[1:] > 0
    left, right = np.where(same, secant[:-1], 1), np.where(same, secant[1:], 1)
    slope[1:-1] = np.where(same, (before + after) / (before / left + after / right), 0)
    second = min(1, len(step) - 1)
    for end, near, far in ((0, 0, second), (-1, -1, -1 - second)):
        parabola = ((2 * step[near] + step[far]) * secant[near] - step[near] * secant[far]) / (step[near] + step[far])
        turns = (np.sign(secant[near]) != np.sign(secant[far])) & (np.abs(parabola) > 3 * np.abs(secant[near]))
        parabola = np.where(turns, 3 * secant[near], parabola)
        slope[end] = np.where(np.sign(parabola) == np.sign(secant[near]), parabola, 0)
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    width, t = step[k], ((at - x[k]) / np.diff(x)[k])[sides]
    bend = slope[k] + slope[k + 1] - 2 * secant[k]
    cubic = slope[k] + t * (secant[k] - slope[k] - bend + t * bend)
    found: Float = values[k] + width * t * cubic
    return found
