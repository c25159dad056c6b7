"""Three lights in a texture: what most lights leave differs in how bright a place is, not in its colour.

The first lights of a fitted basis have textures in colour, one each. Of every further light a texture's channel holds
how bright it leaves each place; there it has the colour that the first light, which comes from nearly everywhere,
leaves. Theory.md 10.6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.relight.basis import EACH, LightBasis

Image = NDArray[np.float32]
IN_COLOUR = 4  # one texture of so many holds a light in colour
LEAST = np.float32(1e-20)  # no light: such a place is black, whatever its colour


def lights_in(textures: int) -> tuple[int, int]:
    """How many lights so many textures of a fitted basis hold: in colour, and grey."""
    coloured = -(-textures // IN_COLOUR)
    return coloured, EACH * (textures - coloured)


def tint_of(first: Image) -> Image:
    """Colour of each place, of mean 1 over its channels, by what the first light leaves there, (..., 3)."""
    return np.asarray(first / np.maximum(first.mean(axis=-1, keepdims=True), LEAST))


def keep_light(textures: Image, basis: LightBasis, number: int, image: Image) -> None:
    """Write what a light leaves into its place among the textures; the first light comes first.

    Parameters
    ----------
    textures : ndarray of shape (T, H, W, 3), float32, written
    basis : LightBasis
    number : int
        Of the light.
    image : ndarray of shape (H, W, 3), float32
    """
    if number < basis.in_colour:
        textures[number] = image
        return
    place, channel = divmod(number - basis.in_colour, EACH)
    parallel_for(_keep, len(image), image, textures[0], textures[basis.in_colour + place, ..., channel])


@kernel
def _keep(first: int, stop: int, image: Image, coloured: Image, out: Image) -> None:
    """Write the factors of a tint that are nearest to an image.

    Parameters
    ----------
    first, stop : int
        Rows.
    image : ndarray of shape (H, W, 3)
    coloured : ndarray of shape (H, W, 3)
        What the first light leaves.
    out : ndarray of shape (H, W)
        Written.
    """
    for row in range(first, stop):
        for col in range(out.shape[1]):
            along, square, mean = 0.0, 0.0, 0.0
            for c in range(3):
                along += np.float64(image[row, col, c]) * coloured[row, col, c]
                square += np.float64(coloured[row, col, c]) * coloured[row, col, c]
                mean += coloured[row, col, c] / 3.0
            out[row, col] = along / square * mean if square > 0.0 else 0.0


def texture_gains(basis: LightBasis, coefficients: Float) -> tuple[Float, Float]:
    """Factors on the textures of a basis.

    Parameters
    ----------
    basis : LightBasis
    coefficients : ndarray of shape (K, 3)
        How much of each light there is, by channel.

    Returns
    -------
    coloured : ndarray of shape (C, 3)
        Of each channel of the textures in colour.
    grey : ndarray of shape (G, 3, 3)
        Of each light of the others, by channel of the tint.
    """
    coloured = basis.in_colour
    return coefficients[:coloured], coefficients[coloured:].reshape(-1, EACH, 3)


def summed(textures: NDArray[np.floating], basis: LightBasis, coefficients: Float) -> Image:
    """Light of a basis's textures, (H, W, 3); below 0 where the series of a hard light rings.

    Parameters
    ----------
    textures : ndarray of shape (T, H, W, 3), float16 or float32
    basis : LightBasis
    coefficients : ndarray of shape (K, 3)
    """
    coloured, grey = texture_gains(basis, coefficients.astype(np.float32))
    out = np.zeros(textures.shape[1:], np.float32)
    for texture, gain in zip(textures[len(coloured) :], grey, strict=True):
        parallel_for(_add, len(out), np.asarray(texture, np.float32), gain, out)
    if len(grey):
        out *= tint_of(np.asarray(textures[0], np.float32))
    for texture, amount in zip(textures[: len(coloured)], coloured, strict=True):
        parallel_for(_add, len(out), np.asarray(texture, np.float32), np.diag(amount), out)
    return out


@kernel
def _add(first: int, stop: int, texture: Image, gain: Image, out: Image) -> None:
    """Add a texture times a matrix.

    Parameters
    ----------
    first, stop : int
        Rows.
    texture : ndarray of shape (H, W, 3)
    gain : ndarray of shape (3, 3)
        By channel of the texture and of `out`.
    out : ndarray of shape (H, W, 3)
        Added to.
    """
    for row in range(first, stop):
        for col in range(out.shape[1]):
            for c in range(3):
                total = out[row, col, c]
                for k in range(3):
                    total += gain[k, c] * texture[row, col, k]
                out[row, col, c] = total
