"""How much of each blurred texture of the lit side comes through a thickness of skin.

The published form reuses the reflectance profile, exp(-d^2 / 2v) for each Gaussian (theory.md 7.3), and is 2 to 3.5
times too dark. Here the transmittance of the slab itself is fitted with the Gaussians that are at hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, nnls

from skinbake.numerics import Float
from skinbake.profile import GaussianSum
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.profile.slab import half_space, slab

ETA = 1.4  # of skin that does not say
THINNEST_MM, THICKEST_MM, THICKNESSES = 0.1, 40.0, 48
DARK = 1e-3  # transmittance not worth a ray


@dataclass(frozen=True)
class SlabWeights:
    """Weights of the lobes by thickness.

    Attributes
    ----------
    thickness_mm : ndarray of shape (K,)
        Ascending, evenly spaced in the logarithm.
    weight_rgb : ndarray of shape (K, N, 3)
        To be multiplied with the N blurred textures at the lit side; sums over N to T(d), scaled as the profile is.
    """

    thickness_mm: Float
    weight_rgb: Float


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

        def dipole_total(log_absorbed: float, target: float = target) -> float:
            absorbed = np.exp(log_absorbed)
            x, b = np.sqrt(3 * absorbed), 4 * boundary / 3
            return (1 - absorbed) / 2 * (np.exp(-x) + np.exp(-x * (1 + b))) - target

        absorbed = float(np.exp(brentq(dipole_total, np.log(1e-12), np.log(1 - 1e-9))))
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


def slab_weights(gaussians: GaussianSum, reflectance_rgb: Float, medium: SkinMedium | None = None) -> SlabWeights:
    """Fit T(r; d) of slabs of the skin's medium, or of the effective one, with the profile's own Gaussians.

    Non-negative least squares in the Hankel domain, r-weighted as the fit of R, with the total held. Thin slabs let
    unscattered light pass ("ballistic"): closest to Monte Carlo at a millimetre, and monotone in the thickness.

    Parameters
    ----------
    gaussians : GaussianSum
    reflectance_rgb : ndarray of shape (3,)
        By which an effective medium is found.
    medium : SkinMedium, optional
        The skin's: taken as it is where it fills the head, its index where it has several layers.
    """
    layers = medium.layers if medium else ()
    eta = layers[0].eta if layers else ETA
    if medium and len(layers) == 1 and medium.to_rgb is None and np.isinf(layers[0].thickness_mm):
        fills = layers[0].medium
    else:
        fills = effective_medium(gaussians, reflectance_rgb, eta)
    weights = fit_slabs(gaussians, fills, boundary_factor(eta))
    # A white profile is the medium's over its reflectance, which for a dark one lets many times the light through;
    # painted with a lighter albedo that would shine. No more leaves than arrives
    total = weights.weight_rgb.sum(axis=1, keepdims=True)
    return SlabWeights(weights.thickness_mm, weights.weight_rgb / np.maximum(total, 1))


def fit_slabs(gaussians: GaussianSum, medium: Medium, boundary: float) -> SlabWeights:
    """`slab_weights` for a given medium and boundary factor A of both faces.

    Parameters
    ----------
    gaussians : GaussianSum
        The lobes whose weights are wanted.
    medium : Medium
    boundary : float
        A.
    """
    thickness = np.geomspace(THINNEST_MM, THICKEST_MM, THICKNESSES)
    frequency = np.concatenate([[0.0], np.geomspace(1e-2, 60.0, 200)])
    importance = np.sqrt(np.gradient(frequency) * frequency)
    importance[0] = 30 * importance.max()  # the total
    blur = np.exp(-0.5 * gaussians.variance_mm2[None] * frequency[:, None] ** 2)
    reflected, _ = half_space(medium, boundary, np.zeros((1, 1)))
    scale = gaussians.weight_rgb.sum(axis=0) / reflected[:, 0]
    weight = np.zeros((THICKNESSES, len(gaussians.variance_mm2), 3))
    for k, d in enumerate(thickness):
        transmitted = slab(medium, float(d), boundary, boundary, frequency[None], thin="ballistic").down_t
        for c in range(3):
            weight[k, :, c] = scale[c] * nnls(blur * importance[:, None], transmitted[c] * importance)[0]
    return SlabWeights(thickness, weight)
