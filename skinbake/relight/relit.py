"""Light that comes later: a sky and suns as coefficients of a basis, and M under them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float, normalized
from skinbake.relight.basis import LightBasis
from skinbake.relight.grey_lights import summed
from skinbake.relight.harmonics import harmonics, harmonics_of_sky, turned

Image = NDArray[np.float32]
Sun = tuple[Sequence[float], Sequence[float]]  # where its light travels, as in a look, and its irradiance R, G, B


def harmonics_of_suns(suns: Sequence[Sun], order: int) -> Float:
    """Products of suns with the harmonics, ((order + 1)^2, 3).

    Parameters
    ----------
    suns : sequence of (direction, irradiance_rgb)
        Directions need not be unit.
    order : int
    """
    out = np.zeros(((order + 1) ** 2, 3))
    for direction, irradiance in suns:
        out += harmonics(-normalized(direction)[None], order).T * np.asarray(irradiance, np.float64)
    return out


def light_coefficients(
    basis: LightBasis, sky: Image | None = None, rotate_deg: float = 0.0, suns: Sequence[Sun] = ()
) -> Float:
    """How much of each light of a basis there is, by channel, (K, 3).

    Parameters
    ----------
    basis : LightBasis
    sky : ndarray of shape (h, w, 3), optional
        Equirectangular radiance.
    rotate_deg : float
        Turns sky and suns about +y, +z towards +x.
    suns : sequence of (direction, irradiance_rgb)
    """
    light = harmonics_of_suns(suns, basis.order)
    if sky is not None:
        light += harmonics_of_sky(sky, basis.order)
    return np.einsum("kj,jc->kc", basis.of_harmonics, turned(light, rotate_deg))


def relit(textures: NDArray[np.floating], basis: LightBasis, coefficients: Float) -> Image:
    """Light that leaves, M, at least 0, (H, W, 3).

    Parameters
    ----------
    textures : ndarray of shape (T, H, W, 3), float16 or float32
    basis : LightBasis
        Whose textures they are.
    coefficients : ndarray of shape (K, 3)
    """
    out = summed(textures, basis, coefficients)
    return np.maximum(out, 0, out=out)
