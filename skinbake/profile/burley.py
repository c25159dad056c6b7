"""Normalised diffusion: two exponentials fitted to Monte Carlo, single scattering included."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float

PathKind = Literal["searchlight", "diffuse", "surface"]


def burley_reflectance(d_mm: Float, albedo: Float, radius_mm: Float) -> Float:
    """R(r) of theory.md 8.1, mm^-2, shape (C, N). It has no value at r = 0; store `burley_disc_mean` there.

    Parameters
    ----------
    d_mm, albedo : ndarray of shape (C,)
        Shape length, and total reflectance A.
    radius_mm : ndarray of shape (N,)
        Above 0.

    References
    ----------
    [Burley2015], [Christensen2015]
    """
    d, r = np.asarray(d_mm)[:, None], radius_mm[None, :]
    return np.asarray(albedo)[:, None] * (np.exp(-r / d) + np.exp(-r / (3 * d))) / (8 * np.pi * d * r)


def burley_cdf(d_mm: ArrayLike, radius_mm: ArrayLike) -> Float:
    """Share of the light that leaves within r, in the broadcast shape; expm1 keeps its digits near r = 0."""
    x = np.asarray(radius_mm, dtype=np.float64) / np.asarray(d_mm)
    return -np.expm1(-x) / 4 - 3 * np.expm1(-x / 3) / 4


def burley_disc_mean(d_mm: Float, albedo: Float, disc_mm: float) -> Float:
    """Mean of R over a disc about r = 0, mm^-2, shape (C,); theory.md 8.1.

    Parameters
    ----------
    d_mm, albedo : ndarray of shape (C,)
        Shape length, and total reflectance A.
    disc_mm : float
        Radius of the disc, above 0.
    """
    return albedo * burley_cdf(d_mm, disc_mm) / (np.pi * disc_mm**2)


def burley_hankel(d_mm: Float, albedo: Float, s_per_mm: Float) -> Float:
    """R~(s) of theory.md 8.1, shape (C, M).

    Parameters
    ----------
    d_mm, albedo : ndarray of shape (C,)
        Shape length, and total reflectance A.
    s_per_mm : ndarray of shape (M,)
        Spatial frequency, >= 0.
    """
    x = np.asarray(d_mm)[:, None] * s_per_mm[None, :]
    return np.asarray(albedo)[:, None] / 4 * (1 / np.hypot(1, x) + 3 / np.hypot(1, 3 * x))


def burley_shape(albedo: ArrayLike, kind: PathKind = "searchlight") -> Float:
    """Number s(A) of theory.md 8.2 by which a mean free path is divided to give d.

    Parameters
    ----------
    albedo : array_like
        Total reflectance A.
    kind : {"searchlight", "diffuse", "surface"}
        Which path is given: in the volume under a perpendicular beam, in the volume under diffuse light, or the diffuse
        mean free path on the surface, 1 / sigma_tr.

    References
    ----------
    [Christensen2015]
    """
    a = np.asarray(albedo, dtype=np.float64)
    if kind == "searchlight":
        return 1.85 - a + 7 * np.abs(a - 0.8) ** 3
    if kind == "diffuse":
        return 1.9 - a + 3.5 * (a - 0.8) ** 2
    return 3.5 + 100 * (a - 0.33) ** 4
