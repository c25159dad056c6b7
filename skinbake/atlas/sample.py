"""A texture map at the atlas's texels, without aliasing whatever its size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.atlas.interpolate import interpolate
from skinbake.atlas.raster import NO_FACE, AtlasRaster
from skinbake.atlas.rasterize import tile_origin
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]


def sample_map(
    raster: AtlasRaster, mesh: SkinMesh, images: dict[int, Image], constant: float | Sequence[float]
) -> Image:
    """Values of a map where each texel looks, shape (H, W) or (H, W, k); zero where the atlas is empty.

    A map with more texels than the atlas along an axis is first averaged over the atlas's texels along that axis
    (exact box); then it is read bilinearly, clamped at its borders. A map of the atlas's size is returned unchanged
    at texels whose centre a chart holds.

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    images : dict of int to ndarray of shape (h, w) or (h, w, k)
        By tile, as in SkinMaps.
    constant : float or sequence of k floats
        The value of a tile without a map.
    """
    flat = np.ndim(constant) == 0
    image = images.get(raster.tile)
    if image is None:
        values = np.zeros((*raster.shape, np.size(constant)), dtype=np.float32)
        values[raster.addressed] = np.asarray(constant, dtype=np.float32)
    else:
        image = image.reshape(*image.shape[:2], -1)
        image = np.ascontiguousarray(shrink(image, raster.shape), dtype=np.float32)
        uv = interpolate(raster, mesh.corner_uv - np.asarray(tile_origin(raster.tile)))
        values = np.zeros((*raster.shape, image.shape[2]), dtype=np.float32)
        _bilinear(raster.face_index, uv, image, values)
    return values[..., 0] if flat else values


def shrink(image: Image, shape: tuple[int, int]) -> Image:
    """Average over boxes along each axis where the image is larger than `shape`; the other axis is left as it is."""
    out = np.ascontiguousarray(image, dtype=np.float32)
    if image.shape[0] > shape[0]:
        out = _shrink_rows(out.reshape(image.shape[0], -1), shape[0]).reshape(shape[0], *image.shape[1:])
    if image.shape[1] > shape[1]:
        turned = np.ascontiguousarray(out.swapaxes(0, 1))
        turned = _shrink_rows(turned.reshape(image.shape[1], -1), shape[1]).reshape(shape[1], *turned.shape[1:])
        out = np.ascontiguousarray(turned.swapaxes(0, 1))
    return out


@njit(cache=True, parallel=True)
def _shrink_rows(image: Image, rows: int) -> Image:
    out = np.empty((rows, image.shape[1]), dtype=np.float32)
    ratio = image.shape[0] / rows
    for row in prange(rows):
        low, high = row * ratio, (row + 1) * ratio
        total = np.zeros(image.shape[1])
        for k in range(int(low), min(int(np.ceil(high)), image.shape[0])):
            weight = (min(high, k + 1.0) - max(low, float(k))) / ratio
            for i in range(image.shape[1]):
                total[i] += weight * image[k, i]
        for i in range(image.shape[1]):
            out[row, i] = total[i]
    return out


@njit(cache=True, parallel=True)
def _bilinear(face_index: NDArray[np.int32], uv: Image, image: Image, out: Image) -> None:
    height, width, channels = image.shape
    for row in prange(out.shape[0]):
        for col in range(out.shape[1]):
            if face_index[row, col] == NO_FACE:
                continue
            # v becomes a row the same way as in the raster: v = 1 is the top of row 0
            x = min(max(np.float64(uv[row, col, 0]) * width - 0.5, 0.0), width - 1.0)
            y = min(max((1.0 - np.float64(uv[row, col, 1])) * height - 0.5, 0.0), height - 1.0)
            x0, y0 = int(x), int(y)
            x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
            fx, fy = x - x0, y - y0
            for k in range(channels):
                top = image[y0, x0, k] * (1.0 - fx) + image[y0, x1, k] * fx
                bottom = image[y1, x0, k] * (1.0 - fx) + image[y1, x1, k] * fx
                out[row, col, k] = top * (1.0 - fy) + bottom * fy
