"""How much of each blurred texture of the lit side comes through a thickness of skin.

The published form reuses the reflectance profile, exp(-d^2 / 2v) for each Gaussian (theory.md 7.3), and is 2 to 3.5
times too dark. Here totals are those of transport through a slab of the medium itself, without light that passes
unscattered: that goes on in the beam's direction and is no light of the skin. The multipole says how it spreads, fitted
with the Gaussians that are at hand (theory.md 7.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.effective_medium import ETA, effective_medium
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.profile.slab import slab, unscattered
from skinbake.profile.slab_transport import SlabTransport, diffuse_mean, slab_transport

THINNEST_MM, THICKEST_MM, THICKNESSES = 0.1, 40.0, 96
DARK = 1e-3  # transmittance not worth a ray


@dataclass(frozen=True)
class SlabWeights:
    """Weights of the lobes by thickness.

    Attributes
    ----------
    thickness_mm : ndarray of shape (K,)
        Ascending, evenly spaced in the logarithm.
    weight_rgb : ndarray of shape (K, N, 3)
        To be multiplied with the N blurred textures at the lit side, of light from everywhere that counts by its
        incidence (theory.md 9.5); sums over N to T(d), scaled as the profile is.
    counted_rgb : ndarray of shape (K, M + 1, 3)
        Factors on the weights for light that entered at cosines 0, 1/(M-1), ... 1, and, last, from everywhere: 1.
    plain_rgb : ndarray of shape (K, M + 1, 3)
        The same for light of which incidence was not counted.
    """

    thickness_mm: Float
    weight_rgb: Float
    counted_rgb: Float
    plain_rgb: Float


def slab_weights(gaussians: GaussianSum, reflectance_rgb: Float, medium: SkinMedium | None = None) -> SlabWeights:
    """Transmittance T(r; d) of slabs of the skin's medium, or of the effective one, by the profile's own Gaussians.

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
        fills, g = layers[0].medium, layers[0].g
    else:
        fills, g = effective_medium(gaussians, reflectance_rgb, eta), 0.0
    return fit_slabs(gaussians, fills, eta, g)


def fit_slabs(gaussians: GaussianSum, medium: Medium, eta: float, g: float = 0.0) -> SlabWeights:
    """`slab_weights` for a given medium.

    Parameters
    ----------
    gaussians : GaussianSum
        The lobes whose weights are wanted.
    medium : Medium
    eta : float
        Index of the medium over that of air; media thinner than air count as air.
    g : float
        Henyey-Greenstein mean cosine.
    """
    thickness = np.geomspace(THINNEST_MM, THICKEST_MM, THICKNESSES)
    light = slab_transport(medium, max(eta, 1.0), thickness, g=g)
    profile_total = gaussians.weight_rgb.sum(axis=0)
    through, back = diffuse_mean(light.cosine, light.through.swapaxes(0, 1)), diffuse_mean(light.cosine, light.back)
    # What a lobe holds stands for light that the profile sends back, of which the medium lets T / R through. A white
    # profile is the medium's over its reflectance, which for a dark one lets many times the light through; painted with
    # a lighter albedo that would shine. No more leaves than arrives
    total = np.minimum(profile_total * safe_div(through, back), 1)
    weight = total[:, None] * _shapes(gaussians, medium, boundary_factor(eta), thickness)
    counted, plain = _slants(light, through, back, gaussians.normalise == "white")
    return SlabWeights(thickness, weight, counted, plain)


def _slants(light: SlabTransport, through: Float, back: Float, white: bool) -> tuple[Float, Float]:
    """Factors by cosine, (K, M + 1, 3), where incidence was counted and where it was not."""
    everywhere = np.ones((len(through), 1, 3))
    relative = safe_div(light.through, through[:, None])
    counted = relative * safe_div(back, light.back)
    # The profile's total is of light from everywhere if it is white, else of light along the normal
    reference = np.ones(3) if white else safe_div(back, light.back[-1])
    return np.concatenate([counted, everywhere], axis=1), reference * np.concatenate([relative, everywhere], axis=1)


def _shapes(gaussians: GaussianSum, medium: Medium, boundary: float, thickness_mm: Float) -> Float:
    """How what comes through is shared by the Gaussians, (K, N, 3), each sum 1.

    Non-negative least squares in the Hankel domain, r-weighted as the fit of R, with the total held.
    """
    frequency = np.concatenate([[0.0], np.geomspace(1e-2, 60.0, 200)])
    importance = np.sqrt(np.gradient(frequency) * frequency)
    importance[0] = 30 * importance.max()  # the total
    blur = np.exp(-0.5 * gaussians.variance_mm2[None] * frequency[:, None] ** 2) * importance[:, None]
    shape = np.zeros((len(thickness_mm), len(gaussians.variance_mm2), 3))
    for k, d in enumerate(thickness_mm):
        crossing = unscattered(medium, float(d), "ballistic")[:, None]
        transmitted = slab(medium, float(d), boundary, boundary, frequency[None], thin="ballistic").down_t
        scattered = np.maximum(transmitted - crossing, 0) / np.maximum(1 - crossing, 1e-12)
        for c in range(3):
            shape[k, :, c] = nnls(blur, scattered[c] / max(scattered[c, 0], 1e-300) * importance)[0]
    return safe_div(shape, shape.sum(axis=1, keepdims=True))
