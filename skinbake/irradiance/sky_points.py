"""Places of the skin by which skies are planned: what a few of them see of the sky is traced once for every sky."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_share import open_shares, shares_of
from skinbake.irradiance.open_directions import WHOLE
from skinbake.irradiance.sky_texels import SkyTexels
from skinbake.irradiance.surface import scattered_origins
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
FEWEST, MOST = 2048, 16384  # points of the skin: a dark place that fills one in the most of them costs 0.8 % rms


class SkyPoints:
    """Points scattered over the skin, and texels that stand for it and tell what they see.

    The points are asked about a few directions of each sky; there are more of them than a small atlas has texels. The
    texels are asked about all directions, once: the same that relighting asks.

    Parameters
    ----------
    texels : SkyTexels
    size : (width, height)
        Of the texture.
    tolerance : float
        Rms error of a sky: there are so many points that a dark place between them costs half of it, about.
    """

    def __init__(self, texels: SkyTexels, size: tuple[int, int], tolerance: float) -> None:
        self._texels, self._size = texels, size
        self._count = int(min(max((2 / tolerance) ** 2, FEWEST), MOST))

    @cached_property
    def _places(self) -> tuple[Image, Image]:
        """Where rays start, and smooth normals, (n, 3)."""
        return scattered_origins(self._texels.mesh, self._texels.occluder, self._size, self._count)

    @property
    def normal(self) -> Image:
        """Smooth normals of all points, (n, 3)."""
        return self._places[1]

    @property
    def few_normal(self) -> Image:
        """Smooth normals of the few that tell what they see, (m, 3)."""
        return self._few.normal[self._numbers]

    def shares(self, directions: Image, weights: Image) -> Image:
        """Share of R, G, B and of their sum that arrives at every point, traced, (n, 4).

        Parameters
        ----------
        directions, weights : ndarrays of shape (s, 3)
            As `SkySamples.draw` gives them.
        """
        return open_shares(*self._places, directions, weights, self._texels.occluder)

    def few_shares(self, directions: Image, weights: Image) -> Image:
        """The same of the few, (m, 4), by what they see of the direction nearest to each.

        Parameters
        ----------
        directions, weights : ndarrays of shape (s, 3)
        """
        near = np.empty(len(directions), np.int64)
        parallel_for(_find_nearest, len(near), directions, self._texels.towards, near)
        out = np.empty((len(self._few.normal), 2, 4))
        parallel_for(_sum, len(out), self._few, _Drawn(directions, weights, near), out)
        return shares_of(out)[self._numbers]

    @cached_property
    def _few(self) -> _Few:
        """What texels of all tiles see, each once."""
        seen = self._texels.seen.values()
        return _Few(np.concatenate([each.normal for each in seen]), np.concatenate([each.share for each in seen]))

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        """Which rows of `_few` stand for equal areas, (m,)."""
        before, found = 0, []
        for tile, seen in self._texels.seen.items():
            found.append(before + np.searchsorted(seen.texels, self._texels.numbers[tile]))
            before += len(seen.texels)
        return np.concatenate(found)


class _Few(NamedTuple):
    """What texels see of directions all around.

    Attributes
    ----------
    normal : ndarray of shape (k, 3), float32
    share : ndarray of shape (k, D), uint8
        Of light from each, in parts of `WHOLE`.
    """

    normal: Image
    share: NDArray[np.uint8]


class _Drawn(NamedTuple):
    """A sky's directions.

    Attributes
    ----------
    directions, weights : ndarrays of shape (s, 3), float32
    near : ndarray of shape (s,), int64
        Which of the directions all around is nearest to each.
    """

    directions: Image
    weights: Image
    near: NDArray[np.int64]


@kernel
def _find_nearest(first: int, stop: int, directions: Image, towards: Image, near: NDArray[np.int64]) -> None:
    """Number of the direction all around that is nearest to each of a sky's.

    Parameters
    ----------
    first, stop : int
        Of the sky's.
    directions : ndarray of shape (s, 3)
    towards : ndarray of shape (D, 3)
    near : ndarray of shape (s,)
        Written.
    """
    for s in range(first, stop):
        best = np.float32(-2.0)
        for d in range(len(towards)):
            cosine = (
                directions[s, 0] * towards[d, 0] + directions[s, 1] * towards[d, 1] + directions[s, 2] * towards[d, 2]
            )
            if cosine > best:
                best, near[s] = cosine, d


@kernel
def _sum(first, stop, points, drawn, out):  # type: ignore[no-untyped-def]
    """Light that directions send to points by the cosine, and the part that arrives, as `open_sums` has them.

    Parameters
    ----------
    first, stop : int
        Points.
    points : _Few
    drawn : _Drawn
    out : ndarray of shape (k, 2, 4)
        Written.
    """
    normal, towards, weights = points.normal, drawn.directions, drawn.weights
    for i in range(first, stop):
        out[i] = 0.0
        for s in range(len(towards)):
            cosine = np.float64(
                normal[i, 0] * towards[s, 0] + normal[i, 1] * towards[s, 1] + normal[i, 2] * towards[s, 2]
            )
            if cosine > 0.0:
                share = np.float64(points.share[i, drawn.near[s]]) / WHOLE
                for c in range(3):
                    sent = cosine * weights[s, c]
                    out[i, 0, c] += sent
                    out[i, 1, c] += sent * share
        for k in range(2):
            out[i, k, 3] = out[i, k, 0] + out[i, k, 1] + out[i, k, 2]
