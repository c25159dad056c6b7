"""DiffuseMap: light leaving the skin, one blurred texture a Gaussian."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from skinbake.scene.decision import Decision

__all__ = ["Decision", "DiffuseMap", "Lobe", "MeasuredError"]


@dataclass(frozen=True)
class Lobe:
    """One Gaussian's blur of the irradiance (times albedo^x) over every tile; or, of weight 1, the light of a term.

    Attributes
    ----------
    variance_mm2 : float
        Of the Gaussian; a term's is that of the widest one in it.
    weight_rgb : tuple of 3 floats
    method : str or None
        Name of the method that made it (`skinbake.diffuse.methods`); None for light that no method blurred.
    rgb : dict of int to ndarray of shape (L, h, w, 3), float32
        By tile; h, w may be smaller than the texture and are then read by bilinear lookup at the same (u, v).
        Gutter filled, so that bilinear reading is right up to the chart's border.
    error : MeasuredError, optional
        Of this lobe alone.
    total_rgb : tuple of 3 floats, optional
        Area-weighted total of the lobe over that of the light which arrived, per channel over all lights.
    """

    variance_mm2: float
    weight_rgb: tuple[float, float, float]
    method: str | None
    rgb: dict[int, NDArray[np.float32]]
    error: MeasuredError | None = None
    total_rgb: tuple[float, float, float] | None = None

    @property
    def transmitted(self) -> bool:
        """Whether this is the light that comes through thin parts (`terms.transmission`), not a Gaussian's blur."""
        return self.method is None

    def figured_as(self, other: Lobe) -> Lobe:
        """These pixels, which are not copied, with the figures of another lobe."""
        figures = {each.name: getattr(other, each.name) for each in fields(Lobe) if each.name != "rgb"}
        return replace(self, **figures, rgb=dict(self.rgb))


@dataclass(frozen=True)
class MeasuredError:
    """Relative error against the surface integral of the same sum of Gaussians (`skinbake/docs/accuracy.md`).

    `rms` and its parts `method` and `storage` are of the light that they are worst for.
    """

    rms: float
    p95: float
    max: float
    probes: int
    method: float
    storage: float


@dataclass(frozen=True)
class DiffuseMap:
    """All lobes, narrowest first, with what is known of their error and the plan that chose their methods.

    Attributes
    ----------
    lights : tuple of str
    lobes : tuple of Lobe
    error : MeasuredError, optional
        Of the weighted sum of the lobes as they are read back; None without probes.
    plan : tuple of Decision
    tolerance_met : bool
        Whether what is left wrong is within the tolerance that was asked for; True without probes.
    advice : str
        When it is not: the knob that would help.
    worst_mm : ndarray of shape (3,), optional
        The probe at which the sum is most wrong, where lobes were made and not loaded.
    """

    lights: tuple[str, ...]
    lobes: tuple[Lobe, ...]
    error: MeasuredError | None
    plan: tuple[Decision, ...] = ()
    tolerance_met: bool = True
    advice: str = ""
    worst_mm: NDArray[np.float64] | None = None
