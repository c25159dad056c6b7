"""How much of a skin's light comes through its thin parts, by which `auto` decides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

Image = NDArray[np.float32]
SEEN_SHARE = 0.001  # of the skin: `auto` looks at the brightest part of that size
LEAST_LIT = 0.01  # of the skin that a light falls on, as if evenly: of less its own error is not known, nor measured


def contribution(
    through: Sequence[tuple[Image, Image]], reflected: Sequence[tuple[Image, Image]], skin_mm2: float
) -> tuple[Float, float, Float]:
    """Rms of each light's transmitted over its reflected light, and the peak of all over the mean reflected.

    Parameters
    ----------
    through : sequence of (ndarray of shape (L, n, 3), ndarray of shape (n,))
        Transmitted light, where there is any, and the areas that has; a tile each.
    reflected : sequence of (ndarray of shape (L, m, 3), ndarray of shape (m,))
        Reflected light at a sample of texels, and the areas they stand for.
    skin_mm2 : float
        Of all skin.

    Returns
    -------
    rms : ndarray of shape (L,)
        Each light may be the only one that shines; 0 of one that falls on next to no skin.
    peak : float
        Of all lights, in the brightest part.
    reflected : ndarray of shape (L,)
        Rms of the reflected light; of infinity where the first is 0 for that.
    """
    light, through_mm2 = _joined(through)
    sample, sample_mm2 = _joined(reflected)
    none = np.full(len(sample), np.inf)
    sample_mm2 = sample_mm2 / max(sample_mm2.sum(), 1e-300)
    mean = (sample_mm2 * sample.sum(axis=(0, 2))).sum()
    if mean <= 0:
        return np.zeros(len(sample)), 0.0, none
    square = (sample**2).sum(axis=2)
    mean_square, fourth = (sample_mm2 * square).sum(axis=1), (sample_mm2 * square**2).sum(axis=1)
    lit = mean_square**2 > LEAST_LIT * fourth
    of_light = np.where(lit, np.sqrt(mean_square), none)
    rms = np.sqrt((through_mm2 * (light**2).sum(axis=2)).sum(axis=1) / skin_mm2) / of_light
    whole = light.sum(axis=(0, 2))
    order = np.argsort(-whole)
    reached = np.searchsorted(np.cumsum(through_mm2[order]), SEEN_SHARE * skin_mm2)
    return rms, float(whole[order[reached]] / mean) if reached < len(order) else 0.0, of_light


def _joined(tiles: Sequence[tuple[Image, Image]]) -> tuple[Float, Float]:
    """Values (L, n, 3) and areas (n,) of all tiles."""
    light, area = zip(*tiles, strict=True)
    return np.concatenate(light, axis=1).astype(np.float64), np.concatenate(area).astype(np.float64)
