"""Surface sums at a few points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.surface_space.gather import SumRule, gather
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.surface_space.sources import LIGHT, SourceTree
from skinbake.numerics import Float


def surface_sums(
    sources: SourceTree,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    texel_mm2: NDArray[np.float32],
    variance_mm2: float,
    rule: SumRule,
    read: float = 0.0,
) -> Float:
    """One lobe by sums over the surface, (P, 3 L); zero where no skin is near.

    Parameters
    ----------
    sources : SourceTree
        Of this lobe.
    position, normal : ndarray of shape (P, 3), float32
    texel_mm2 : ndarray of shape (P,), float32
        Area of a texel at each point.
    variance_mm2 : float
        Of the lobe.
    rule : SumRule
    read : float, optional
        As of `gather`.
    """
    count = np.arange(len(position), dtype=np.int32)
    points = TexelPoints(count[:, None], count, position, normal, np.zeros(len(count), np.float32), texel_mm2)
    lights = (sources.leaf.shape[1] - LIGHT) // 3
    out = np.zeros((lights, len(position), 3), np.float32)
    gather(points, sources, variance_mm2, rule, out, read=read)
    return out.transpose(1, 0, 2).reshape(len(position), 3 * lights).astype(np.float64)
