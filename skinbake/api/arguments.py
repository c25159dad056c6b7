"""Arguments of the Python interface, checked: lights that come later, and gains."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.relight.relit import Sun
from skinbake.scene.strict import LARGEST

Image = NDArray[np.float32]


def sky_of(environment: Path | str | Image) -> Image:
    """Radiance (h, w, 3) of a file, or as it was given.

    Raises
    ------
    InputError
        It is none.
    """
    if isinstance(environment, Path | str):
        from skinbake.io.environment import read_sky

        return read_sky(environment)
    sky = _numbers(environment)
    if sky is None or sky.ndim != 3 or sky.shape[2] != 3 or not sky.size or not ((sky >= 0) & (sky <= LARGEST)).all():
        got = environment if sky is None else f"shape {sky.shape}"
        raise InputError(f"environment: expected finite radiance >= 0 of shape (h, w, 3), got {got}")
    return sky.astype(np.float32)


def checked_suns(suns: Sequence[Sun]) -> list[Sun]:
    """Suns of a direction and three numbers, not below 0.

    Raises
    ------
    InputError
        One is something else.
    """
    expected = "suns: expected a list of (direction, irradiance_rgb), three finite numbers each, irradiance >= 0"
    try:
        pairs = [(sun, [_numbers(part) for part in sun]) for sun in suns]
    except TypeError:
        raise InputError(f"{expected}, got {suns}") from None
    checked = []
    for sun, parts in pairs:
        found = [part for part in parts if part is not None and part.shape == (3,) and (abs(part) <= LARGEST).all()]
        if not len(found) == len(parts) == 2 or (found[1] < 0).any():
            raise InputError(f"{expected}, got {sun}")
        if abs(found[0]).max() < 1 / LARGEST:
            raise InputError(f"suns: expected a direction in which light travels, got {sun}, whose direction is zero")
        checked.append((found[0].tolist(), found[1].tolist()))
    return checked


def checked_turn(rotate_deg: float) -> float:
    """A finite angle.

    Raises
    ------
    InputError
        It is none.
    """
    turn = _numbers(rotate_deg)
    if turn is None or turn.ndim or not np.isfinite(turn):
        raise InputError(f"rotate_deg: expected a finite number, got {rotate_deg}")
    return float(turn)


def checked_gain(name: str, gain: float | Sequence[float]) -> Image:
    """A gain as R, G, B.

    Raises
    ------
    InputError
        It is none, or below 0.
    """
    factor = _numbers(gain)
    if factor is None or factor.shape not in ((), (1,), (3,)) or not ((factor >= 0) & (factor <= LARGEST)).all():
        raise InputError(f"gains: {name}: expected a number from 0 up, or three for R, G, B, got {gain}")
    return np.broadcast_to(factor, 3).astype(np.float32)


def _numbers(value: object) -> Float | None:
    """A value as an array; None where it is no numbers, text among it."""
    try:
        found = np.asarray(value)
        return found.astype(np.float64) if found.dtype.kind in "biuf" else None
    except (TypeError, ValueError):  # of uneven lengths
        return None
