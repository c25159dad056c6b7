"""The oil layer's BRDF in float64, theory.md 6: what the shader and the table of its albedo are held to."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skinbake.irradiance.oil_layer import ENERGY_TRUE_STRENGTH, HALF_SQUARED_MIN, ROUGHNESS_MIN
from skinbake.numerics import Float, normalized, sqr


def beckmann(n_dot_h: ArrayLike, roughness: ArrayLike) -> Float:
    """Beckmann's P_H of theory.md 6.2, without 1/pi: its integral against N.H over the hemisphere is pi.

    Parameters
    ----------
    n_dot_h : array_like
        Where it is not above 0, so is P_H.
    roughness : array_like
        Beckmann m; raised to `ROUGHNESS_MIN`.
    """
    n_dot_h = np.clip(np.asarray(n_dot_h, dtype=np.float64), 0.0, 1.0)
    return _beckmann_of_sine((1 - n_dot_h) * (1 + n_dot_h), n_dot_h, roughness)


def _beckmann_of_sine(sine_squared: Float, n_dot_h: Float, roughness: ArrayLike) -> Float:
    """P_H by logarithms, theory.md 6.7: as N.H -> 0 the exponent wins, where the product would be 0 * inf."""
    m = np.maximum(np.asarray(roughness, dtype=np.float64), ROUGHNESS_MIN)
    facing = n_dot_h > 0
    safe = np.where(facing, n_dot_h, 1.0)
    log_p = -sine_squared / sqr(safe * m) - 2 * np.log(m) - 4 * np.log(safe)
    return np.where(facing, np.exp(np.where(facing, log_p, -np.inf)), 0.0)


def fresnel_schlick(v_dot_h: ArrayLike, f0: ArrayLike) -> Float:
    """Fresnel reflectance F of theory.md 6.3; 1 - V.H is clamped, for V.H may pass 1 by an ulp [Schlick1994]."""
    f0 = np.asarray(f0, dtype=np.float64)
    return f0 + (1 - f0) * np.clip(1 - np.asarray(v_dot_h, dtype=np.float64), 0.0, 1.0) ** 5


def fresnel_dielectric(cos_theta: ArrayLike, eta: float) -> Float:
    """Exact unpolarised Fresnel reflectance from the thin side; `eta` > 1 is the index ratio inside / outside."""
    c = np.clip(np.asarray(cos_theta, dtype=np.float64), 0.0, 1.0)
    inside = np.sqrt(1 - (1 - c * c) / eta**2)
    parallel = (eta * c - inside) / (eta * c + inside)
    perpendicular = (c - eta * inside) / (c + eta * inside)
    return (sqr(parallel) + sqr(perpendicular)) / 2


def kelemen_brdf(
    normal: ArrayLike,
    to_light: ArrayLike,
    to_view: ArrayLike,
    roughness: ArrayLike,
    f0: ArrayLike = 1 / 36,
    strength: ArrayLike = ENERGY_TRUE_STRENGTH,
) -> Float:
    """Specular BRDF f, 1/sr, in the stable form of theory.md 6.7.

    Parameters
    ----------
    normal, to_light, to_view : array_like of shape (..., 3)
        Unit vectors away from the surface.
    roughness, f0, strength : array_like of shape (...)
        Beckmann m, reflectance at normal incidence, rho_s.

    Returns
    -------
    ndarray of shape (...)
        Finite and non-negative everywhere; reciprocal. Light from below is the caller's N.L.

    References
    ----------
    [Kelemen2001], [dEon2007]
    """
    normal, light, view = (np.asarray(v, dtype=np.float64) for v in (normal, to_light, to_view))
    h = light + view
    half = normalized(h)
    h_squared = np.maximum((h * h).sum(-1), HALF_SQUARED_MIN)

    # |N x H|^2 instead of 1 - (N.H)^2: the latter is granular just where a small m makes it count
    n_dot_h = (normal * half).sum(-1)
    sine_squared = sqr(np.cross(normal, half)).sum(-1)
    distribution = _beckmann_of_sine(sine_squared, n_dot_h, roughness)

    return np.asarray(strength) * distribution * fresnel_schlick((view * half).sum(-1), f0) / h_squared
