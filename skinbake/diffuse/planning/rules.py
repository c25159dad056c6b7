"""Rules that all plans share: which lobes need no blur, how small they are stored, how wide clusters may be."""

from __future__ import annotations

import numpy as np

_STORAGE_SHARE = 0.6  # of the tolerance
# Clusters of `spacing` sigma are wrong by this spacing^2, rms: 0.0014 on a scan whose texels vary 7.7 times, 0.004 on
# small hard-lit shapes
CLUSTER_ERROR = 0.002
_CLUSTER_SHARE = 0.4
MIN_SPACING, MAX_SPACING = 0.4, 1.5
IDENTITY_TEXELS2 = 1e-3  # below this variance a lobe changes no texel by more than 4 x 5e-4 of its contrast


def stored_level(
    bilinear_error: float, variance_mm2: float, mean_texel_mm2: float, tolerance: float, coarsest: int
) -> int:
    """How often a lobe's texture is halved, so that reading it bilinearly costs its share of the tolerance.

    Parameters
    ----------
    bilinear_error : float
        The method's own (`DiffusionMethod.bilinear_error`).
    variance_mm2 : float
        Of the lobe, > 0.
    mean_texel_mm2 : float
        Skin in a texel of the full size.
    tolerance : float
    coarsest : int
        The level beyond which it is not halved.
    """
    level = 0
    while level < coarsest:
        h2 = mean_texel_mm2 * 4 ** (level + 1)
        if bilinear_error * h2 / variance_mm2 > _STORAGE_SHARE * tolerance:
            break
        level += 1
    return level


def cluster_spacing(tolerance: float) -> float:
    """Side of the widest cluster, in sigma, whose error takes its share of the tolerance."""
    return float(np.clip(np.sqrt(_CLUSTER_SHARE * tolerance / CLUSTER_ERROR), MIN_SPACING, MAX_SPACING))
