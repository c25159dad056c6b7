"""A mean with the texels about one that look the same way: it hides noise, and leaves creases as they are.

Of fine texels that send many rays it is the mean with the neighbours; of others the mean over the rays of as many
texels as it takes to meet some skin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
Counts = NDArray[np.integer]
Index = NDArray[np.int64]
BINOMIAL = {3: (0.5, 1.0, 0.5), 5: (1 / 6, 4 / 6, 1.0, 4 / 6, 1 / 6)}  # weights by the number of texels across
LEAST_COSINE = 0.95  # between normals, from which on a neighbour counts; in full where they are the same
WORTH = 0.45  # of its weight that a neighbour's rays save of one's own: sequences of texels are no single one
REACHES = 0, 1, 2, 4, 6, 8  # texels to either side that light is the mean over where few rays meet skin
ENOUGH_MET = 24  # rays that meet skin, from which on a mean takes no more texels
_ALIKE = (
    0.9  # cosine between normals, from which on the rays of a texel farther off count; in full where they are the same
)
_FULL = 252  # weight of the texel itself
_REACH = 1.5  # texels' widths that a neighbour may be away for each that it is in the texture: else it is other skin


def neighbour_weights(across: int, raster: AtlasRaster, point: Image, normal: Image, flat: Index) -> NDArray[np.uint8]:
    """Weight of each of `across`^2 neighbours of every addressed texel, (n, k); 0 where there is none or other skin.

    Parameters
    ----------
    across : int
        3 or 5 texels.
    raster : AtlasRaster
    point, normal : ndarrays of shape (n, 3), float32
        Of its addressed texels.
    flat : ndarray of shape (n,), int64
        row * w + col of each.
    """
    out = np.zeros((len(flat), across * across), np.uint8)
    binomial = np.outer(BINOMIAL[across], BINOMIAL[across])
    texels = flat, numbers(raster.shape, flat), raster.area_mm2
    parallel_for(_weigh, len(flat), (point, normal), texels, binomial, out)
    return out


def numbers(shape: tuple[int, int], flat: Index, first: int = 0) -> NDArray[np.int32]:
    """Number of the texel at each place, counted from `first`; -1 where none is, (h, w).

    Parameters
    ----------
    shape : (h, w)
    flat : ndarray of shape (n,), int64
        row * w + col of each texel.
    first : int
    """
    out = np.full(shape, -1, np.int32)
    out.reshape(-1)[flat] = np.arange(first, first + len(flat), dtype=np.int32)
    return out


def mean_about(values: Image, weight: NDArray[np.uint8], number: NDArray[np.int32], flat: Index) -> Image:
    """Values (n, v) of texels, each the weighted mean with its neighbours.

    Parameters
    ----------
    values : ndarray of shape (n, v), float32
    weight : ndarray of shape (n, k)
        As `neighbour_weights` gives them.
    number : ndarray of shape (h, w)
        Of each texel.
    flat : ndarray of shape (n,), int64
    """
    out = np.zeros_like(values)
    parallel_for(_mean, len(flat), values, weight, number, flat, out)
    return out


def rays_shared(weight: NDArray[np.uint8]) -> NDArray[np.float64]:
    """How many times its own rays each texel's mean with its neighbours is worth, (n,)."""
    total = weight.sum(axis=1, dtype=np.float64)
    shared = total**2 / np.maximum(np.einsum("nk,nk->n", weight, weight, dtype=np.float64), 1.0)
    worth: NDArray[np.float64] = 1 + WORTH * np.maximum(shared - 1, 0)
    return worth


def reach_of_rays(shape: tuple[int, int], flat: Index, met: Counts) -> NDArray[np.uint8]:
    """How many texels to either side hold about `ENOUGH_MET` rays that meet skin, of `REACHES`, (n,).

    Parameters
    ----------
    shape : (h, w)
    flat : ndarray of shape (n,), int64
        row * w + col of each texel.
    met : ndarray of shape (n,)
        How many of its rays meet skin.
    """
    most = max(REACHES)
    of_place = np.zeros((shape[0] + 2 * most + 1, shape[1] + 2 * most + 1))
    row, col = np.divmod(flat, shape[1])
    of_place[row + most + 1, col + most + 1] = met
    up_to = of_place.cumsum(axis=0).cumsum(axis=1)
    row, col = row + most, col + most  # one before each, in the sums
    found = np.full(len(flat), most, np.uint8)
    for reach in sorted(REACHES, reverse=True):
        top, bottom, left, right = row - reach, row + reach + 1, col - reach, col + reach + 1
        about = up_to[bottom, right] - up_to[top, right] - up_to[bottom, left] + up_to[top, left]
        found[about >= ENOUGH_MET] = reach
    return found


def mean_of_rays(
    values: Image, rays: Counts, reach: NDArray[np.uint8], skin: tuple[Image, Image], raster: AtlasRaster, flat: Index
) -> Image:
    """Values (n, v) of texels, each the mean over the rays of all texels within its reach that look about the same way.

    Parameters
    ----------
    values : ndarray of shape (n, v), float32
    rays : ndarray of shape (n,)
    reach : ndarray of shape (n,)
        As `reach_of_rays` gives it.
    skin : (point, normal)
        Of shape (n, 3), float32.
    raster : AtlasRaster
    flat : ndarray of shape (n,), int64
    """
    out = np.zeros_like(values)
    texels = flat, numbers(raster.shape, flat), raster.area_mm2
    parallel_for(_mean_rays, len(flat), values, (rays, reach), skin, texels, out)
    return out


@kernel(inline=True)
def _alike(skin: tuple[Image, Image], i: int, j: int, apart_mm2: float) -> tuple[float, bool]:
    """Cosine between the normals of two texels, and whether they are as near as places so far apart of one skin are.

    Parameters
    ----------
    skin : (point, normal)
        Of shape (n, 3).
    i, j : int
        The texels.
    apart_mm2 : float
        Square of how far they are apart in the texture, at its texels' width.
    """
    point, normal = skin
    cosine, away = 0.0, 0.0
    for axis in range(3):
        cosine += normal[i, axis] * normal[j, axis]
        away += (point[i, axis] - point[j, axis]) ** 2
    return cosine, away <= _REACH * _REACH * apart_mm2


@kernel
def _mean_rays(start, stop, values, counts, skin, texels, out):  # type: ignore[no-untyped-def]
    """Write the means over rays.

    Parameters
    ----------
    start, stop : int
        Texels.
    values : ndarray of shape (n, v)
    counts : tuple of two ndarrays of shape (n,)
        Rays, and reach.
    skin : tuple of two ndarrays of shape (n, 3)
        Points and normals.
    texels : tuple of ndarrays of shape (n,), (h, w) and (h, w)
        row * w + col of each, the number and the area of the texel at each place.
    out : ndarray of shape (n, v), holding 0; written
    """
    rays, reach = counts
    flat, number, area_mm2 = texels
    height, width = number.shape
    for i in range(start, stop):
        row, col = flat[i] // width, flat[i] % width
        far = np.int64(reach[i])
        total = 0.0
        for y in range(max(row - far, 0), min(row + far + 1, height)):
            for x in range(max(col - far, 0), min(col + far + 1, width)):
                j = number[y, x]
                if j < 0:
                    continue
                apart = (y - row) * (y - row) + (x - col) * (x - col)
                cosine, near_by = _alike(skin, i, j, apart * max(area_mm2[row, col], area_mm2[y, x]))
                if j == i:
                    cosine = 1.0
                if cosine <= _ALIKE or not near_by:
                    continue
                near = 1.0 - apart / (2.0 * (far + 1) * (far + 1))
                weight = near * near * min((cosine - _ALIKE) / (1.0 - _ALIKE), 1.0) * rays[j]
                total += weight
                for v in range(values.shape[1]):
                    out[i, v] += weight * values[j, v]
        for v in range(values.shape[1]):
            out[i, v] /= total


@kernel
def _weigh(start, stop, skin, texels, binomial, out):  # type: ignore[no-untyped-def]
    """Write the weights of each texel's neighbours.

    Parameters
    ----------
    start, stop : int
        Texels.
    skin : tuple of two ndarrays of shape (n, 3)
        Points and normals.
    texels : tuple of ndarrays of shape (n,), (h, w) and (h, w)
        row * w + col of each, the number and the area of the texel at each place.
    binomial : ndarray of shape (across, across)
    out : ndarray of shape (n, across^2), written
    """
    flat, number, area_mm2 = texels
    height, width = number.shape
    across = len(binomial)
    for i in range(start, stop):
        row, col = flat[i] // width, flat[i] % width
        for k in range(across * across):
            down, right = k // across - across // 2, k % across - across // 2
            y, x = row + down, col + right
            if y < 0 or y >= height or x < 0 or x >= width or number[y, x] < 0:
                continue
            j = number[y, x]
            if j == i:
                out[i, k] = _FULL
                continue
            apart = down * down + right * right
            cosine, near_by = _alike(skin, i, j, apart * max(area_mm2[row, col], area_mm2[y, x]))
            if near_by and cosine > LEAST_COSINE:
                alike = min((cosine - LEAST_COSINE) / (1.0 - LEAST_COSINE), 1.0)
                out[i, k] = int(_FULL * binomial[k // across, k % across] * alike)


@kernel
def _mean(start, stop, values, weight, number, flat, out):  # type: ignore[no-untyped-def]
    """Write the weighted means.

    Parameters
    ----------
    start, stop : int
        Texels.
    values : ndarray of shape (n, v)
    weight : ndarray of shape (n, across^2)
    number : ndarray of shape (h, w)
    flat : ndarray of shape (n,)
    out : ndarray of shape (n, v), holding 0; written
    """
    width = number.shape[1]
    across = int(np.sqrt(weight.shape[1]))
    for i in range(start, stop):
        total = 0.0
        for k in range(across * across):
            if weight[i, k] > 0:
                total += weight[i, k]
                row, col = flat[i] // width + k // across - across // 2, flat[i] % width + k % across - across // 2
                j = number[row, col]
                for v in range(values.shape[1]):
                    out[i, v] += weight[i, k] * values[j, v]
        for v in range(values.shape[1]):
            out[i, v] /= total
