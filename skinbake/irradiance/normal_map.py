"""Shading normals with a normal map."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, interpolate, sample_map, signed_uv_area, uv_jacobian
from skinbake.atlas.raster import NO_FACE
from skinbake.numerics import Float, normalized
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]


def mapped_normals(raster: AtlasRaster, mesh: SkinMesh, maps: SkinMaps, smooth: Image) -> Image:
    """Unit shading normals, shape (H, W, 3); `smooth` itself where the tile has no normal map.

    Parameters
    ----------
    smooth : ndarray of shape (H, W, 3)
        Unit interpolated normals.
    """
    if raster.tile not in maps.normal or (maps.normal_strength == 0 and maps.normal_space == "tangent"):
        return smooth
    values = sample_map(raster, mesh, maps.normal, (0.0, 0.0, 1.0))
    if maps.normal_space == "object":
        length = np.sqrt(np.einsum("hwi,hwi->hw", values, values))[..., None]
        return np.where(length > 0, values / np.where(length > 0, length, np.float32(1)), smooth)
    tangent = interpolate(raster, corner_tangents(mesh))
    handedness = np.where(signed_uv_area(mesh) < 0, -1.0, 1.0)
    out = np.zeros_like(smooth)
    _tilt(raster.face_index, smooth, tangent, handedness, values, float(maps.normal_strength), out)
    return out


def corner_tangents(mesh: SkinMesh) -> Float:
    """Direction of growing u at each corner, orthogonal to its normal, unit, shape (F, 3, 3).

    The faces' own Jacobians, averaged by corner angle over the faces that share the vertex and its UV, so that a normal
    map does not show the triangles; seams and mirrored charts stay apart.
    """
    p_u = normalized(uv_jacobian(mesh)[:, 0])
    side = (signed_uv_area(mesh) < 0).astype(np.float64)
    key = np.concatenate(
        [mesh.faces[..., None], mesh.corner_uv, np.broadcast_to(side[:, None, None], (len(side), 3, 1))], 2
    )
    _, owner = np.unique(key.reshape(-1, 4), axis=0, return_inverse=True)
    p = mesh.corner_position_mm
    to_next, to_last = normalized(np.roll(p, -1, axis=1) - p), normalized(np.roll(p, 1, axis=1) - p)
    angle = np.arccos(np.clip((to_next * to_last).sum(-1), -1, 1)).ravel()
    weighted = np.repeat(p_u, 3, axis=0) * angle[:, None]
    owner = owner.ravel()
    summed = np.stack([np.bincount(owner, weighted[:, k]) for k in range(3)], axis=1)[owner].reshape(p.shape)
    normal = mesh.corner_normal
    return normalized(summed - normal * (normal * summed).sum(-1, keepdims=True))


@njit(cache=True, parallel=True)
def _tilt(
    face_index: NDArray[np.int32],
    smooth: Image,
    tangent: Image,
    handedness: Float,
    values: Image,
    strength: float,
    out: Image,
) -> None:
    height, width = face_index.shape
    for row in prange(height):
        for col in range(width):
            f = face_index[row, col]
            if f == NO_FACE:
                continue
            nx, ny, nz = (
                np.float64(smooth[row, col, 0]),
                np.float64(smooth[row, col, 1]),
                np.float64(smooth[row, col, 2]),
            )
            tx, ty, tz = tangent[row, col, 0], tangent[row, col, 1], tangent[row, col, 2]
            along = tx * nx + ty * ny + tz * nz
            tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
            length = np.sqrt(tx * tx + ty * ty + tz * tz)
            x, y, z = values[row, col, 0] * strength, values[row, col, 1] * strength, values[row, col, 2]
            if length < 1e-12 or z <= 0.0:  # no frame, or an unpainted texel
                out[row, col, 0], out[row, col, 1], out[row, col, 2] = nx, ny, nz
                continue
            tx, ty, tz = tx / length, ty / length, tz / length
            # Growing v: n x t, turned round where the chart is mirrored
            side = handedness[f]
            bx, by, bz = side * (ny * tz - nz * ty), side * (nz * tx - nx * tz), side * (nx * ty - ny * tx)
            mx, my, mz = x * tx + y * bx + z * nx, x * ty + y * by + z * ny, x * tz + y * bz + z * nz
            length = np.sqrt(mx * mx + my * my + mz * mz)
            out[row, col, 0], out[row, col, 1], out[row, col, 2] = mx / length, my / length, mz / length
