"""The dipole: a semi-infinite medium as one source below the surface and its mirror image above."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.medium import Medium


def dipole_reflectance(medium: Medium, boundary: float, radius_mm: Float) -> Float:
    """R(r) of the dipole, mm^-2, shape (C, N); theory.md 2.1. Both terms are positive, nothing cancels.

    Parameters
    ----------
    medium : Medium
    boundary : float
        Boundary factor A of the face.
    radius_mm : ndarray of shape (N,)

    References
    ----------
    [Jensen2001]
    """
    total = np.zeros((len(medium.albedo), len(radius_mm)))
    sigma_tr = medium.sigma_tr_per_mm[:, None]
    for depth in _source_heights(medium, boundary):
        distance = np.hypot(radius_mm[None, :], depth[:, None])
        total += depth[:, None] / distance * (1 / distance + sigma_tr) / distance * np.exp(-sigma_tr * distance)
    return medium.albedo[:, None] / (4 * np.pi) * total


def dipole_total(medium: Medium, boundary: float) -> Float:
    """Total reflectance R_d of the dipole, shape (C,), for the boundary factor A; theory.md 2.2."""
    real, mirrored = _source_heights(medium, boundary)
    sigma_tr = medium.sigma_tr_per_mm
    return medium.albedo / 2 * (np.exp(-sigma_tr * real) + np.exp(-sigma_tr * mirrored))


def albedo_of_total(total: float, boundary: float) -> float:
    """Reduced albedo alpha' at which the dipole reflects `total`; theory.md 2.3.

    Parameters
    ----------
    total : float
        Total diffuse reflectance, above 0 and below 1.
    boundary : float
        Boundary factor A of the face.

    Raises
    ------
    ValueError
        If `total` is not inside (0, 1).
    """
    if not 0 < total < 1:
        raise ValueError(f"total reflectance: expected a number inside (0, 1), got {total}")

    def excess(log_absorbed: float) -> float:
        absorbed = np.exp(log_absorbed)
        x = np.sqrt(3 * absorbed)
        return float(-np.expm1(log_absorbed) / 2 * (np.exp(-x) + np.exp(-x * (1 + 4 * boundary / 3))) - total)

    # ln(1 - alpha') is the unknown: reflectance falls with the square root of absorption. Halved to the last digit: a
    # library's search takes a sixteenth of a second to load
    low, high = -80.0, -1e-16
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return float(-np.expm1(middle))


def _source_heights(medium: Medium, boundary: float) -> tuple[Float, Float]:
    """Depth z_r of the real source and height z_r + 2 z_b of its mirror image, mm, each (C,); theory.md 1.5."""
    real = medium.free_path_mm
    return real, real + 2 * medium.extrapolation_mm(boundary)
