"""Back from spatial frequency to distance: the inverse Hankel transform of order 0, without oscillation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.slab import Array

Transform = Callable[[Array], Array]  # s of shape (C or 1, ...) to F~(s) of shape (C, ...)

UNDERFLOW = 700.0  # exp(-700) is the smallest magnitude worth carrying in float64
# Trapezoid in ln t, step h, inside a strip of half-width pi/4: error exp(-2 pi (pi/4) / h)
# Fourteen steps a decade give 12 to 13 digits
STEPS_PER_DIGIT = 14 / 12
DIRECTION = np.exp(0.25j * np.pi)


def inverse_hankel(
    transform: Transform,
    radius_mm: Float,
    first_singularity_per_mm: Float,
    shortest_mm: float,
    longest_mm: float,
    digits: int = 13,
) -> Float:
    """F(r) = 1/(2 pi) int F~(s) J0(s r) s ds, shape (C, N); theory.md 3.3.

    J0 is the real part of the Hankel function H0, which decays off the real axis. F~ of a diffusing stack is analytic
    in the first quadrant, and real up the imaginary axis as far as i sigma_tr of the least absorbing layer. So the path
    may climb to that point, where it collects nothing real, and leave it at 45 degrees: no oscillation is left at any
    r, and as exp(-sigma_tr r) is pulled out of the integral the far field keeps its relative accuracy.

    Parameters
    ----------
    transform : callable
        From s, real or complex, of shape (C or 1, ...) to F~(s); must fall at high frequency as exp(-s shortest_mm) or
        faster.
    radius_mm : ndarray of shape (N,)
    first_singularity_per_mm : ndarray of shape (C,)
        sigma_tr of the least absorbing layer per channel.
    shortest_mm, longest_mm : float
        Range of the free paths and depths that shape F~.
    digits : int
        Wanted; time grows as its square.
    """
    from scipy.special import hankel1e

    radius = np.asarray(radius_mm, dtype=np.float64)
    out = np.zeros((len(first_singularity_per_mm), len(radius)))
    at_zero = radius == 0
    if at_zero.any():
        t, step = _logarithmic(np.zeros(1), shortest_mm, longest_mm, digits)
        frequency = t[None]
        out[:, at_zero] = np.sum(transform(frequency).real * t**2, axis=-1) * step / (2 * np.pi)

    r = radius[~at_zero]
    if r.size == 0:
        return out
    t, step = _logarithmic(r, shortest_mm, longest_mm, digits)
    start = np.asarray(first_singularity_per_mm)[:, None, None]
    s = 1j * start + t * DIRECTION
    # The far field of a strong absorber is below the smallest float: leave the exact 0 there
    reach = np.minimum(start * r[:, None], UNDERFLOW)
    gone = start * r[:, None] > UNDERFLOW
    z = 1j * reach + t * r[:, None] * DIRECTION
    integrand = transform(s) * s * hankel1e(0, z) * np.exp(1j * z) * DIRECTION * t
    values = np.sum(integrand.real, axis=-1) * step[:, 0] / (2 * np.pi)
    out[:, ~at_zero] = np.where(gone[..., 0], 0.0, values)
    return out


def _logarithmic(radius: Float, shortest_mm: float, longest_mm: float, digits: int) -> tuple[Float, Float]:
    """Frequencies t, evenly spaced in ln t, shape (N, M), and that spacing, shape (N, 1), for each radius."""
    top = 60 / (radius + shortest_mm)
    bottom = 10.0**-digits / (radius + longest_mm)
    decades = np.log(top / bottom) / np.log(10)
    count = int(np.ceil(decades.max() * digits * STEPS_PER_DIGIT))
    step = np.log(top / bottom)[:, None] / count
    return bottom[:, None] * np.exp(step * np.arange(count + 1)), step
