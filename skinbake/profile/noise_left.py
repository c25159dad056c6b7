"""What scattering leaves of noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum


def noise_left(gaussians: GaussianSum, texels_per_mm2: ArrayLike) -> Float:
    """Rms that white noise of rms 1 a texel has once it is scattered, shape (N, 3); theory.md 10.2.

    Parameters
    ----------
    gaussians : GaussianSum
    texels_per_mm2 : array_like of shape (N,)
        0 where texels are so large that nothing is smoothed.
    """
    density = np.atleast_1d(np.asarray(texels_per_mm2, dtype=np.float64))
    both = (gaussians.variance_mm2[:, None] + gaussians.variance_mm2[None, :]).ravel()
    weight = (gaussians.weight_rgb[:, None, :] * gaussians.weight_rgb[None, :, :]).reshape(-1, 3)
    return np.sqrt(np.maximum((1 / (1 + 2 * np.pi * density[:, None] * both)) @ weight, 0.0))
