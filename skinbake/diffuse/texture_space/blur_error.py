"""Method `hybrid`: the texture's blur where it is right, surface sums where it is not.

On most of a head texture space is right: where nothing changes within reach, a blur of any width is. It errs across the
borders of charts, and where light changes on skin whose texels are not those of the mean size. Both show in the blur
itself, T = K[M E] / K[M]: the mass K[M] falls below one where a border is within reach, and |T - E| is what blurring
has changed. Where texels are small, the blur is narrower than the lobe: what changes further away than it looks shows
in the light of blocks as wide as the lobe, in how far it is from halfway between its neighbours, B. What is near in
space but not in the texture (`foreign`), d away, may add up to half of exp(-d^2 / 2v). An error is predicted for each
texel and light,

    e = max(1 - K[M], exp(-d^2 / 2v) / 2) mean(E) + max(|T - E|, B) min(r - 1, 2),

r the ratio, above one, of the squared length of a texel on the skin to the mean one's, along the worse of two axes.
Where e is above a threshold the sum counts, where it is below half of that the blur does; between the two they are
mixed, so that no line shows. Each light is predicted by itself: its lobes do not depend on what else is lit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.surface_space.clusters import MomentPyramid
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.texture_space.uv_gaps import LEVEL
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import load_scalar
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

_MOST_UNEVEN = np.float32(2)
_BARE = np.float32(1e-6)  # coverage
_TINY = np.float32(1e-30)
_ZERO, _ONE = np.float32(0), np.float32(1)


@dataclass(frozen=True)
class BlurErrorPredictor:
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
    foreign_mm : ndarray of shape (H / 8, W / 8), float32
        `distance_to_foreign` of this tile.
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
    foreign_mm: NDArray[np.float32]
    mean_texel_mm2: tuple[float, float]
    mean: Sequence[float]

    def share_of_sums(
        self, variance_mm2: float, threshold: float, blurred: NDArray[np.float32], mass: NDArray[np.float32]
    ) -> NDArray[np.uint8]:
        """How much sums count against the blur, texel by texel and for each light.

        Parameters
        ----------
        variance_mm2 : float
            Of the lobe.
        threshold : float
            Predicted error from which on the sum alone counts, over the light's mean.
        blurred : ndarray of shape (L, h, w, 3), float32
            T.
        mass : ndarray of shape (h, w), float32
            K[M].

        Returns
        -------
        ndarray of shape (L, h, w), uint8
            In steps of 1 / 255; 0 where there is no skin point.
        """
        share = np.empty(blurred.shape[:3], np.uint8)
        parallel_for(_shares, len(self.points.row), self._prediction(variance_mm2, threshold), blurred, mass, share)
        return share

    def shares_of_texels(
        self, variance_mm2: float, threshold: float, flat: NDArray[np.int64], blurred: Float, mass: Float
    ) -> NDArray[np.float32]:
        """The same shares, 0 ... 1, of a few texels.

        Parameters
        ----------
        variance_mm2, threshold : float
            As in `share_of_sums`.
        flat : ndarray of shape (P,), int64
            row * w + col.
        blurred : ndarray of shape (P, 3L)
        mass : ndarray of shape (P,)

        Returns
        -------
        ndarray of shape (P, L), float32
        """
        share = np.zeros((len(flat), len(self.mean)), np.float32)
        light = blurred.reshape(len(flat), len(self.mean), 3).astype(np.float32)
        prediction = self._prediction(variance_mm2, threshold)
        _shares_of_texels(prediction, flat, light, mass.astype(np.float32), share)
        return share

    def _prediction(self, variance_mm2: float, threshold: float) -> _Prediction:
        """Everything that a kernel needs to predict errors of one lobe."""
        shorter2, longer2 = map(np.float32, self.mean_texel_mm2)
        texel = _MeanTexel(np.float32(variance_mm2), shorter2, longer2, np.float32(threshold))
        return _Prediction(
            self.points,
            self.coverage,
            self.image,
            self.margin,
            self.level,
            self.pyramid,
            self.bend,
            self.foreign_mm,
            np.array(self.mean, np.float32),
            texel,
        )


class _MeanTexel(NamedTuple):
    """What a blur was made for, as float32.

    Attributes
    ----------
    variance_mm2 : float32
        Of the lobe.
    shorter2, longer2 : float32
        Squared lengths of the mean texel, mm^2.
    threshold : float32
        Predicted error from which on the sum alone counts, over the light's mean.
    """

    variance_mm2: np.float32
    shorter2: np.float32
    longer2: np.float32
    threshold: np.float32


class _Prediction(NamedTuple):
    """A `BlurErrorPredictor` for one lobe, as kernels take it; `mean` is an ndarray of shape (L,), float32."""

    points: TexelPoints
    coverage: NDArray[np.float32]
    image: NDArray[np.float32]
    margin: int
    level: int
    pyramid: MomentPyramid
    bend: NDArray[np.float32]
    foreign_mm: NDArray[np.float32]
    mean: NDArray[np.float32]
    lobe: _MeanTexel


@kernel
def _shares(first, stop, of, blurred, mass, share):  # type: ignore[no-untyped-def]
    """`share_of_sums` of rows of texels.

    Parameters
    ----------
    first, stop : int
        Rows.
    of : _Prediction
    blurred : ndarray of shape (L, h, w, 3), float32
    mass : ndarray of shape (h, w), float32
    share : ndarray of shape (L, h, w), uint8
        Written.
    """
    row_of, image, margin, means, bend = of.points.row, of.image, of.margin, of.mean, of.bend
    height, columns = row_of.shape
    light_and_mask, channels, blur = image.reshape(-1), image.shape[2], blurred.reshape(-1)
    for row in range(first, stop):
        for col in range(columns):
            k = row_of[row, col]
            if k < 0:
                for light in range(len(means)):
                    share[light, row, col] = 0
                continue
            uneven, block = _unevenness(of, row, col, k)
            unseen = _unseen(of, row, col, mass[row, col])
            here = ((row + margin) * image.shape[1] + col + margin) * channels
            for light in range(len(means)):
                far = bend[block, light] if block >= 0 else _ZERO
                there = ((light * height + row) * columns + col) * 3
                change = _change(light_and_mask, here, channels, light, blur, there)
                each = _share(means[light], unseen, max(far, change) * uneven, of.lobe.threshold)
                share[light, row, col] = np.uint8(np.ceil(each * np.float32(255)))


@kernel
def _shares_of_texels(of, flat, blurred, mass, share):  # type: ignore[no-untyped-def]
    """`shares_of_texels`.

    Parameters
    ----------
    of : _Prediction
    flat : ndarray of shape (P,), int64
    blurred : ndarray of shape (P, L, 3), float32
    mass : ndarray of shape (P,), float32
    share : ndarray of shape (P, L), float32
        Written.
    """
    row_of, image, margin, means, bend = of.points.row, of.image, of.margin, of.mean, of.bend
    light_and_mask, channels, blur = image.reshape(-1), image.shape[2], blurred.reshape(-1)
    for i in range(len(flat)):
        row, col = flat[i] // row_of.shape[1], flat[i] % row_of.shape[1]
        k = row_of[row, col]
        if k >= 0:
            uneven, block = _unevenness(of, row, col, k)
            unseen = _unseen(of, row, col, mass[i])
            here = ((row + margin) * image.shape[1] + col + margin) * channels
            for light in range(len(means)):
                far = bend[block, light] if block >= 0 else _ZERO
                there = (i * len(means) + light) * 3
                change = _change(light_and_mask, here, channels, light, blur, there)
                share[i, light] = _share(means[light], unseen, max(far, change) * uneven, of.lobe.threshold)


@kernel(inline=True)
def _unevenness(of, row, col, k):  # type: ignore[no-untyped-def]
    """min(r - 1, 2), and the block as wide as the lobe where texels are small, -1 where they are not.

    Parameters
    ----------
    of : _Prediction
    row, col : int
        Texel.
    k : int
        Its skin point.
    """
    area, shorter2, coverage = of.points.area_mm2[k], of.points.texel_mm2[k], of.coverage[row, col]
    start, width, level = of.pyramid.start, of.pyramid.width, of.level
    variance, mean_shorter2, mean_longer2 = of.lobe.variance_mm2, of.lobe.shorter2, of.lobe.longer2
    uneven, block = _MOST_UNEVEN, np.int64(-1)
    if area > 0 and coverage > 0 and shorter2 > 0:
        texel2 = area / coverage
        longer2 = max(texel2 * texel2 / shorter2, shorter2)
        shorter_ratio = max(shorter2 / mean_shorter2, mean_shorter2 / shorter2)
        longer_ratio = max(longer2 / mean_longer2, mean_longer2 / longer2)
        uneven = min(max(shorter_ratio, longer_ratio) - _ONE, _MOST_UNEVEN)
        if shorter2 < mean_shorter2 / 2:
            wider, block2 = 0, shorter2  # so many times doubled, a texel is as long as sigma
            while block2 < variance and level + wider < len(start):
                wider, block2 = wider + 1, 4 * block2
            if wider > 0:
                scale = level + wider - 1
                block = start[scale] + (row >> wider) * width[scale] + (col >> wider)
    return uneven, block


@kernel(inline=True)
def _unseen(of, row, col, mass):  # type: ignore[no-untyped-def]
    """Share of the lobe that may lie where the blur does not look: beyond a border, or on foreign skin."""
    away, variance = of.foreign_mm[row << of.level >> LEVEL, col << of.level >> LEVEL], of.lobe.variance_mm2
    beyond = _ZERO
    if away * away < np.float32(32) * variance:
        beyond = np.float32(0.5) * np.exp(-away * away / (np.float32(2) * variance))
    return max(_ONE - mass, beyond)


@kernel(inline=True)
def _change(image, here, channels, light, blurred, there):  # type: ignore[no-untyped-def]
    """Largest |T - E| of a light's channels at a texel; 0 where there is no coverage.

    Parameters
    ----------
    image, blurred : ndarrays, float32
        Light and mask, and T, flat.
    here, there : int
        Where the texel's light and mask begin in `image`, and its T of this light in `blurred`.
    channels, light : int
    """
    change, covered = _ZERO, load_scalar(image, here + channels - 1)
    if covered > _BARE:
        inverse = _ONE / covered
        for c in range(3):
            change = max(
                change, abs(load_scalar(blurred, there + c) - load_scalar(image, here + 3 * light + c) * inverse)
            )
    return change


@kernel(inline=True)
def _share(mean, unseen, changed, threshold):  # type: ignore[no-untyped-def]
    """From 0 where half the threshold is predicted to 1 where all of it is; 0 of a light that is dark everywhere."""
    share = _ZERO
    if mean > 0:
        error = unseen * mean + changed
        share = min(max(np.float32(2) * error / max(threshold * mean, _TINY) - _ONE, _ZERO), _ONE)
    return share
