"""IrradianceMap: light arriving at each texel of one tile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinbake.scene.decision import Decision


@dataclass(frozen=True)
class IrradianceMap:
    """Irradiance per light, zero where the atlas is empty.

    Attributes
    ----------
    tile : int
    lights : tuple of str
        Names, in the order of the look.
    rgb : ndarray of shape (L, H, W, 3), float32, or float16 where that is how it is stored
        Irradiance of each light, W/m^2-like, linear Rec.709; includes shadowing and, where the look says so,
        rho_dt(N.L) of the oil layer.
    visibility : ndarray of shape (L, H, W), the same
        Unshadowed share of each light, 0 ... 1; shadows the specular in the preview.
    coverage : ndarray of shape (H, W), float32
        As the atlas's.
    plan : mapping of light name to tuple of Decision
        Decisions on lights that leave something to decide.
    """

    tile: int
    lights: tuple[str, ...]
    rgb: NDArray[np.float32]
    visibility: NDArray[np.float32]
    coverage: NDArray[np.float32]
    plan: Mapping[str, tuple[Decision, ...]] = field(default_factory=dict)

    @property
    def total(self) -> NDArray[np.float32]:
        """Sum over the lights, (H, W, 3), float32."""
        return self.rgb.sum(axis=0, dtype=np.float32)

    @property
    def decided(self) -> tuple[Decision, ...]:
        """The plan's lines on all lights, in their order."""
        return tuple(line for name in self.lights for line in self.plan.get(name, ()))
