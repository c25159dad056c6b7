"""Cards: triangles with a picture that says where they let light pass, such as those that hair is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.texel_coordinates import texel_xy
from skinbake.irradiance.embree import Triangles
from skinbake.scene.casters import OPAQUE, Casters

Vectors = NDArray[np.float32]
LAYERS = 256  # that a ray looks through before it counts as stopped
DARK = 1 / 1024  # share of light below which a ray counts as stopped
SPACINGS = 8  # float32 spacings by which a ray starts again beyond a card


class Cards:
    """The casters with opacity, in a scene of their own so that all else is asked only for any hit.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float32
        Of the casters, about the occluder's centre, mm.
    casters : Casters
    """

    def __init__(self, positions: Vectors, casters: Casters) -> None:
        chosen = casters.image != OPAQUE
        self._corner_uv = casters.corner_uv[chosen]
        self._image = casters.image[chosen]
        self._pictures = casters.opacity
        self._spacing = np.spacing(np.abs(positions).max(initial=1.0)) * SPACINGS
        self._triangles = Triangles((positions, casters.faces[chosen]))

    def blocked(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray is stopped by the cards, shape (n,): with the probability that `transmitted` leaves.

        The chance is a hash of the ray: the same for the same ray, whatever is asked beside it.

        Parameters
        ----------
        origin, direction : ndarrays of shape (n, 3), float32
        reach : ndarray of shape (n,), float32
            Distance up to which cards count, in lengths of `direction`.
        """
        return self.transmitted(origin, direction, reach) <= _chance(origin, direction)

    def met(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray meets a card, were it only where that lets all light pass, shape (n,).

        Parameters
        ----------
        origin, direction, reach
            As of `blocked`; one direction serves all rays.
        """
        return self._triangles.occluded(origin, direction, reach)

    def transmitted(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.float32]:
        """Share of light that passes all cards along each ray, shape (n,): a card of opacity a lets 1 - a pass.

        Parameters
        ----------
        origin, direction, reach
            As of `blocked`.
        """
        share = np.ones(len(origin), np.float32)
        alive, start, left = np.arange(len(origin)), origin.copy(), reach.copy()
        length = np.maximum(np.linalg.norm(direction, axis=1), np.float32(1e-30))
        for _ in range(LAYERS):
            if not len(alive):
                return share
            hit = self._triangles.first_hits(start[alive], direction[alive])
            triangle, distance = hit.triangle, hit.distance
            met = (triangle >= 0) & (distance < left[alive])
            alive, triangle, distance = alive[met], triangle[met], distance[met]
            share[alive] *= 1 - self._opacity(triangle, hit.b1[met], hit.b2[met])
            dark = share[alive] < DARK
            share[alive[dark]] = 0
            alive, distance = alive[~dark], distance[~dark]
            step = distance * np.float32(1 + 1e-6) + np.float32(self._spacing) / length[alive]
            start[alive] += direction[alive] * step[:, None]
            left[alive] -= step
        share[alive] = 0
        return share

    def _opacity(self, triangle: NDArray[np.int32], b1: Vectors, b2: Vectors) -> NDArray[np.float32]:
        """Nearest texel of each triangle's picture, which repeats."""
        corner = self._corner_uv[triangle]
        uv = corner[:, 0] + b1[:, None] * (corner[:, 1] - corner[:, 0]) + b2[:, None] * (corner[:, 2] - corner[:, 0])
        found = np.empty(len(triangle), np.float32)
        for number, picture in enumerate(self._pictures):
            of_picture = self._image[triangle] == number
            u, v = (uv[of_picture] % 1.0).T
            height, width = picture.shape
            x, y = texel_xy(u, v, height, width)
            rows, columns = np.minimum(y.astype(np.int64), height - 1), np.minimum(x.astype(np.int64), width - 1)
            found[of_picture] = picture[rows, columns]
        return found


def _chance(origin: Vectors, direction: Vectors) -> NDArray[np.float64]:
    """A number from 0 up to 1 for each ray, by hashing its bits [Steele2014]."""
    word = np.zeros(len(origin), np.uint64)
    for vectors in (origin, direction):
        bits = np.ascontiguousarray(vectors).view(np.uint32).astype(np.uint64)
        for axis in range(3):
            word = _mixed(word + np.uint64(0x9E3779B97F4A7C15) + bits[:, axis])
    return (word >> np.uint64(11)).astype(np.float64) / 2.0**53


def _mixed(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))
