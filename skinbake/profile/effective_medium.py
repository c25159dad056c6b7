"""One homogeneous medium that stands for skin of layers or wavelengths, for terms that know one free path only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.dipole import albedo_of_total
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium

ETA = 1.4  # of skin that does not say


def one_layer(medium: SkinMedium, gaussians: GaussianSum) -> Layer | str:
    """The skin's layer where it has one of R, G and B, else the effective one of its profile; or why there is none.

    Against walks through three layers that took a profile's distance at shadow edges from 13 / 10 / 6 to 7 / 6 / 5 %
    (R, G, B) on the sample head (docs/accuracy.md).

    Parameters
    ----------
    medium : SkinMedium
    gaussians : GaussianSum
        Its profile; of skin that maps vary that of their means.
    """
    if not medium.layers:
        return medium.why
    first = medium.layers[0]
    if len(medium.layers) == 1 and medium.to_rgb is None:
        return first
    if medium.named:
        return "several layers that are only named have other lengths than the profile"
    wide = gaussians.variance_mm2 > 0
    scattered = replace(
        gaussians, variance_mm2=gaussians.variance_mm2[wide], weight_rgb=gaussians.weight_rgb[wide], table=None
    )
    return Layer(effective_medium(scattered, gaussians.energy_rgb, first.eta), np.inf, first.eta)


def effective_medium(gaussians: GaussianSum, reflectance_rgb: Float, eta: float = ETA) -> Medium:
    """Homogeneous medium with a given reflectance and with the mean square radius of a profile.

    The dipole's albedo follows from its reflectance (theory.md 2.3); its second moment, from 2.6, then sets the scale.

    Parameters
    ----------
    gaussians : GaussianSum
    reflectance_rgb : ndarray of shape (3,)
    eta : float
        Index of the medium over that of air.
    """
    boundary = boundary_factor(eta)
    sigma_a, sigma_sp = np.zeros(3), np.zeros(3)
    for c in range(3):
        target = float(np.clip(reflectance_rgb[c], 0.01, 0.98))
        absorbed = 1 - albedo_of_total(target, boundary)
        # -4 d/d(s^2) of ln R~ at s = 0, in free paths: sources at depth 1 and 1 + 4A/3
        depth = np.array([1.0, 1 + 4 * boundary / 3])
        decay = np.sqrt(3 * absorbed)
        share = np.exp(-decay * depth)
        radius2 = 2 / decay * (depth * share).sum() / share.sum()
        weight = gaussians.weight_rgb[:, c]
        wanted2 = 2 * float((weight * gaussians.variance_mm2).sum() / max(weight.sum(), 1e-12))
        sigma_tp = np.sqrt(radius2 / max(wanted2, 1e-12))
        sigma_a[c], sigma_sp[c] = absorbed * sigma_tp, (1 - absorbed) * sigma_tp
    return Medium(sigma_a, sigma_sp)
