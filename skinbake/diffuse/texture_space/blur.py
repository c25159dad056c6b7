"""A blur in the texture: one texel size for all of it, separable kernels, K[M E] / K[M]; the 2015 report's way.

It knows nothing of stretch, seams and tiles, and costs the same for every width: a wide lobe is blurred, and stored,
at the level of a pyramid where it is a few texels wide. Variances add, so each level's prefilter is taken off the blur
that remains; fourth cumulants add too, so that a coarse level still gives the kernel that the full texture would have
used: the discrete Gaussian, theory.md 5.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled, Tiles, first_fundamental_form, signed_uv_area
from skinbake.bilinear import read_variance_texels2
from skinbake.diffuse.lattice import discrete_gaussian, residual_kernel
from skinbake.diffuse.texture_space.separable import decimate, decimation_weights, masked_light, normalised_blur
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros
from skinbake.scene.mesh import SkinMesh

PREFILTER_TEXELS2 = 1.75  # of the finer level; aliases of any image stay below 5e-4 of its range
LEVEL_TEXELS2 = 5.5  # a level may be halved while the lobe's variance there is at least this: 0.6 is left to blur
_NO_COVERAGE = 1e-6  # of what one covered texel leaves where it stands


@dataclass
class TexturePyramid:
    """Premultiplied light and mask of one tile, at full size and at the halved sizes asked for so far.

    Attributes
    ----------
    levels : list of ndarray of shape (h + 2 margin, w + 2 margin, 3L + 1), float32
        The margin holds what the prefilters carried beyond the texture: the blur that remains brings part of it back.
    prefilter : list of (float, float)
        Variance (y, x) each level already has, texels of the full size squared.
    zeros : callable
        Makes levels, and what is blurred from them.
    """

    levels: list[NDArray[np.float32]]
    prefilter: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])
    zeros: Zeros = np.zeros

    def level(self, number: int) -> NDArray[np.float32]:
        """Level `number`, made from the one before it when it is not there yet."""
        full_h, full_w = self.levels[0].shape[:2]
        while len(self.levels) <= number:
            number_before = len(self.levels) - 1
            height, width = level_size((full_h, full_w), number_before)
            h, w = level_size((full_h, full_w), number_before + 1)
            # An axis that is already one texel is not filtered again
            t_y = PREFILTER_TEXELS2 if h < height else 0.0
            t_x = PREFILTER_TEXELS2 if w < width else 0.0
            fine = self.levels[-1]
            before_margin, margin = level_margin(number_before), level_margin(number_before + 1)
            out = self.zeros((h + 2 * margin, w + 2 * margin, fine.shape[2]), np.float32)
            decimate(
                fine,
                *decimation_weights(height, h, before_margin, margin, t_y or 1e-3),
                *decimation_weights(width, w, before_margin, margin, t_x or 1e-3),
                out,
            )
            before = self.prefilter[-1]
            self.prefilter.append((before[0] + t_y * (full_h / height) ** 2, before[1] + t_x * (full_w / width) ** 2))
            self.levels.append(out)
        return self.levels[number]


def level_size(size: tuple[int, ...], level: int) -> tuple[int, int]:
    """Height and width of a pyramid level: halved `level` times, rounded up, never below one."""
    return -(-size[0] // (1 << level)), -(-size[1] // (1 << level))


def level_margin(level: int) -> int:
    """Texels around a level: the reach of its prefilters, all together."""
    return 0 if level == 0 else 8


def texture_pyramid(
    light: NDArray[np.float32], coverage: NDArray[np.float32], zeros: Zeros = np.zeros
) -> TexturePyramid:
    """Start of a pyramid.

    Parameters
    ----------
    light : ndarray of shape (L, H, W, 3), float32
    coverage : ndarray of shape (H, W), float32
    zeros : callable, optional
        Makes its levels.
    """
    return TexturePyramid([masked_light(light, coverage, zeros)], zeros=zeros)


def mean_mm_per_texel(mesh: SkinMesh, size: tuple[int, int]) -> tuple[float, float]:
    """Mean over the charts' area of the length of a step along (row, column), mm; `size` is (height, width).

    Weighted by area in UV, that is by texel: a sliver in UV, stretched a thousandfold, has no say.

    Raises
    ------
    ValueError
        The mesh has no area in UV.
    """
    form, weight = first_fundamental_form(mesh), np.abs(signed_uv_area(mesh))
    if not weight.sum() > 0:
        raise ValueError("mean_mm_per_texel: expected a mesh with some area in UV")
    along_u, along_v = (float(np.average(np.sqrt(form[:, k]), weights=weight)) for k in (0, 2))
    return along_v / size[0], along_u / size[1]


def widest_level(variance_texels2: tuple[float, float], least_texels2: float = LEVEL_TEXELS2) -> int:
    """Coarsest level that still shows a lobe of this variance (texels of the full size squared).

    Parameters
    ----------
    variance_texels2 : (float, float)
    least_texels2 : float, optional
        A level is halved while the variance there is at least this; by default as far as the texture can be blurred.
    """
    level = 0
    while min(variance_texels2) / 4**level >= least_texels2:
        level += 1
    return level


def stored_variance(variance_texels2: tuple[float, float], level: int) -> tuple[float, float]:
    """What of a lobe's variance a stored size holds: the rest is what reading it adds; theory.md 5.2."""
    read = read_variance_texels2(level) * 4**level
    return variance_texels2[0] - read, variance_texels2[1] - read


def texture_blur(
    pyramid: TexturePyramid,
    variance_texels2: tuple[float, float],
    level: int = 0,
    fallback: NDArray[np.float32] | None = None,
    mass: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """One lobe of one tile at a level of its pyramid.

    Parameters
    ----------
    variance_texels2 : (float, float)
        Of the lobe along rows' and columns' direction (y, x), texels of the full size squared.
    level : int
        0 is the full size; at most `widest_level`.
    fallback : ndarray of shape (L, h, w, 3), optional
        Light where no coverage is within reach; zero without it.
    mass : ndarray of shape (h, w), float32, optional
        Filled with the share of the kernel that lies on charts.

    Returns
    -------
    ndarray of shape (L, h, w, 3), float32
    """
    image = pyramid.level(level)
    variance_texels2 = stored_variance(variance_texels2, level)
    kernels = [level_kernel(pyramid, variance_texels2, level, axis).astype(np.float32) for axis in (0, 1)]
    lights = (image.shape[2] - 1) // 3
    height, width = level_size(pyramid.levels[0].shape[:2], level)
    out = pyramid.zeros((lights, height, width, 3), np.float32)
    if fallback is None:
        fallback = np.empty((lights, 0, 0, 3), np.float32)
    epsilon = float(_NO_COVERAGE * kernels[0][0] * kernels[1][0])
    mass = np.empty((0, 0), np.float32) if mass is None else mass
    normalised_blur(image, level_margin(level), kernels[0], kernels[1], fallback, epsilon, out, mass)
    return out


def level_kernel(pyramid: TexturePyramid, variance_texels2: tuple[float, float], level: int, axis: int) -> Float:
    """Half kernel along an axis that remains to be applied at a level, in its own texels.

    Parameters
    ----------
    pyramid : TexturePyramid
    variance_texels2 : (float, float)
        Of the lobe along (y, x), texels of the full size squared.
    level : int
    axis : int
        0 for y, 1 for x.

    Raises
    ------
    ValueError
        The level is too coarse for the lobe.
    """
    t = variance_texels2[axis]
    if level == 0:
        return discrete_gaussian(t)
    size = level_size(pyramid.levels[0].shape[:2], level)[axis]
    ratio = pyramid.levels[0].shape[axis] / size
    rest = (t - pyramid.prefilter[level][axis]) / ratio**2
    if rest < 0.6:
        raise ValueError(f"level {level} is too coarse for a variance of {t} texels")
    return residual_kernel(rest, t / ratio**4)


def texture_pyramids(source: Tiles, coverage: Tiles, zeros: Zeros = np.zeros) -> Tiled[TexturePyramid]:
    """Start of a pyramid for each tile; tiles do not see one another in texture space.

    Parameters
    ----------
    source : Tiles
    coverage : Tiles
        What each texel weighs, (H, W) a tile.
    zeros : callable, optional
        Makes the levels.
    """
    return {tile: texture_pyramid(source[tile], each, zeros) for tile, each in coverage.items()}


def blur_at(
    pyramid: TexturePyramid, variance_texels2: tuple[float, float], level: int, at: Sequence[Float]
) -> tuple[Float, Float]:
    """The blur at a few places of a level, and the share of the kernel that lies on charts there.

    Parameters
    ----------
    at : sequence of two ndarray of shape (P,)
        Row and column, texels of the level from the first one's centre.

    Returns
    -------
    rgb : ndarray of shape (P, 3 L)
        0 where there is no coverage within reach.
    mass : ndarray of shape (P,)
    """
    image = pyramid.level(level)
    first, which, weights = [], [], []
    for axis in (0, 1):
        place = at[axis] + level_margin(level)
        # Few different places between texels, as a rule: two at each level
        between, index = np.unique(place - np.rint(place), return_inverse=True)
        kernels = _between(level_kernel(pyramid, variance_texels2, level, axis), between)
        first.append(np.rint(place).astype(np.int64) - kernels.shape[1] // 2)
        which.append(index)
        weights.append(np.ascontiguousarray(kernels))
    values = np.zeros((len(at[0]), image.shape[2]))
    rows, cols = (_Windows(*axis) for axis in zip(first, which, weights, strict=True))
    parallel_for(_weighted_windows, len(values), image, rows, cols, _NO_COVERAGE, values)
    return values[:, :-1], values[:, -1]


def _between(half: Float, offset: Float) -> Float:
    """Weights of a level's kernel `offset` texels from the middle of its taps, from its half kernel at whole ones."""
    full = np.concatenate([half[:0:-1], half])
    if not offset.any():
        return np.broadcast_to(full, (len(offset), len(full))).copy()
    reach, n = len(half) + 1, 4 * len(full)
    spectrum = np.fft.rfft(np.roll(np.pad(full, (0, n - len(full))), 1 - len(half)))
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n) * offset[:, None])
    shifted: Float = np.roll(np.fft.irfft(spectrum * turn, n), reach, axis=1)[:, : 2 * reach + 1]
    return shifted


class _Windows(NamedTuple):
    """Windows along one axis.

    Attributes
    ----------
    first : ndarray of shape (P,), int64
        First row, or column, of each; may lie outside the image.
    which : ndarray of shape (P,), int64
        Row of `weights` that each has.
    weights : ndarray of shape (n, taps)
    """

    first: NDArray[np.int64]
    which: NDArray[np.int64]
    weights: Float


@kernel
def _weighted_windows(first, stop, image, rows, cols, no_coverage, out):  # type: ignore[no-untyped-def]
    """Weighted means of windows of an image of premultiplied light and mask, by their coverage.

    Parameters
    ----------
    first, stop : int
        Windows.
    image : ndarray of shape (h, w, 3 L + 1), float32
    rows, cols : _Windows
    no_coverage : float
        Below this share of what one covered texel leaves where it stands, light is left as it was.
    out : ndarray of shape (P, 3 L + 1)
        Written: light, and the share of the weights that lies on charts.
    """
    first_y, which_y, weights_y = rows.first, rows.which, rows.weights
    first_x, which_x, weights_x = cols.first, cols.which, cols.weights
    height, width, channels = image.shape
    for p in range(first, stop):
        wy, wx = weights_y[which_y[p]], weights_x[which_x[p]]
        low, high = max(-first_x[p], 0), min(len(wx), width - first_x[p])
        column = np.zeros(max(high - low, 0) * channels)  # of the window, blurred along y only
        for i in range(max(-first_y[p], 0), min(len(wy), height - first_y[p])):
            row = image[first_y[p] + i, first_x[p] + low : first_x[p] + high].reshape(-1)
            for k in range(len(column)):
                column[k] += wy[i] * row[k]
        total = np.zeros(channels)
        for j in range(low, high):
            for c in range(channels):
                total[c] += wx[j] * column[(j - low) * channels + c]
        out[p, channels - 1] = total[-1]
        if total[-1] > no_coverage * _most(wy) * _most(wx):
            for c in range(channels - 1):
                out[p, c] = total[c] / total[-1]


@kernel(inline=True)
def _most(weights):  # type: ignore[no-untyped-def]
    """Largest of positive weights."""
    most = 0.0
    for k in range(len(weights)):
        most = max(most, weights[k])
    return most
