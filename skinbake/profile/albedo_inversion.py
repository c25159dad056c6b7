"""Single-scattering albedo that a random walk needs to reflect a colour: for comparing a bake with a path tracer."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float


def albedo_inversion(reflectance: ArrayLike, fit: Literal["chiang", "wrenninge"] = "chiang") -> Float:
    """Single-scattering albedo of an isotropic random walk whose surface reflects `reflectance`; theory.md 8.5.

    Parameters
    ----------
    reflectance : array_like
        Total reflectance A inside [0, 1].
    fit : {"chiang", "wrenninge"}
        The 2016 fit of older path tracers, or the 2017 one at g = 0 of newer.

    Raises
    ------
    ValueError
        If a reflectance is outside [0, 1].

    References
    ----------
    [Chiang2016], [Wrenninge2017]
    """
    a = np.asarray(reflectance, dtype=np.float64)
    if np.any((a < 0) | (a > 1)) or not np.isfinite(a).all():
        raise ValueError(f"reflectance: expected numbers inside [0, 1], got {a.tolist()}")
    if fit == "chiang":
        return -np.expm1(-5.09406 * a + 2.61188 * a**2 - 4.31805 * a**3)
    root = a**0.25
    low = 1.8260523782 * np.arctan((4.98511194385 + 0.127355959438) * a) ** 1.09686102424
    high = 0.496310210422 * np.arctan((4.23190299701 + 0.00310603949088) * a) ** 2.40602999408
    # The fit overshoots 1 by 0.002 at A = 1; its users clamp it here
    return np.minimum((1 - root) * low + root * high, 0.999999)
