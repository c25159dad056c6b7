"""How much of a skin's light comes through its thin parts, by which `auto` decides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

Image = NDArray[np.float32]
SEEN_SHARE = 0.001  # of the skin: `auto` looks at the brightest part of that size


def contribution(
    through: Sequence[tuple[Image, Image]], reflected: Sequence[tuple[Image, Image]], skin_mm2: float
) -> tuple[float, float]:
    """Rms of the transmitted over the reflected light, and its value in the brightest part over the mean reflected.

    Parameters
    ----------
    through : sequence of (ndarray of shape (n,), ndarray of shape (n,))
        Transmitted light, of all lights and channels, where there is any, and the areas that has; a tile each.
    reflected : sequence of (ndarray of shape (m,), ndarray of shape (m,))
        Reflected light at a sample of texels, and the areas they stand for.
    skin_mm2 : float
        Of all skin.
    """
    light, through_mm2 = _joined(through)
    sample, sample_mm2 = _joined(reflected)
    if sample_mm2.sum() == 0:
        return 0.0, 0.0
    mean = (sample_mm2 * sample).sum() / sample_mm2.sum()
    if mean <= 0:
        return 0.0, 0.0
    mean_square = (sample_mm2 * sample**2).sum() / sample_mm2.sum()
    rms = np.sqrt((through_mm2 * light**2).sum() / skin_mm2 / max(mean_square, 1e-300))
    order = np.argsort(-light)
    reached = np.searchsorted(np.cumsum(through_mm2[order]), SEEN_SHARE * skin_mm2)
    return float(rms), float(light[order[reached]] / mean) if reached < len(order) else 0.0


def _joined(tiles: Sequence[tuple[Image, Image]]) -> tuple[Float, Float]:
    """Values and areas of all tiles, (n,) each."""
    light, area = (np.concatenate(part).astype(np.float64) for part in zip(*tiles, strict=True))
    return light, area
