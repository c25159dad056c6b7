"""Texture maps at the atlas's texels, without aliasing whatever the map's size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE, AtlasRaster
from skinbake.atlas.texel_coordinates import local_uv, texel_xy_kernel
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
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
        image, corner_uv = fitted_map(raster, mesh, image)
        values = np.zeros((*raster.shape, image.shape[2]), dtype=np.float32)
        parallel_for(_read_map, len(values), raster.face_index, raster.barycentric, corner_uv, image, values)
    return values[..., 0] if flat else values


def fitted_map(raster: AtlasRaster, mesh: SkinMesh, image: Image) -> tuple[Image, Float]:
    """Map averaged down to at most the atlas's size, and the corners' UVs within the tile.

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    image : ndarray of shape (h, w) or (h, w, k)

    Returns
    -------
    image : ndarray of shape (h', w', k), float32
    corner_uv : ndarray of shape (F, 3, 2)
    """
    image = image.reshape(*image.shape[:2], -1)
    return shrink(image, raster.shape), local_uv(mesh.corner_uv, raster.tile)


def shrink(image: Image, shape: tuple[int, int]) -> Image:
    """Average an image over boxes along each axis on which it is larger than `shape` (rows, columns)."""
    out = np.ascontiguousarray(image, dtype=np.float32)
    if image.shape[0] > shape[0]:
        out = _shrink_rows(out.reshape(image.shape[0], -1), shape[0]).reshape(shape[0], *image.shape[1:])
    if image.shape[1] > shape[1]:
        turned = np.ascontiguousarray(out.swapaxes(0, 1))
        turned = _shrink_rows(turned.reshape(image.shape[1], -1), shape[1]).reshape(shape[1], *turned.shape[1:])
        out = np.ascontiguousarray(turned.swapaxes(0, 1))
    return out


def _shrink_rows(image: Image, rows: int) -> Image:
    """Image (h, n) averaged over boxes to `rows` rows; boxes may end within a row."""
    out = np.empty((rows, image.shape[1]), dtype=np.float32)
    parallel_for(_average_rows, rows, image, out)
    return out


@kernel
def _average_rows(first: int, stop: int, image: Image, out: Image) -> None:
    """Average an image (h, n) over boxes to those rows of `out` (rows, n)."""
    ratio = image.shape[0] / len(out)
    for row in range(first, stop):
        low, high = row * ratio, (row + 1) * ratio
        total = np.zeros(image.shape[1])
        for k in range(int(low), min(int(np.ceil(high)), image.shape[0])):
            weight = (min(high, k + 1.0) - max(low, float(k))) / ratio
            for i in range(image.shape[1]):
                total[i] += weight * image[k, i]
        for i in range(image.shape[1]):
            out[row, i] = total[i]


@kernel
def _read_map(
    first: int,
    stop: int,
    face_index: NDArray[np.int32],
    barycentric: Image,
    corner_uv: Float,
    image: Image,
    out: Image,
) -> None:
    """Map values (H, W, k) at the texels, written to `out`.

    Parameters
    ----------
    first, stop : int
        Rows.
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
    corner_uv : ndarray of shape (F, 3, 2)
        Within the tile, 0 ... 1.
    image : ndarray of shape (h, w, k)
    out : ndarray of shape (H, W, k)
    """
    for row in range(first, stop):
        for col in range(out.shape[1]):
            f = face_index[row, col]
            if f == NO_FACE:
                continue
            b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            around = place_in_map(corner_uv, f, b1, b2, image.shape[0], image.shape[1])
            for k in range(image.shape[2]):
                out[row, col, k] = bilinear(image, k, around)


@kernel(inline=True)
def place_in_map(
    corner_uv: Float, f: int, b1: float, b2: float, height: int, width: int
) -> tuple[int, int, float, int, int, float]:
    """The two rows and two columns of a map between which a place in a face lies.

    Parameters
    ----------
    corner_uv : ndarray of shape (F, 3, 2)
        Within the tile, 0 ... 1.
    f : int
        Face.
    b1, b2 : float
        Barycentric weights of its corners 1 and 2.
    height, width : int
        Size of the map.

    Returns
    -------
    y0, y1, fy, x0, x1, fx : int, int, float, int, int, float
        Both rows and the share of the second, then columns likewise.
    """
    b0 = 1.0 - b1 - b2
    u = b0 * corner_uv[f, 0, 0] + b1 * corner_uv[f, 1, 0] + b2 * corner_uv[f, 2, 0]
    v = b0 * corner_uv[f, 0, 1] + b1 * corner_uv[f, 1, 1] + b2 * corner_uv[f, 2, 1]
    return texels_around(u, v, height, width)


@kernel(inline=True)
def texels_around(u: float, v: float, height: int, width: int) -> tuple[int, int, float, int, int, float]:
    """The two rows and two columns of a map whose centres lie around a UV; the nearest ones beyond its border.

    Parameters
    ----------
    u, v : float
        Within the tile, 0 ... 1.
    height, width : int
        Size of the map.

    Returns
    -------
    y0, y1, fy, x0, x1, fx
        As `place_in_map` returns them.
    """
    x, y = texel_xy_kernel(u, v, height, width)
    x = min(max(x - 0.5, 0.0), width - 1.0)
    y = min(max(y - 0.5, 0.0), height - 1.0)
    x0, y0 = int(x), int(y)
    return y0, min(y0 + 1, height - 1), y - y0, x0, min(x0 + 1, width - 1), x - x0


@kernel(inline=True)
def bilinear(image: Image, k: int, around: tuple[int, int, float, int, int, float]) -> float:
    """Channel k of a map, read bilinearly.

    Parameters
    ----------
    image : ndarray of shape (h, w, channels)
    k : int
    around
        y0, y1, fy, x0, x1, fx as `place_in_map` returns them.
    """
    y0, y1, fy, x0, x1, fx = around
    top = image[y0, x0, k] * (1.0 - fx) + image[y0, x1, k] * fx
    bottom = image[y1, x0, k] * (1.0 - fx) + image[y1, x1, k] * fx
    return top * (1.0 - fy) + bottom * fy
