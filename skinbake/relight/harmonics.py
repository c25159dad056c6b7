"""Real spherical harmonics about the upright axis: of directions, of skies, and what a turn about y makes of them.

Lights are described by their products with these: a sky by the integral of radiance times Y_j, a sun by its irradiance
times Y_j(towards it). All are linear in the light, and a turn about the upright axis mixes two and two of them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinbake.numerics import Float

Image = NDArray[np.float32]
ROWS = 128  # least rows of a sky whose texels stand for their middles


def count_of(order: int) -> int:
    """Number of harmonics up to an order."""
    return (order + 1) ** 2


def harmonics(towards: ArrayLike, order: int) -> Float:
    """Y_j of unit vectors (n, 3), orthonormal over the sphere, shape (n, (order + 1)^2); j = l^2 + l + m.

    m > 0 goes with cos(m azimuth), m < 0 with sin(|m| azimuth); the azimuth runs from +z towards +x, the pole is +y.

    Parameters
    ----------
    towards : array_like of shape (n, 3)
    order : int
    """
    towards = np.asarray(towards, np.float64)
    polar = _legendre(np.clip(towards[:, 1], -1, 1), order)
    azimuth = np.arctan2(towards[:, 0], towards[:, 2])
    out = np.empty((len(towards), count_of(order)))
    for m in range(order + 1):
        cos, sin = np.cos(m * azimuth), np.sin(m * azimuth)
        for l in range(m, order + 1):  # noqa: E741  (the field's letter)
            middle = l * l + l
            out[:, middle + m] = polar[l, m] * cos
            if m:
                out[:, middle - m] = polar[l, m] * sin
    return out


def _legendre(cosine: Float, order: int) -> Float:
    """Normalised associated Legendre functions, for m > 0 times sqrt(2), shape (order + 1, order + 1, n) by l, m."""
    sine = np.sqrt(np.maximum(0, 1 - cosine * cosine))
    out = np.zeros((order + 1, order + 1, len(cosine)))
    out[0, 0] = math.sqrt(1 / (4 * math.pi))
    for m in range(1, order + 1):
        out[m, m] = math.sqrt((2 * m + 1) / (2 * m)) * sine * out[m - 1, m - 1]
    for m in range(order + 1):
        for l in range(m + 1, order + 1):  # noqa: E741
            a = math.sqrt((4 * l * l - 1) / (l * l - m * m))
            b = math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1)) if l > m + 1 else 0.0
            out[l, m] = a * (cosine * out[l - 1, m] - b * out[l - 2, m])
    out[:, 1:] *= math.sqrt(2)
    return out


def harmonics_of_sky(radiance: Image, order: int) -> Float:
    """Integral over the sphere of an equirectangular radiance map times each harmonic, shape ((order + 1)^2, 3).

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
        Row 0 at the top, its middle towards +z, u = 0.75 towards -x.
    order : int
    """
    finer = max(1, -(-ROWS // radiance.shape[0])), max(1, -(-2 * ROWS // radiance.shape[1]))
    if max(finer) > 1:
        radiance = np.repeat(np.repeat(radiance, finer[0], axis=0), finer[1], axis=1)
    height, width = radiance.shape[:2]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2 * np.pi / width) * (edges[:-1] - edges[1:])
    azimuth = 2 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)
    turns = np.arange(order + 1)[:, None] * azimuth
    # Over each row by Gauss and Legendre's rule in its height; then what it sends by cos and sin of every m
    nodes, weights = np.polynomial.legendre.leggauss(3)
    heights = (edges[:-1] + edges[1:]) / 2 + nodes[:, None] * (edges[:-1] - edges[1:]) / 2
    polar = sum(w / 2 * _legendre(h, order) for w, h in zip(weights, heights, strict=True)) * solid
    waves = np.concatenate([np.cos(turns), np.sin(turns)])
    rows = np.stack([np.einsum("wc,mw->mc", row.astype(np.float64), waves) for row in radiance])
    out = np.zeros((count_of(order), 3))
    for l in range(order + 1):  # noqa: E741
        for m in range(l + 1):
            out[l * l + l + m] = polar[l, m] @ rows[:, m]
            if m:
                out[l * l + l - m] = polar[l, m] @ rows[:, order + 1 + m]
    return out


def turned(coefficients: Float, rotate_deg: float) -> Float:
    """Coefficients of light that is turned about +y, +z towards +x; whole turns change no bit.

    Parameters
    ----------
    coefficients : ndarray of shape ((order + 1)^2, 3)
    rotate_deg : float
    """
    degrees = rotate_deg % 360
    if degrees == 0:
        return coefficients
    out = coefficients.copy()
    for l in range(math.isqrt(len(coefficients))):  # noqa: E741
        for m in range(1, l + 1):
            cos, sin = math.cos(m * math.radians(degrees)), math.sin(m * math.radians(degrees))
            plus, minus = l * l + l + m, l * l + l - m
            out[plus] = cos * coefficients[plus] - sin * coefficients[minus]
            out[minus] = sin * coefficients[plus] + cos * coefficients[minus]
    return out
