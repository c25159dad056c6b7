"""Closed form of what a half-space of isotropic scattering reflects, where its index is that of the outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float

NODES = 400  # of Gauss-Legendre quadrature; 1e-10 at an albedo of 0.999


def chandrasekhar_h(mu: ArrayLike, albedo: ArrayLike) -> Float:
    """Chandrasekhar's H for isotropic scattering.

    Parameters
    ----------
    mu : array_like of shape (...)
        Cosine, 0 to 1.
    albedo : array_like of shape (...), broadcast with `mu`
        Single-scattering albedo, 0 <= albedo < 1.

    Returns
    -------
    ndarray of shape (...)

    Raises
    ------
    ValueError
        If an albedo is not inside [0, 1).

    References
    ----------
    [Chandrasekhar1960]
    """
    mu, albedo = np.broadcast_arrays(np.asarray(mu, np.float64), np.asarray(albedo, np.float64))
    if np.any(albedo < 0) or np.any(albedo >= 1):
        raise ValueError(f"albedo: expected numbers from 0 to 1, 1 not among them, got {albedo.tolist()}")
    # ln H = -(mu / pi) int_0^(pi/2) ln(1 - albedo t cot t) / (cos^2 t + mu^2 sin^2 t) dt; with tan s = mu tan t the
    # weight is even for every mu: mu dt / (cos^2 t + mu^2 sin^2 t) = ds
    node, weight = np.polynomial.legendre.leggauss(NODES)
    s, weight = np.pi / 4 * (node + 1), np.pi / 4 * weight
    safe = np.maximum(mu, 1e-12)[..., None]
    t = np.arctan2(np.sin(s), safe * np.cos(s))
    inside = 1 - albedo[..., None] * np.where(t > 1e-8, t * np.cos(t) / np.sin(np.maximum(t, 1e-8)), 1.0)
    return np.where(mu > 0, np.exp(-(np.log(inside) * weight).sum(axis=-1) / np.pi), 1.0)


def half_space_reflectance(mu: ArrayLike, albedo: ArrayLike) -> Float:
    """Share of a beam at cosine `mu` that a half-space reflects, R(mu) = 1 - H(mu) sqrt(1 - albedo); theory.md 9.4.

    Isotropic scattering, equal indices; arguments as `chandrasekhar_h`.

    References
    ----------
    [Chandrasekhar1960]
    """
    return 1 - chandrasekhar_h(mu, albedo) * np.sqrt(1 - np.asarray(albedo, np.float64))


def half_space_diffuse_reflectance(albedo: ArrayLike) -> Float:
    """The same for light from everywhere, 2 int_0^1 R(mu) mu dmu, shape of `albedo`."""
    node, weight = np.polynomial.legendre.leggauss(48)
    mu, weight = (node + 1) / 2, weight / 2
    a = np.asarray(albedo, np.float64)[..., None]
    return (half_space_reflectance(mu, a) * 2 * mu * weight).sum(axis=-1)
