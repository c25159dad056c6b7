"""Two small skies of our own making: a photographer's studio, and a sunset over open land."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_map import direction_of
from skinbake.numerics import Float, normalized

Image = NDArray[np.float32]
ROWS = 128
GROUND_RGB = (0.055, 0.048, 0.042)


def sky_names() -> tuple[str, ...]:
    """Names that `made_sky` knows."""
    return tuple(_SKIES)


def made_sky(name: str) -> Image:
    """Equirectangular radiance, (128, 256, 3).

    Parameters
    ----------
    name : "studio" or "sunset"

    Raises
    ------
    KeyError
        Another name.
    """
    u, v = np.meshgrid((np.arange(2 * ROWS) + 0.5) / (2 * ROWS), 1 - (np.arange(ROWS) + 0.5) / ROWS)
    return np.asarray(_SKIES[name](direction_of(u, v)), np.float32)


def _studio(towards: Float) -> Float:
    """A warm key box to the left, a large cool fill, a strip behind, in a dark room."""
    room = np.array([0.030, 0.031, 0.034])
    sky = np.broadcast_to(room, towards.shape) * (1 + 0.6 * towards[..., 1:2])
    for middle, width_deg, height_deg, radiance in (
        ((-0.66, 0.42, 0.62), 38.0, 52.0, (6.2, 5.7, 5.0)),
        ((0.86, 0.12, 0.50), 60.0, 70.0, (0.42, 0.47, 0.56)),
        ((0.62, 0.28, -0.74), 14.0, 70.0, (5.0, 5.5, 6.4)),
        ((-0.05, 0.97, 0.22), 30.0, 20.0, (1.5, 1.5, 1.5)),
    ):
        sky = sky + _box(towards, middle, width_deg, height_deg)[..., None] * np.array(radiance)
    return sky


def _sunset(towards: Float) -> Float:
    """A low sun in haze to the left of the head, a sky from orange to blue, dark ground."""
    sun = normalized((-0.80, 0.13, 0.58))
    height, near = towards[..., 1:2], np.clip(towards @ sun, -1, 1)[..., None]
    zenith, horizon = np.array([0.085, 0.150, 0.330]), np.array([0.78, 0.40, 0.20])
    away = np.array([0.26, 0.24, 0.33])  # of the horizon opposite the sun
    low = away + (horizon - away) * (0.5 + 0.5 * near) ** 2
    sky = zenith + (low - zenith) * np.exp(-4.5 * np.maximum(height, 0))
    sky = sky + np.exp(-((1 - near) / 0.012)) * np.array([9.0, 4.6, 1.7])  # glow
    sky = sky + np.clip((0.0015 - (1 - near)) / 0.0006, 0, 1) * np.array([620.0, 300.0, 105.0])
    ground = np.array(GROUND_RGB) * (1 + 1.5 * (0.5 + 0.5 * near) ** 2)
    share = np.clip(height / 0.02 + 0.5, 0, 1)
    return sky * share + ground * (1 - share)


_SKIES = {"studio": _studio, "sunset": _sunset}


def _box(towards: Float, middle: tuple[float, float, float], width_deg: float, height_deg: float) -> Float:
    """Share of an upright soft box in each direction, with edges a texel wide, (h, w).

    Parameters
    ----------
    towards : ndarray of shape (h, w, 3)
    middle : (x, y, z)
        Where it stands.
    width_deg, height_deg : float
    """
    axis = normalized(middle)
    across = normalized(np.cross((0.0, 1.0, 0.0), axis))
    facing, edge = np.maximum(towards @ axis, 1e-6), np.pi / ROWS
    inside = (towards @ axis > 0).astype(np.float64)
    for direction, degrees in ((across, width_deg), (np.cross(axis, across), height_deg)):
        half = np.tan(np.radians(degrees / 2))
        inside *= np.clip((half - np.abs(towards @ direction) / facing) / edge + 0.5, 0, 1)
    return inside
