"""Lengths and shares of a sum of Gaussians."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float, safe_div
from skinbake.profile.gaussian_sum import GaussianSum


def light_within(gaussians: GaussianSum, radius_mm: ArrayLike) -> Float:
    """Light inside each radius, shape (N, 3); theory.md 4.1."""
    r = np.atleast_1d(np.asarray(radius_mm, dtype=np.float64))[:, None]
    wide = gaussians.variance_mm2 > 0
    exponent = np.where(wide, r**2 / (2 * np.where(wide, gaussians.variance_mm2, 1)), np.inf)
    return -np.expm1(-exponent) @ gaussians.weight_rgb


def mean_radius_mm(gaussians: GaussianSum) -> Float:
    """Mean distance the light travels, mm, shape (3,); theory.md 4.1."""
    moments = np.sqrt(np.pi * gaussians.variance_mm2 / 2) @ gaussians.weight_rgb
    return safe_div(moments, gaussians.weight_rgb.sum(axis=0))


def rms_radius_mm(gaussians: GaussianSum) -> Float:
    """Root mean square distance, mm, shape (3,); theory.md 4.1.

    Raises
    ------
    ValueError
        If signed weights make the mean square negative.
    """
    mean_square = safe_div(2 * gaussians.variance_mm2 @ gaussians.weight_rgb, gaussians.weight_rgb.sum(axis=0))
    if np.any(mean_square < 0):
        raise ValueError("weight_rgb: expected weights whose mean square radius is not negative")
    return np.sqrt(mean_square)


def noise_left(gaussians: GaussianSum, texels_per_mm2: ArrayLike) -> Float:
    """Rms that white noise of rms 1 a texel has once it is scattered, shape (N, 3); theory.md 10.2.

    Parameters
    ----------
    gaussians : GaussianSum
    texels_per_mm2 : array_like of shape (N,)
        0 where texels are so large that nothing is smoothed.
    """
    density = np.atleast_1d(np.asarray(texels_per_mm2, dtype=np.float64))
    both = (gaussians.variance_mm2[:, None] + gaussians.variance_mm2[None, :]).ravel()
    weight = (gaussians.weight_rgb[:, None, :] * gaussians.weight_rgb[None, :, :]).reshape(-1, 3)
    return np.sqrt(np.maximum((1 / (1 + 2 * np.pi * density[:, None] * both)) @ weight, 0.0))


def line_spread(gaussians: GaussianSum, distance_mm: ArrayLike) -> Float:
    """Light at a distance from a thin line, 1/mm, shape (N, 3); theory.md 8.4: R integrated along the line.

    Exact for light that varies across the line alone; as one factor of a separable kernel it is wrong by 12 to 53 %.

    References
    ----------
    [Jimenez2015]
    """
    x = np.atleast_1d(np.asarray(distance_mm, dtype=np.float64))[:, None]
    wide = gaussians.variance_mm2 > 0
    v = gaussians.variance_mm2[wide]
    return (np.exp(-(x**2) / (2 * v)) / np.sqrt(2 * np.pi * v)) @ gaussians.weight_rgb[wide]
