"""Values known at the corners of the mesh, at every texel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE, AtlasRaster
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for


def interpolate(raster: AtlasRaster, corner_values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Values at texel centres, shape (H, W, k), float32; zero where the atlas is empty.

    Parameters
    ----------
    raster : AtlasRaster
    corner_values : ndarray of shape (F, 3, k)
        `mesh.corner_position_mm`, `mesh.corner_normal`, ...

    Raises
    ------
    ValueError
        If `corner_values` has another shape.
    """
    if corner_values.ndim != 3 or corner_values.shape[1] != 3:
        raise ValueError(f"corner_values: expected shape (F, 3, k), got {corner_values.shape}")
    values = np.ascontiguousarray(corner_values, dtype=np.float64)
    out = np.zeros((*raster.shape, values.shape[2]), dtype=np.float32)
    parallel_for(_interpolate, len(out), raster.face_index, raster.barycentric, values, out)
    return out


@kernel
def _interpolate(
    first: int,
    stop: int,
    face_index: NDArray[np.int32],
    barycentric: NDArray[np.float32],
    values: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """Blend corner values by each texel's barycentrics; empty texels stay as they are.

    Parameters
    ----------
    first, stop : int
        Rows.
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
    values : ndarray of shape (F, 3, k)
    out : ndarray of shape (H, W, k)
        Written.
    """
    width = face_index.shape[1]
    for row in range(first, stop):
        for col in range(width):
            f = face_index[row, col]
            if f == NO_FACE:
                continue
            b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            b0 = 1.0 - b1 - b2
            for k in range(values.shape[2]):
                out[row, col, k] = b0 * values[f, 0, k] + b1 * values[f, 1, k] + b2 * values[f, 2, k]
