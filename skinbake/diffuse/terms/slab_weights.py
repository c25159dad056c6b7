"""How much of the lit side's light comes through a thickness of skin.

The published form reuses the reflectance profile, exp(-d^2 / 2v) for each Gaussian (theory.md 7.3), and is 2 to 3.5
times too dark. Here it is that of transport through a slab of the medium itself, without light that passes unscattered:
that goes on in the beam's direction and is no light of the skin (theory.md 7.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.effective_medium import ETA, effective_medium
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.profile.slab_transport import SlabTransport, diffuse_mean, slab_transport

THINNEST_MM, THICKEST_MM, THICKNESSES = 0.1, 40.0, 96
DARK = 1e-3  # transmittance not worth a ray


@dataclass(frozen=True)
class SlabWeights:
    """Light that comes through, by thickness.

    Attributes
    ----------
    thickness_mm : ndarray of shape (K,)
        Ascending, evenly spaced in the logarithm.
    through_rgb : ndarray of shape (K, 3)
        T(d), scaled as the profile is: to be multiplied with light from everywhere at the lit side that counts by its
        incidence (theory.md 9.5).
    free_path_mm : float
        Of the medium, mean over the channels.
    counted_rgb : ndarray of shape (K, M + 1, 3)
        Factors on it for light that entered at cosines 0, 1/(M-1), ... 1, and, last, from everywhere: 1.
    plain_rgb : ndarray of shape (K, M + 1, 3)
        The same for light of which incidence was not counted.
    """

    thickness_mm: Float
    through_rgb: Float
    free_path_mm: float
    counted_rgb: Float
    plain_rgb: Float


def slab_weights(gaussians: GaussianSum, reflectance_rgb: Float, medium: SkinMedium) -> SlabWeights:
    """Transmittance T(d) of slabs of the skin's medium, or of the effective one.

    Parameters
    ----------
    gaussians : GaussianSum
    reflectance_rgb : ndarray of shape (3,)
        By which an effective medium is found.
    medium : SkinMedium
        The skin's: taken as it is where it fills the head, its index where it has several layers.
    """
    layers = medium.layers
    eta = layers[0].eta if layers else ETA
    if len(layers) == 1 and medium.to_rgb is None and np.isinf(layers[0].thickness_mm):
        fills, g = layers[0].medium, layers[0].g
    else:
        fills, g = effective_medium(gaussians, reflectance_rgb, eta), 0.0
    return fit_slabs(gaussians, fills, eta, g)


def fit_slabs(gaussians: GaussianSum, medium: Medium, eta: float, g: float = 0.0) -> SlabWeights:
    """`slab_weights` for a given medium.

    Parameters
    ----------
    gaussians : GaussianSum
        The profile.
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
    counted, plain = _slants(light, through, back, gaussians.normalise == "white")
    return SlabWeights(thickness, total, float(medium.free_path_mm.mean()), counted, plain)


def _slants(light: SlabTransport, through: Float, back: Float, white: bool) -> tuple[Float, Float]:
    """Factors by cosine, (K, M + 1, 3), where incidence was counted and where it was not."""
    everywhere = np.ones((len(through), 1, 3))
    relative = safe_div(light.through, through[:, None])
    counted = relative * safe_div(back, light.back)
    # The profile's total is of light from everywhere if it is white, else of light along the normal
    reference = np.ones(3) if white else safe_div(back, light.back[-1])
    return np.concatenate([counted, everywhere], axis=1), reference * np.concatenate([relative, everywhere], axis=1)
