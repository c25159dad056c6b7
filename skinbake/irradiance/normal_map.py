"""Shading normals, with and without a normal map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, sample_map, signed_uv_area, uv_jacobian
from skinbake.atlas.raster import NO_FACE, ShownFaces
from skinbake.atlas.sample import bilinear, fitted_map, place_in_map
from skinbake.irradiance.shadow_origin import facet_point
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros, normalized
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]


def shading_normals(
    raster: AtlasRaster, mesh: SkinMesh, maps: SkinMaps, zeros: Zeros = np.zeros
) -> tuple[Image, Image]:
    """Unit normals without and with the normal map, each (H, W, 3); the same array where the tile has none.

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    maps : SkinMaps
    zeros : callable, optional
        Makes the images.
    """
    smooth = zeros((*raster.shape, 3), np.float32)
    parallel_for(_interpolate_unit, len(smooth), raster.face_index, raster.barycentric, mesh.corner_normal, smooth)
    if raster.tile not in maps.normal or (maps.normal_strength == 0 and maps.normal_space == "tangent"):
        return smooth, smooth
    if maps.normal_space == "object":
        values = sample_map(raster, mesh, maps.normal, (0.0, 0.0, 1.0))
        length = np.sqrt(np.einsum("hwi,hwi->hw", values, values))[..., None]
        return smooth, np.where(length > 0, values / np.where(length > 0, length, np.float32(1)), smooth)
    image, corner_uv = fitted_map(raster, mesh, maps.normal[raster.tile])
    handedness = np.where(signed_uv_area(mesh) < 0, -1.0, 1.0)
    mapped = zeros(smooth.shape, np.float32)
    frame = _TangentFrame(mesh.corner_normal, corner_tangents(mesh), handedness)
    tilt = _NormalMap(corner_uv, image, float(maps.normal_strength))
    parallel_for(_tilt, len(mapped), raster.shown, smooth, frame, tilt, mapped)
    return smooth, mapped


def corner_tangents(mesh: SkinMesh) -> Float:
    """Unit tangent at each corner, shape (F, 3, 3): the direction of growing u, orthogonal to the normal.

    MikkTSpace's [Mikkelsen2008], as programs that bake normal maps have it: each face's direction, laid into the plane
    of the corner's normal, averaged over the faces that share vertex, UV, normal and handedness, weighted by the
    corner's angle in that plane. Tangents that the file brings go before.
    """
    return mesh.derived(_corner_tangents)


def _corner_tangents(mesh: SkinMesh) -> Float:
    """As `corner_tangents`, computed."""
    p, normal = mesh.corner_position_mm, mesh.corner_normal

    def laid(vectors: Float) -> Float:
        """Directions in the planes of the corners' normals."""
        return normalized(vectors - normal * (normal * vectors).sum(-1, keepdims=True))

    to_next, to_last = laid(np.roll(p, -1, axis=1) - p), laid(np.roll(p, 1, axis=1) - p)
    angle = np.arccos(np.clip((to_next * to_last).sum(-1), -1, 1))
    weighted = laid(np.repeat(uv_jacobian(mesh)[:, :1], 3, axis=1)) * angle[..., None]
    owner = _sharing(mesh)
    summed: Float = np.stack([np.bincount(owner, weighted[..., k].ravel()) for k in range(3)], axis=1)
    summed = summed[owner].reshape(p.shape)
    if mesh.corner_tangent is not None:
        given = mesh.corner_tangent
        usable = np.isfinite(given).all(axis=2, keepdims=True) & given.any(axis=2, keepdims=True)
        summed = np.asarray(np.where(usable, given, summed), np.float64)
    tangents = laid(summed)
    tangents.setflags(write=False)
    return tangents


def _sharing(mesh: SkinMesh) -> NDArray[np.int64]:
    """A number for each corner, (3 F,): the same for those of one vertex, UV, normal and handedness."""
    vertex, count = mesh.faces.ravel(), len(mesh.positions_mm)
    mirrored = np.repeat(signed_uv_area(mesh) < 0, 3)
    key = np.column_stack([mesh.corner_uv.reshape(-1, 2), mesh.corner_normal.reshape(-1, 3), mirrored])
    # Most corners are like the first one of their vertex: only those that are not need sorting
    first = np.zeros(count, np.int64)
    first[vertex[::-1]] = np.arange(len(vertex))[::-1]
    apart = np.flatnonzero((key != key[first[vertex]]).any(axis=1))
    owner = vertex.astype(np.int64)
    rows = np.column_stack([owner[apart], key[apart]])
    owner[apart] = count + np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    return owner


@kernel
def _interpolate_unit(
    first: int, stop: int, face_index: NDArray[np.int32], barycentric: Image, corner: Float, out: Image
) -> None:
    """Corner vectors interpolated to the texels and scaled to length 1.

    Parameters
    ----------
    first, stop : int
        Rows.
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
    corner : ndarray of shape (F, 3, 3)
    out : ndarray of shape (H, W, 3)
        Written where the atlas is not empty.
    """
    for row in range(first, stop):
        for col in range(face_index.shape[1]):
            f = face_index[row, col]
            if f == NO_FACE:
                continue
            x, y, z = facet_point(corner, f, np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1]))
            length = np.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            out[row, col, 0], out[row, col, 1], out[row, col, 2] = x * scale, y * scale, z * scale


class _TangentFrame(NamedTuple):
    """Frame of a normal map on the mesh.

    Attributes
    ----------
    corner_normal, corner_tangent : ndarrays of shape (F, 3, 3)
        Of the mesh, and of `corner_tangents`.
    handedness : ndarray of shape (F,)
        -1 where the chart is mirrored, else 1.
    """

    corner_normal: Float
    corner_tangent: Float
    handedness: Float


class _NormalMap(NamedTuple):
    """A tangent-space normal map.

    Attributes
    ----------
    corner_uv : ndarray of shape (F, 3, 2)
        Within the tile, 0 ... 1.
    image : ndarray of shape (h, w, 3)
        x, y, z in -1 ... 1.
    strength : float
        Scales x and y.
    """

    corner_uv: Float
    image: Image
    strength: float


@kernel
def _tilt(
    first: int, stop: int, shown: ShownFaces, smooth: Image, frame: _TangentFrame, tilt: _NormalMap, out: Image
) -> None:
    """Smooth normals tilted by a tangent-space normal map, which was baked for MikkTSpace's frames.

    Those are interpolated as they are, neither made unit nor orthogonal between the corners.

    Parameters
    ----------
    first, stop : int
        Rows.
    shown : ShownFaces
    smooth : ndarray of shape (H, W, 3)
        Unit normals.
    frame : _TangentFrame
    tilt : _NormalMap
    out : ndarray of shape (H, W, 3)
        Written where the atlas is not empty.
    """
    face_index, barycentric, image, strength = shown.face_index, shown.barycentric, tilt.image, tilt.strength
    for row in range(first, stop):
        for col in range(face_index.shape[1]):
            f = face_index[row, col]
            if f == NO_FACE:
                continue
            nx, ny, nz = (
                np.float64(smooth[row, col, 0]),
                np.float64(smooth[row, col, 1]),
                np.float64(smooth[row, col, 2]),
            )
            b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            tx, ty, tz = facet_point(frame.corner_tangent, f, b1, b2)
            around = place_in_map(tilt.corner_uv, f, b1, b2, image.shape[0], image.shape[1])
            z = bilinear(image, 2, around)
            if tx * tx + ty * ty + tz * tz < 1e-12 or z <= 0.0:  # no frame, or an unpainted texel
                out[row, col, 0], out[row, col, 1], out[row, col, 2] = nx, ny, nz
                continue
            x = strength * bilinear(image, 0, around)
            y = strength * bilinear(image, 1, around)
            nx, ny, nz = facet_point(frame.corner_normal, f, b1, b2)
            # Growing v: n x t, turned round where the chart is mirrored
            side = frame.handedness[f]
            bx, by, bz = side * (ny * tz - nz * ty), side * (nz * tx - nx * tz), side * (nx * ty - ny * tx)
            mx, my, mz = x * tx + y * bx + z * nx, x * ty + y * by + z * ny, x * tz + y * bz + z * nz
            length = np.sqrt(mx * mx + my * my + mz * mz)
            out[row, col, 0], out[row, col, 1], out[row, col, 2] = mx / length, my / length, mz / length
