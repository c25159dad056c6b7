"""LightBasis: some lights that together stand for any, and how a light is made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float
from skinbake.relight.harmonics import count_of, harmonics

Image = NDArray[np.float32]
EACH = 3  # grey lights a texture


@dataclass(frozen=True)
class LightBasis:
    """Lights from everywhere, of which some may be negative in places.

    Attributes
    ----------
    kind : "harmonics" or "fitted"
    of_harmonics : ndarray of shape (K, J)
        What makes coefficients of the K lights of a light's J = (order + 1)^2 harmonics.
    radiance : ndarray of shape (J, K)
        Harmonics of the K lights' own radiance.
    grey : int
        How many of them, the last ones, share textures by three; the others have one each, in colour.
    """

    kind: str
    of_harmonics: Float
    radiance: Float
    grey: int = 0

    @property
    def order(self) -> int:
        """Order of the harmonics that a light is described by."""
        return math.isqrt(self.of_harmonics.shape[1]) - 1

    def __len__(self) -> int:
        """Number of lights."""
        return len(self.of_harmonics)

    @property
    def in_colour(self) -> int:
        """How many lights, the first ones, have a texture in colour."""
        return len(self) - self.grey

    @property
    def textures(self) -> int:
        """Number of textures."""
        return self.in_colour + self.grey // EACH

    def from_directions(self, towards: Image) -> Float:
        """What each light sends from the parts of the sphere that directions stand for, (D, K)."""
        return np.asarray(harmonics(towards, self.order) @ self.radiance * (4 * np.pi / len(towards)))


def harmonic_basis(order: int) -> LightBasis:
    """The spherical harmonics themselves up to an order [Ramamoorthi2001]."""
    one = np.eye(count_of(order))
    return LightBasis("harmonics", one, one)
