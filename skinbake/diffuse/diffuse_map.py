"""DiffuseMap: light leaving the skin, one blurred texture a Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Lobe:
    """One Gaussian's blur of the irradiance (times albedo^x) over every tile.

    Attributes
    ----------
    variance_mm2 : float
    weight_rgb : tuple of 3 floats
    method : str
        "identity", "texture", "stretch", "surface" or "reference".
    rgb : dict of int to ndarray of shape (L, h, w, 3), float32
        By tile; h, w may be smaller than the texture and are then read by bilinear lookup at the same (u, v).
        Gutter filled, so that bilinear reading is right up to the chart's border.
    """

    variance_mm2: float
    weight_rgb: tuple[float, float, float]
    method: str
    rgb: dict[int, NDArray[np.float32]]


@dataclass(frozen=True)
class MeasuredError:
    """Relative error against the surface integral of the same sum of Gaussians (README, "what the error means")."""

    rms: float
    p95: float
    max: float
    probes: int
    method: float
    storage: float


@dataclass(frozen=True)
class PlanLine:
    """One decision: what was kept or left out, and the number that decided it."""

    term: str
    kept: bool
    why: str


@dataclass(frozen=True)
class DiffuseMap:
    """All lobes, narrowest first, with what is known of their error and the plan that chose their methods."""

    lights: tuple[str, ...]
    lobes: tuple[Lobe, ...]
    error: MeasuredError | None
    plan: tuple[PlanLine, ...] = ()
