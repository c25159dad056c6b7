"""One-dimensional Gaussian kernels on a grid, exact in variance for any width; theory.md 5.6."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

TAIL = 1e-6  # 1-D mass that truncation may lose, both sides together
_FIRST_BITS, _LAST_BITS = (int(np.float32(t).view(np.int32)) for t in (2.0**-36, 1.0))
_STEP_BITS = 23 - 7


def discrete_gaussian(t: float) -> Float:
    """T(n; t) = exp(-t) I_n(t) for n = 0 ... R: positive, symmetric, sum 1, variance t; theory.md 5.6.

    Parameters
    ----------
    t : float
        Variance in texels squared, >= 0; 0 is the identity.

    Returns
    -------
    ndarray of shape (R + 1,)
        Half kernel: entry n is the weight at +n and at -n; the mass beyond R, at most `TAIL`, is put back by
        renormalising.

    Raises
    ------
    ValueError
        If `t` is below 0.

    References
    ----------
    [Lindeberg1990]
    """
    if not t >= 0:
        raise ValueError(f"discrete_gaussian: expected a variance >= 0, got {t}")
    return _trimmed(_bessel_half(float(t), int(np.ceil(7 * np.sqrt(t) + 9)))) if t > 0 else np.ones(1)


def _bessel_half(t: float, count: int) -> Float:
    """I_n(t) / I_0(t) for n = 0 ... count - 1, by I_(n-1) = I_(n+1) + 2n/t I_n from far out inwards.

    SciPy's `ive` has the same to the last digits; importing it takes longer than all kernels of a bake.
    """
    ratio, found = 0.0, np.ones(count)  # I_n / I_(n-1)
    for n in range(count + int(3 * np.sqrt(t)) + 16, 0, -1):
        ratio = 1 / (2 * n / t + ratio)
        if n < count:
            found[n] = ratio
    return np.multiply.accumulate(found)


def sampled_gaussian(t: float) -> Float:
    """Gaussian of variance t in steps of the grid, sampled at -R ... R, normalised; wants t >= 0.6 (theory.md 5.6)."""
    reach = int(np.ceil(np.sqrt(-2 * t * np.log(TAIL))))
    n = np.arange(-reach, reach + 1)
    weights = np.exp(-(n**2) / (2 * t))
    return weights / weights.sum()


def residual_kernel(t: float, t_fourth: float) -> Float:
    """Half kernel of variance t with fourth cumulant `t_fourth`: discrete Gaussian of t_fourth, sampled for the rest.

    The discrete Gaussian of variance s has fourth cumulant s, a sampled one (t >= 0.6) has none: convolving both
    reaches any value between. So a coarse level reproduces the kernel that the fine level would have used.
    """
    of_discrete = min(max(t_fourth, 0.0), t - 0.6)
    discrete, sampled = discrete_gaussian(of_discrete), sampled_gaussian(t - of_discrete)
    full = np.concatenate([discrete[:0:-1], discrete])
    # By Fourier transform: direct sums would take minutes for the widest lobes
    length = len(full) + len(sampled) - 1
    both = np.maximum(np.fft.irfft(np.fft.rfft(full, length) * np.fft.rfft(sampled, length), length), 0)
    return _trimmed(both[len(both) // 2 :])


@kernel
def lattice_variance(variance, texel, table):  # type: ignore[no-untyped-def]
    """Parameter of a sampled Gaussian whose variance on a lattice is right, although it may be far below one texel.

    Sampled as it is, a Gaussian narrower than 0.6 texel loses its variance (0.0077 instead of 0.09 at sigma 0.3).
    Widening its parameter to t' gives the wanted variance back; from t = 0.9 on t' = t.

    Parameters
    ----------
    variance : float
        Wanted, in the unit of `texel`, > 0.
    texel : float
        Area of one texel; 0 or less: a sum, not a lattice, `variance` stays.
    table : tuple
        `lattice_table()`.

    Returns
    -------
    float
        t' texel, with sum_n n^2 exp(-n^2 / 2t') = t sum_n exp(-n^2 / 2t'), t = variance / texel.
    """
    if texel <= 0 or variance >= texel:
        return variance
    return _at(variance / texel, table[0]) * texel


@kernel
def lattice_gain(variance, texel, table):  # type: ignore[no-untyped-def]
    """2 pi t / (sum_n exp(-n^2 / 2t'))^2: makes the 2-D lattice sum that of the continuous Gaussian.

    Parameters
    ----------
    variance, texel, table
        As in `lattice_variance`.
    """
    if texel <= 0 or variance >= texel:
        return 1.0
    t = variance / texel
    return 2 * np.pi * t / _at(t, table[1]) ** 2


@kernel(inline=True)
def _at(t, values):  # type: ignore[no-untyped-def]
    """The bits of a float32 count evenly within an octave, which spares a logarithm."""
    at = min(max(np.float32(t).view(np.int32) - _FIRST_BITS, 0), ((len(values) - 1) << _STEP_BITS) - 1)
    k = at >> _STEP_BITS
    return values[k] + (at - (k << _STEP_BITS)) * (values[k + 1] - values[k]) / (1 << _STEP_BITS)


@lru_cache(maxsize=1)
def lattice_table() -> tuple[Float, Float]:
    """t' and the 1-D lattice sum, at 128 steps to an octave of t from 2^-36 to 1."""
    parameter = np.geomspace(0.02, 1.1, 4000)
    n = np.arange(-12, 13)
    weights = np.exp(-(n * n)[None, :] / (2 * parameter[:, None]))
    total = weights.sum(axis=1)
    log_variance = np.log((weights * n * n).sum(axis=1) / total)
    bits = np.arange(_FIRST_BITS, _LAST_BITS + 1, 1 << _STEP_BITS, dtype=np.int32)
    log_t = np.log(bits.view(np.float32).astype(np.float64))
    return np.interp(log_t, log_variance, parameter), np.interp(log_t, log_variance, total)


def _trimmed(half: Float) -> NDArray[np.float64]:
    """Drop the far end that holds less than `TAIL`, then make the whole kernel sum to 1."""
    total = 2 * half.sum() - half[0]
    beyond = 2 * np.cumsum(half[::-1])[::-1] / total  # mass at and beyond +-n
    keep = max(1, int(np.count_nonzero(beyond >= TAIL)))
    half = half[:keep]
    return half / (2 * half.sum() - half[0])
