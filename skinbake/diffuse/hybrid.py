"""Method `hybrid`: the texture's blur where it is right, surface sums where it is not.

On most of a head texture space is right: where nothing changes within reach, a blur of any width is. It errs across the
borders of charts, and where light changes on skin whose texels are not those of the mean size. Both show in the blur
itself, T = K[M E] / K[M]: the mass K[M] falls below one where a border is within reach, and |T - E| is what blurring
has changed. Where texels are small, the blur is narrower than the lobe: what changes further away than it looks shows
in the light of blocks as wide as the lobe, in how far it is from halfway between its neighbours, B. An error is
predicted for each texel and light,

    e = (1 - K[M]) mean(E) + max(|T - E|, B) min(r - 1, 2),

r the ratio, above one, of the squared length of a texel on the skin to the mean one's, along the worse of two axes.
Where e is above a threshold the sum counts, where it is below half of that the blur does; between the two they are
mixed, so that no line shows. Each light is predicted by itself: its lobes do not depend on what else is lit.

Skin that is near in space but far off in the same chart (a fold, the far side of an ear) is seen by neither, unless its
light shows in B: the probes that judge every bake see it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.diffuse.clusters import MomentPyramid
from skinbake.diffuse.points import TexelPoints
from skinbake.numerics import Float

_MOST_UNEVEN = np.float32(2)
_BARE = np.float32(1e-6)  # coverage
_TINY = np.float32(1e-30)
_ZERO, _ONE = np.float32(0), np.float32(1)


@dataclass(frozen=True)
class Predictor:
    """What errors of one tile's blur at one stored size are predicted from.

    Attributes
    ----------
    points : TexelPoints
        Of this size.
    coverage : ndarray of shape (h, w), float32
    image : ndarray of shape (h + 2 margin, w + 2 margin, 3L + 1), float32
        Premultiplied light and mask, as in the texture's pyramid.
    margin, level : int
    pyramid : MomentPyramid
        Of the full size.
    bend : ndarray of shape (B, L), float32
        `bending(pyramid)`.
    mean_texel_mm2 : (float, float)
        Squared lengths of the texel that the blur was made for, the shorter first.
    mean : sequence of L floats
        Each light's mean over the skin.
    """

    points: TexelPoints
    coverage: NDArray[np.float32]
    image: NDArray[np.float32]
    margin: int
    level: int
    pyramid: MomentPyramid
    bend: NDArray[np.float32]
    mean_texel_mm2: tuple[float, float]
    mean: Sequence[float]

    def share_of_sums(
        self,
        light: int,
        variance_mm2: float,
        threshold: float,
        blurred: NDArray[np.float32],
        mass: NDArray[np.float32],
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Which texels of one light are to be summed, and how much the sum then counts against the blur.

        Parameters
        ----------
        threshold : float
            Predicted error from which on the sum alone counts, over the light's mean.
        blurred : ndarray of shape (h, w, 3), float32
            T of this light.
        mass : ndarray of shape (h, w), float32
            K[M].

        Returns
        -------
        row : ndarray of shape (h, w), int32
            `points.row` where a sum counts, -1 elsewhere.
        share : ndarray of shape (h, w), float32
            0 ... 1.
        """
        points, pyramid = self.points, self.pyramid
        row, share = np.full_like(points.row, -1), np.zeros_like(mass)
        if self.mean[light] > 0:
            _shares(
                points.row, points.area_mm2, points.texel_mm2, self.coverage, self.image, self.bend, pyramid.start,
                pyramid.width, self.margin, self.level, light, self._floats(light, variance_mm2, threshold), blurred,
                mass, row, share,
            )  # fmt: skip
        return row, share

    def shares_of_texels(
        self, variance_mm2: float, threshold: float, flat: NDArray[np.int64], blurred: Float, mass: Float
    ) -> NDArray[np.float32]:
        """The same shares for all lights, (P, L), of a few texels: `flat` is row * w + col, `blurred` (P, 3L)."""
        points, pyramid = self.points, self.pyramid
        share = np.zeros((len(flat), len(self.mean)), np.float32)
        for light, mean in enumerate(self.mean):
            if mean > 0:
                _shares_of_texels(
                    points.row, points.area_mm2, points.texel_mm2, self.coverage, self.image, self.bend,
                    pyramid.start, pyramid.width, self.margin, self.level, light,
                    self._floats(light, variance_mm2, threshold), flat,
                    blurred[:, 3 * light : 3 * light + 3].astype(np.float32), mass.astype(np.float32), share[:, light],
                )  # fmt: skip
        return share

    def _floats(self, light: int, variance_mm2: float, threshold: float) -> NDArray[np.float32]:
        return np.array([variance_mm2, *self.mean_texel_mm2, self.mean[light], threshold], np.float32)


@njit(cache=True, parallel=True)
def _shares(  # type: ignore[no-untyped-def]
    row_of, area, texel_mm2, coverage, image, bend, start, width, margin, level, light, floats, blurred, mass, row_out,
    share,
):  # fmt: skip
    for row in prange(row_of.shape[0]):
        for col in range(row_of.shape[1]):
            k = row_of[row, col]
            if k >= 0:
                share[row, col] = _share(
                    row, col, area[k], texel_mm2[k], coverage[row, col], image[row + margin, col + margin], bend,
                    start, width, level, light, floats, blurred[row, col], mass[row, col],
                )  # fmt: skip
                if share[row, col] > 0:
                    row_out[row, col] = k


@njit(cache=True)
def _shares_of_texels(  # type: ignore[no-untyped-def]
    row_of, area, texel_mm2, coverage, image, bend, start, width, margin, level, light, floats, flat, blurred, mass,
    share,
):  # fmt: skip
    for i in range(len(flat)):
        row, col = flat[i] // row_of.shape[1], flat[i] % row_of.shape[1]
        k = row_of[row, col]
        if k >= 0:
            share[i] = _share(
                row, col, area[k], texel_mm2[k], coverage[row, col], image[row + margin, col + margin], bend, start,
                width, level, light, floats, blurred[i], mass[i],
            )  # fmt: skip


@njit(cache=True, inline="always")
def _share(  # type: ignore[no-untyped-def]
    row, col, area, shorter2, coverage, here, bend, start, width, level, light, floats, blurred, mass
):
    """From 0 where half the threshold is predicted to 1 where all of it is."""
    variance, mean_shorter2, mean_longer2, mean, threshold = floats[0], floats[1], floats[2], floats[3], floats[4]
    change, uneven = _ZERO, _MOST_UNEVEN
    if here[-1] > _BARE:
        for c in range(3):
            change = max(change, abs(blurred[c] - here[3 * light + c] / here[-1]))
    if area > 0 and coverage > 0 and shorter2 > 0:
        longer2 = max((area / coverage) ** 2 / shorter2, shorter2)
        shorter_ratio = max(shorter2 / mean_shorter2, mean_shorter2 / shorter2)
        longer_ratio = max(longer2 / mean_longer2, mean_longer2 / longer2)
        uneven = min(max(shorter_ratio, longer_ratio) - _ONE, _MOST_UNEVEN)
        if shorter2 < mean_shorter2 / 2:
            wider, block2 = 0, shorter2  # so many times doubled, a texel is as long as sigma
            while block2 < variance and level + wider < len(start):
                wider, block2 = wider + 1, 4 * block2
            if wider > 0:
                scale = level + wider - 1
                change = max(change, bend[start[scale] + (row >> wider) * width[scale] + (col >> wider), light])
    error = max(_ONE - mass, _ZERO) * mean + change * uneven
    return min(max(np.float32(2) * error / max(threshold * mean, _TINY) - _ONE, _ZERO), _ONE)
