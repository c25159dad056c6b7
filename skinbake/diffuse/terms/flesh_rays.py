"""Rays from a point of the skin into the flesh: what comes along each, so that a slab lets through what it does.

Through a slab of thickness d a ray at the cosine mu has the length d / mu. If one of length r brings t(r) = T - r dT/dr
a share of the hemisphere of directions, all of them bring the integral of d/dmu (mu T(d / mu)), which is T(d), exactly
and for any T. In flesh of another form that is Green's identity: of light that dies away as exp(-kappa r) it gives
(1 + kappa r) exp(-kappa r) times what is there where the ray leaves the flesh (theory.md 7.4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

Image = NDArray[np.float32]
WIDEST = 0.1  # least cosine: rays that graze meet the point's own side
RINGS = 3  # three cosines make slabs of all thicknesses right to 2 %
AROUND = 5, 7, 10, 14, 20  # rays at each, the fewest that hold the noise down
NOISE, FADES = 0.12, 1.3  # of light that the fewest bring (rms), and its power of how many times as many there are
TERMS = 5


def rays_inwards(around: int = AROUND[0]) -> tuple[Float, Float]:
    """Directions about an inward normal (0, 0, 1), (R, 3), and their shares of the hemisphere, (R,).

    Parameters
    ----------
    around : int
        Of `AROUND`.
    """
    node, share = np.polynomial.legendre.leggauss(RINGS)
    cosine = np.repeat(WIDEST + (1 - WIDEST) * (node + 1) / 2, around)
    turn = np.arange(RINGS * around) + np.repeat(np.arange(RINGS) / 2, around)
    angle, sine = 2 * np.pi * turn / around, np.sqrt(1 - cosine**2)
    ways = np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=1)
    return ways, np.repeat((1 - WIDEST) * share / 2 / around, around)


def noise_of_rays(through: float, around: int) -> float:
    """Root mean square that so few rays leave of light whose own is `through`: as heads that were turned differ.

    Parameters
    ----------
    through : float
    around : int
        Of `AROUND`.
    """
    return NOISE * through * (AROUND[0] / around) ** FADES


def rays_for(through: float, limit: float) -> int:
    """The fewest of `AROUND` whose noise is within a limit; the most where none is.

    Parameters
    ----------
    through, limit : float
        Root mean squares, of the light and of its noise.
    """
    return next((around for around in AROUND if noise_of_rays(through, around) <= limit), AROUND[-1])


def through_along(thickness_mm: Float, through_rgb: Float) -> Float:
    """t(r) for rays of the lengths `thickness_mm`, (K, 3), for cosines from `WIDEST` to 1.

    These bring U(d) - c U(d / c) of t = U - r dU/dr, c the least cosine: T(d) for U(d) = T(d) + c T(d / c) + ...

    Parameters
    ----------
    thickness_mm : ndarray of shape (K,)
        Of slabs, ascending.
    through_rgb : ndarray of shape (K, 3)
        What they let through.
    """
    logarithm = np.log(thickness_mm)
    whole = np.zeros_like(through_rgb)
    for k in range(TERMS):
        further = logarithm - k * np.log(WIDEST)
        for c in range(whole.shape[1]):
            whole[:, c] += WIDEST**k * np.interp(further, logarithm, through_rgb[:, c], right=0.0)
    slope: Float = np.gradient(whole, logarithm, axis=0)
    return whole - slope


def gathered(along: Image, around: int) -> Image:
    """Light that the rays of each point bring, (..., n R, C), as a sum over them, (..., n, C).

    Parameters
    ----------
    along : ndarray of shape (..., n R, C)
    around : int
        Of `rays_inwards`.
    """
    share = rays_inwards(around)[1].astype(np.float32)
    by_point = along.reshape(*along.shape[:-2], -1, len(share), along.shape[-1])
    total: Image = np.einsum("...rc,r->...c", by_point, share)
    return total
