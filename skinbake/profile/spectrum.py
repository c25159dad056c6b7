"""Linear RGB of a reflectance by wavelength."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float

WAVELENGTH_NM = np.arange(380.0, 781.0, 10.0)

# CIE standard illuminant D65, relative power every 10 nm from 380 to 780 nm [CIE15]
D65 = np.array(
    [
        49.9755,
        54.6482,
        82.7549,
        91.486,
        93.4318,
        86.6823,
        104.865,
        117.008,
        117.812,
        114.861,
        115.923,
        108.811,
        109.354,
        107.802,
        104.79,
        107.689,
        104.405,
        104.046,
        100,
        96.3342,
        95.788,
        88.6856,
        90.0062,
        89.5991,
        87.6987,
        83.2886,
        83.6992,
        80.0268,
        80.2146,
        82.2778,
        78.2842,
        69.7213,
        71.6091,
        74.349,
        61.604,
        69.8856,
        75.087,
        63.5927,
        46.4182,
        66.8054,
        63.3828,
    ]
)

# XYZ to linear Rec.709 / sRGB primaries with a D65 white [IEC61966]
_RGB_OF_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)


def _lobe(wavelength_nm: Float, centre: float, below: float, above: float) -> Float:
    """One lobe of the fit [Wyman2013]: a Gaussian of inverse width `below` on the left, `above` on the right, 1/nm."""
    slope = np.where(wavelength_nm < centre, below, above)
    return np.exp(-(((wavelength_nm - centre) * slope) ** 2) / 2)


def colour_matching(wavelength_nm: Float) -> Float:
    """CIE 1931 2-degree colour matching functions by their multi-lobe fit, shape (3, M).

    References
    ----------
    [Wyman2013]
    """
    w = wavelength_nm
    x = 0.362 * _lobe(w, 442.0, 0.0624, 0.0374) + 1.056 * _lobe(w, 599.8, 0.0264, 0.0323)
    x -= 0.065 * _lobe(w, 501.1, 0.0490, 0.0382)
    y = 0.821 * _lobe(w, 568.8, 0.0213, 0.0247) + 0.286 * _lobe(w, 530.9, 0.0613, 0.0322)
    z = 1.217 * _lobe(w, 437.0, 0.0845, 0.0278) + 0.681 * _lobe(w, 459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])


def reflectance_to_rgb() -> Float:
    """Matrix of shape (3, 41) from reflectance at WAVELENGTH_NM under D65 to linear Rec.709.

    Each row sums to 1, so that a white reflector is (1, 1, 1) whatever the last digits of the fitted functions. Deep
    red is outside Rec.709: green and blue of light that went far through blood may come out slightly negative.
    """
    rgb = _RGB_OF_XYZ @ (colour_matching(WAVELENGTH_NM) * D65)
    return rgb / rgb.sum(axis=1, keepdims=True)
