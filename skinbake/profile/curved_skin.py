"""Skin that is not flat: a round form sends back more of the light that entered than a plane does, a hollow less.

Light that has scattered below a convex face finds the face nearer on all sides, and leaves before it is absorbed. How
much, is told by the rate at which light from everywhere dies away below the face (theory.md 9.8).
"""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.medium import Medium


def first_depth_mm(medium: Medium, eta: float) -> Float:
    """Mean depth at which light from everywhere first scatters, mm, (C,): a free path times its mean cosine inside."""
    node, weight = np.polynomial.legendre.leggauss(48)
    mu, weight = (node + 1) / 2, weight / 2
    return medium.free_path_mm * float((2 * mu * np.sqrt(1 - (1 - mu**2) / max(eta, 1.0) ** 2) * weight).sum())


def curved_gain(medium: Medium, eta: float, slower_per_mm: Float) -> Float:
    """What skin of any form sends back over what a plane does, (n, C), lit from everywhere on all its sides.

    Parameters
    ----------
    medium : Medium
    eta : float
        Index inside over that of the outside.
    slower_per_mm : ndarray of shape (n,) or (n, C)
        By how much light dies away more slowly below the face than below a plane: of a large ball 1 / radius, below 0
        in a hollow, never more than sigma_tr.
    """
    depth, kappa = first_depth_mm(medium, eta), medium.sigma_tr_per_mm
    beyond = medium.extrapolation_mm(boundary_factor(eta))
    slower = slower_per_mm if slower_per_mm.ndim == 2 else slower_per_mm[:, None]
    slower = np.minimum(slower, kappa)
    gain: Float = (1 + beyond * kappa) / (1 + beyond * (kappa - slower)) * np.exp(slower * depth)
    return gain


def through_curved(medium: Medium, eta: float, decay_per_mm: Float, thickness_mm: Float) -> Float:
    """What `curved_gain` says of a slab lit from everywhere on one side: what leaves by the other, (K, C), over what a
    plane sends back.

    Half of what leaves of a slab that is lit alike on both sides, less what leaves where one side has as much less than
    nothing. It is too dark, by a third in green skin of 3 mm: diffusion theory lets light die away too fast there.

    Parameters
    ----------
    medium : Medium
    eta : float
    decay_per_mm : ndarray of shape (C,)
        Below a plane.
    thickness_mm : ndarray of shape (K,)
    """
    half = np.tanh(decay_per_mm * thickness_mm[:, None] / 2)
    alike, opposed = (curved_gain(medium, eta, decay_per_mm * (1 - rate)) for rate in (half, 1 / half))
    through: Float = (alike - opposed) / 2
    return through


def curved_share(gaussians: GaussianSum, medium: Medium, eta: float) -> Float:
    """How the gain is shared by the Gaussians, (N, 3): a lobe is multiplied by 1 + share (gain - 1).

    What a curved face adds has gone far: narrow lobes have none of it, wide ones several times the mean, and the sum of
    share times weight is that of the weights.

    Parameters
    ----------
    gaussians : GaussianSum
    medium : Medium
    eta : float
    """
    from scipy.optimize import nnls

    frequency = np.concatenate([[0.0], np.geomspace(1e-2, 60.0, 200)])
    importance = np.sqrt(np.gradient(frequency) * frequency)
    importance[0] = 30 * importance.max()  # the total
    blur = np.exp(-0.5 * gaussians.variance_mm2[None] * frequency[:, None] ** 2)
    depth, beyond = first_depth_mm(medium, eta), medium.extrapolation_mm(boundary_factor(eta))
    g = np.sqrt(medium.sigma_tr_per_mm**2 + frequency[:, None] ** 2)
    g = np.maximum(g, 1e-6)
    # Change of the logarithm of R~ with curvature, to first order
    waves = 1 - frequency[:, None] ** 2 / (2 * g**2)
    slope = depth * (waves - frequency[:, None] ** 2 * depth / (2 * g)) + beyond * waves / (1 + beyond * g)
    share = np.zeros_like(gaussians.weight_rgb)
    for c in range(share.shape[1]):
        weight = gaussians.weight_rgb[:, c]
        wanted = (blur @ weight) * np.maximum(slope[:, c], 0) / slope[0, c] * importance
        found = nnls(blur * importance[:, None], wanted)[0]
        share[:, c] = safe_div(found, weight) * safe_div(weight.sum(), found.sum())
    return share
