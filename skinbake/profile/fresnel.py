"""Diffuse Fresnel reflection at the face of a medium, seen from inside, and the boundary factor A it leads to."""

from __future__ import annotations

from typing import Literal

import numpy as np

from skinbake.numerics import Float

BoundaryMethod = Literal["polynomial", "exact", "better"]

ETA_MAX = 3.0  # the polynomial was fitted to tissue and glass; A grows without bound beyond


def diffuse_reflectance_polynomial(eta: float) -> float:
    """F_dr by the published polynomials, theory.md 1.6 and 1.7; exactly 0 at eta = 1, where no polynomial is.

    Parameters
    ----------
    eta : float
        Index inside over index outside.

    References
    ----------
    [Egan1973], [Groenhuis1983]
    """
    if eta == 1:
        return 0.0
    if eta > 1:
        return -1.4399 / eta**2 + 0.7099 / eta + 0.6681 + 0.0636 * eta
    return -0.4399 + 0.7099 / eta - 0.3319 / eta**2 + 0.0636 / eta**3


def fresnel_moments(eta: float) -> tuple[float, float]:
    """2 C1 (which is F_dr) and 3 C2 of unpolarised Fresnel reflection, by quadrature; theory.md 1.8 to 1.10.

    With the cosines on the dense and thin side written as c cosh(q) and n c sinh(q), c the critical cosine, the
    s-polarised amplitude is exp(-2q) and all is smooth in q: no cancellation near eta = 1, unlike the closed form.
    """
    if eta == 1:
        return 0.0, 0.0
    n = max(eta, 1 / eta)
    critical = np.sqrt((n - 1) * (n + 1)) / n
    q_end = np.arccosh(1 / critical)
    node, weight = np.polynomial.legendre.leggauss(96)
    q = q_end * (node + 1) / 2
    cosh, sinh = np.cosh(q), np.sinh(q)
    reflectance = 0.5 * (np.exp(-4 * q) + ((cosh - n * n * sinh) / (cosh + n * n * sinh)) ** 2)
    weight = weight * q_end / 2
    if eta > 1:  # light on the dense side: total reflection below the critical cosine
        first = critical**2 * (1 + 2 * weight @ (reflectance * cosh * sinh))
        second = critical**3 * (1 + 3 * weight @ (reflectance * cosh**2 * sinh))
    else:
        first = 2 * (n * critical) ** 2 * (weight @ (reflectance * sinh * cosh))
        second = 3 * (n * critical) ** 3 * (weight @ (reflectance * sinh**2 * cosh))
    return float(first), float(second)


def boundary_factor(eta: float, boundary: BoundaryMethod = "polynomial") -> float:
    """Boundary factor A of theory.md 1.5 or 1.11: how much farther out the flux extrapolates because the face reflects.

    Parameters
    ----------
    eta : float
        Index inside over index outside, from 1/3 to 3.
    boundary : {"polynomial", "exact", "better"}
        The polynomial reproduces published figures, the exact integral is better physics (totals differ by < 0.2 %),
        "better" is (1 + 3 C2) / (1 - 2 C1) of the better dipole.

    Raises
    ------
    ValueError
        If eta is outside [1/3, 3].

    References
    ----------
    [Jensen2001], [dEon2012]
    """
    if not 1 / ETA_MAX <= eta <= ETA_MAX:
        raise ValueError(f"eta: expected a ratio of indices from 1/3 to 3, got {eta}")
    if eta == 1:
        return 1.0
    if boundary == "polynomial":
        reflected = diffuse_reflectance_polynomial(eta)
        return (1 + reflected) / (1 - reflected)
    first, second = fresnel_moments(eta)
    if boundary == "exact":
        return (1 + first) / (1 - first)
    return (1 + second) / (1 - first)


def reflectance_from_inside(eta: float, mu: Float) -> Float:
    """Unpolarised Fresnel reflectance of a face from inside, eta >= 1, by the cosine there, (n,)."""
    if eta == 1:
        return np.zeros_like(mu)
    sine2 = eta**2 * (1 - mu**2)
    out = np.sqrt(np.maximum(1 - sine2, 0))
    across, parallel = (eta * mu - out) / (eta * mu + out), (eta * out - mu) / (eta * out + mu)
    found: Float = np.where(sine2 >= 1, 1.0, (across**2 + parallel**2) / 2)
    return found
