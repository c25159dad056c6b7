"""Lights that no basis was made from, by which it is judged: skies, soft boxes, suns, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_map import direction_of
from skinbake.numerics import Float, normalized
from skinbake.relight.harmonics import harmonics, harmonics_of_sky
from skinbake.scene.lights import DirectionalLight, EnvironmentLight

Image = NDArray[np.float32]
SKIES, SOFT_BOXES, SUNS = 16, 16, 64
SOFT_BOX_DEG = 10.0
SKY_ROWS = 64
SKY_SAMPLES, BOX_SAMPLES = 64, 18  # directions that each of two direct bakes traces
JUDGING, CHOOSING = 21, 22  # streams of a seed: lights that a basis is chosen by never judge it


@dataclass(frozen=True)
class UnseenLight:
    """One light.

    Attributes
    ----------
    kind : "skies", "soft_boxes" or "suns"
    light : DirectionalLight or EnvironmentLight
    radiance : ndarray of shape (h, w, 3), optional
        Of an environment.
    """

    kind: str
    light: DirectionalLight | EnvironmentLight
    radiance: Image | None = None

    @property
    def drawn_again(self) -> UnseenLight | None:
        """The same sky by other directions; None of a sun, which has one."""
        if self.radiance is None:
            return None
        return replace(self, light=self.light.model_copy(update={"name": f"{self.light.name}-again"}))

    def harmonics(self, order: int) -> Float:
        """Its products with harmonics, ((order + 1)^2, 3)."""
        if self.radiance is not None:
            return harmonics_of_sky(self.radiance, order)
        assert isinstance(self.light, DirectionalLight)
        return harmonics(-normalized(self.light.direction)[None], order).T * np.asarray(self.light.irradiance)


def unseen_lights(seed: int) -> tuple[UnseenLight, ...]:
    """16 skies of gradients and soft boxes of 8 to 40 degrees, 16 soft boxes of 10 degrees, 64 suns."""
    rng = np.random.default_rng([seed, JUDGING])
    found = []
    for i in range(SKIES):
        light = EnvironmentLight(name=f"sky-{i}", type="environment", path="seeded", samples=SKY_SAMPLES)
        found.append(UnseenLight("skies", light, _sky(rng)))
    for i in range(SOFT_BOXES):
        light = EnvironmentLight(name=f"soft-box-{i}", type="environment", path="seeded", samples=BOX_SAMPLES)
        found.append(UnseenLight("soft_boxes", light, _soft_box(_unit(rng), SOFT_BOX_DEG)))
    for i in range(SUNS):
        x, y, z = (float(value) for value in _unit(rng))
        sun = DirectionalLight(name=f"sun-{i}", type="directional", direction=(x, y, z), irradiance=(1.0, 1.0, 1.0))
        found.append(UnseenLight("suns", sun))
    return tuple(found)


def choosing_skies(seed: int, count: int) -> list[Image]:
    """Radiance maps of other skies of the same kind."""
    rng = np.random.default_rng([seed, CHOOSING])
    return [_sky(rng) for _ in range(count)]


def _unit(rng: np.random.Generator) -> Float:
    """A direction, any as likely."""
    return np.asarray(normalized(rng.standard_normal(3)))


def _towards() -> Float:
    """Directions that the texels of a sky show, (h, w, 3)."""
    u, v = np.meshgrid((np.arange(2 * SKY_ROWS) + 0.5) / (2 * SKY_ROWS), 1 - (np.arange(SKY_ROWS) + 0.5) / SKY_ROWS)
    return direction_of(u, v)


def _soft_box(middle: Float, across_deg: float) -> Image:
    """A square light on black whose irradiance on a plane that faces it is about 1, (h, w, 3); its edges are soft."""
    along = normalized(np.cross(middle, (0.0, 0.0, 1.0) if abs(middle[2]) < 0.9 else (1.0, 0.0, 0.0)))
    towards = _towards()
    facing = np.maximum(towards @ middle, 1e-6)
    half, edge = np.tan(np.radians(across_deg / 2)), np.radians(180 / SKY_ROWS)
    inside = np.ones(towards.shape[:2])
    for axis in (along, np.cross(middle, along)):
        inside *= np.clip((half - np.abs(towards @ axis) / facing) / edge + 0.5, 0, 1)
    inside[towards @ middle <= 0] = 0
    return np.repeat((inside / np.radians(across_deg) ** 2)[..., None], 3, axis=2).astype(np.float32)


def _sky(rng: np.random.Generator) -> Image:
    """A gradient along some axis, and two to five soft boxes that together send about as much."""
    axis, slope, level = _unit(rng), rng.uniform(0, 1), rng.uniform(0.15, 0.45)
    sky = np.repeat((level * (1 + slope * (_towards() @ axis)))[..., None], 3, axis=2).astype(np.float32)
    for _ in range(rng.integers(2, 6)):
        sky += np.float32(rng.uniform(0.3, 1.5)) * _soft_box(_unit(rng), rng.uniform(8, 40))
    return sky
