"""Normal maps for pictures whose pixels are wider than its texels: mean normals, and how much they vary about them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import safe_div, sqr

LEVELS = 6  # the last texel stands for 32 x 32: beyond that, most are mixed with those of other charts
_BAND = 64  # rows; even


def normal_levels(normal: NDArray[np.floating], strength: float, space: str) -> list[NDArray[np.floating]]:
    """The map, and means over 2, 4, ... texels a side, each of shape (h, w, 4), in the map's type.

    The first three channels are normals, not unit, without the strength; the last is the sum of both slopes' variances
    that the texel stands for, of normals bent by the strength: 0 in the map itself. An odd row or column is dropped, as
    OpenGL's levels have it.

    Parameters
    ----------
    normal : ndarray of shape (h, w, 3)
    strength : float
        Factor on x and y, in tangent space.
    space : "tangent" or "object"

    References
    ----------
    [Toksvig2005]
    """
    levels = [np.concatenate([normal, np.zeros_like(normal[..., :1])], axis=2)]
    bend = np.array([strength, strength, 1.0] if space == "tangent" else [1.0, 1.0, 1.0], np.float32)
    if LEVELS == 1 or max(normal.shape[:2]) == 1:
        return levels
    # The first level some rows at a time: as floats the map would be many times as large
    last = max(2 * (len(normal) // 2), 1)
    bands = (normal[row : min(row + _BAND, last)] for row in range(0, last, _BAND))
    sums = np.concatenate([_halved(_units(band, bend, space)) for band in bands])
    while True:
        bands = (sums[row : row + _BAND] for row in range(0, len(sums), _BAND))
        levels.append(np.concatenate([_level(band, bend).astype(normal.dtype) for band in bands]))
        if len(levels) == LEVELS or max(sums.shape[:2]) == 1:
            return levels
        sums = _halved(sums)


def _level(sums: NDArray[np.float32], bend: NDArray[np.float32]) -> NDArray[np.floating]:
    """Mean normals and the sum of both slopes' variances, (h, w, 4), from sums as `_units` begins them."""
    mean = safe_div(sums[..., :3], sums[..., 3:])
    kept = np.linalg.norm(mean, axis=2, keepdims=True)
    varied = np.maximum(2 * safe_div(1 - kept, kept), 0)
    return np.concatenate([safe_div(mean, bend), np.minimum(varied, 1)], axis=2)


def _units(normal: NDArray[np.floating], bend: NDArray[np.float32], space: str) -> NDArray[np.float32]:
    """Unit normals of a map and, last, whether there is one, (h, w, 4).

    Parameters
    ----------
    normal : ndarray of shape (h, w, 3)
    bend : ndarray of shape (3,)
        Factor on its components.
    space : "tangent" or "object"
    """
    unit = normal.astype(np.float32) * bend
    if space == "tangent":  # one that points into the skin leaves it smooth
        unit[~(unit[..., 2] > 0)] = (0, 0, 1)
    length = np.sqrt(sqr(unit[..., 0]) + sqr(unit[..., 1]) + sqr(unit[..., 2]))
    out = np.empty((*unit.shape[:2], 4), np.float32)
    out[..., 3] = length > 0
    np.multiply(unit, (out[..., 3] / np.where(length > 0, length, np.float32(1)))[..., None], out=out[..., :3])
    return out


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2 x 2 texels, or of two where there is one row or one column."""
    for axis in (0, 1):
        n = image.shape[axis] // 2
        if n:
            first, second = (image[i : 2 * n : 2] if axis == 0 else image[:, i : 2 * n : 2] for i in (0, 1))
            image = np.float32(0.5) * (first + second)
    return image
