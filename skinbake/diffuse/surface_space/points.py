"""The skin points that texels show, as flat lists: what the 3-D methods sum over and evaluate at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, Tiled, first_fundamental_form, signed_uv_area, tile_origin
from skinbake.atlas.coverage import RasterArrays
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros, safe_div
from skinbake.scene.mesh import SkinMesh

MAX_BEYOND_TEXELS = 1.5  # bilinear reading at a chart's border looks one texel beyond it


class TexelPoints(NamedTuple):
    """Addressed texels of one tile, in raster order; kernels take it as it is.

    Attributes
    ----------
    row : ndarray of shape (H, W), int32
        Row of each texel in the lists below, -1 where the atlas is empty.
    flat_index : ndarray of shape (T,), int32
        row * W + col of each.
    position : ndarray of shape (T, 3), float32
        mm, relative to the `centre_mm` it was made with.
    normal : ndarray of shape (T, 3), float32
        Unit shading normals.
    area_mm2 : ndarray of shape (T,), float32
        Weight in surface sums, 0 in the gutter.
    texel_mm2 : ndarray of shape (T,), float32
        Square of a texel's shorter length on the skin (smaller stretch of the face, squared; at most the texel's
        area): the lattice that can show a lobe.
    """

    row: NDArray[np.int32]
    flat_index: NDArray[np.int32]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    area_mm2: NDArray[np.float32]
    texel_mm2: NDArray[np.float32]


def texel_points(raster: AtlasRaster, mesh: SkinMesh, centre_mm: Float, zeros: Zeros = np.zeros) -> TexelPoints:
    """Points of a raster's addressed texels.

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    centre_mm : ndarray of shape (3,)
        What positions are relative to.
    zeros : callable, optional
        Makes the lists.
    """
    height, width = raster.shape
    face_mm2 = _face_texel_mm2(raster, mesh)
    shorter_mm2 = np.minimum(_smaller_stretch2(mesh, width, height), face_mm2)
    row = zeros((height, width), np.int32)
    per_row = np.count_nonzero(raster.addressed, axis=1)
    count = int(per_row.sum())
    flat = zeros((count,), np.int32)
    position, normal = zeros((count, 3), np.float32), zeros((count, 3), np.float32)
    area, texel_mm2 = zeros((count,), np.float32), zeros((count,), np.float32)
    widest = np.zeros(height, dtype=np.float32)  # texel of each row that has skin
    out = TexelPoints(row, flat, position, normal, area, texel_mm2)
    faces = _Faces(mesh.corner_position_mm - centre_mm, mesh.corner_normal, shorter_mm2)
    start = np.cumsum(per_row) - per_row
    parallel_for(_points, height, _raster_arrays(raster), faces, start, out, widest)
    np.minimum(texel_mm2, widest.max(initial=0.0), out=texel_mm2)
    return out


def extended_points(
    points: TexelPoints, raster: AtlasRaster, mesh: SkinMesh, centre_mm: Float, zeros: Zeros = np.zeros
) -> TexelPoints:
    """The same points, but where a texel's centre lies beside its chart, on the closest face's plane at the centre.

    A smooth field evaluated there lets bilinear reading be right up to the chart's border, and nearly equal on both
    sides of a seam. The plane is continued by at most 1.5 texels.

    Parameters
    ----------
    points : TexelPoints
        `texel_points` of the raster.
    raster : AtlasRaster
    mesh : SkinMesh
    centre_mm : ndarray of shape (3,)
        What positions are relative to.
    zeros : callable, optional
        Makes the list of positions.
    """
    height, width = raster.shape
    u0, v0 = tile_origin(raster.tile)
    corner_xy = np.empty_like(mesh.corner_uv)
    corner_xy[..., 0] = (mesh.corner_uv[..., 0] - u0) * width
    corner_xy[..., 1] = (v0 + 1 - mesh.corner_uv[..., 1]) * height
    position = zeros(points.position.shape, np.float32)
    position[...] = points.position
    planes = _Planes(corner_xy, mesh.corner_position_mm - centre_mm, _face_texel_mm2(raster, mesh))
    parallel_for(_extend, len(position), points.flat_index, _raster_arrays(raster), planes, MAX_BEYOND_TEXELS, position)
    return points._replace(position=position)


def mean_texel_mm2(points: Tiled[TexelPoints]) -> float:
    """Skin area over the number of texels that show it, mm^2."""
    area = sum(float(p.area_mm2.sum(dtype=np.float64)) for p in points.values())
    return area / max(1, sum(int(np.count_nonzero(p.area_mm2)) for p in points.values()))


def _raster_arrays(raster: AtlasRaster) -> RasterArrays:
    """A raster as kernels take it."""
    return RasterArrays(raster.face_index, raster.barycentric, raster.coverage, raster.area_mm2)


def _face_texel_mm2(raster: AtlasRaster, mesh: SkinMesh) -> Float:
    """Skin in a texel of each face, (F,)."""
    height, width = raster.shape
    return safe_div(mesh.face_area_mm2, np.abs(signed_uv_area(mesh)) * width * height)


def _smaller_stretch2(mesh: SkinMesh, width: int, height: int) -> Float:
    """Smaller eigenvalue of each face's metric in texels, mm^2, shape (F,)."""
    e, f, h = (first_fundamental_form(mesh) / np.array([width**2, width * height, height**2])).T
    return 0.5 * (e + h - np.hypot(e - h, 2 * f))


class _Faces(NamedTuple):
    """The mesh's faces as `_points` takes them.

    Attributes
    ----------
    corner_mm, corner_normal : ndarrays of shape (F, 3, 3)
    shorter_mm2 : ndarray of shape (F,)
        Square of a texel's shorter length on the skin.
    """

    corner_mm: Float
    corner_normal: Float
    shorter_mm2: Float


class _Planes(NamedTuple):
    """Planes of the mesh's faces, on the texture and in space.

    Attributes
    ----------
    corner_xy : ndarray of shape (F, 3, 2)
        Texels, x to the right, y down.
    corner_mm : ndarray of shape (F, 3, 3)
    face_mm2 : ndarray of shape (F,)
        Skin in a texel of each face.
    """

    corner_xy: Float
    corner_mm: Float
    face_mm2: Float


@kernel
def _points(first, stop, raster, faces, start, out, widest):  # type: ignore[no-untyped-def]
    """Fill the points of rows of texels.

    Parameters
    ----------
    first, stop : int
        Rows.
    raster : RasterArrays
    faces : _Faces
    start : ndarray of shape (H,)
        First point of each row.
    out : TexelPoints
        Written.
    widest : ndarray of shape (H,), float32
        Written: largest `texel_mm2` of a texel of the row that has skin.
    """
    face_index, barycentric, area_mm2, coverage = (
        raster.face_index,
        raster.barycentric,
        raster.area_mm2,
        raster.coverage,
    )
    corner_mm, corner_normal, shorter_mm2 = faces.corner_mm, faces.corner_normal, faces.shorter_mm2
    flat, position, normal, area, texel_mm2 = out.flat_index, out.position, out.normal, out.area_mm2, out.texel_mm2
    row_out = out.row
    width = face_index.shape[1]
    for row in range(first, stop):
        n = start[row]
        for col in range(width):
            f = face_index[row, col]
            if f < 0:
                row_out[row, col] = -1
                continue
            b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            b0 = 1.0 - b1 - b2
            row_out[row, col] = n
            flat[n] = row * width + col
            area[n] = area_mm2[row, col]
            # Not the face's ratio where there is a better one: a sliver in UV would claim half the head
            covered = coverage[row, col]
            texel_mm2[n] = shorter_mm2[f]
            if covered > 0:
                texel_mm2[n] = min(shorter_mm2[f], area_mm2[row, col] / covered)
            if area[n] > 0:
                widest[row] = max(widest[row], texel_mm2[n])
            length2 = 0.0
            for k in range(3):
                position[n, k] = b0 * corner_mm[f, 0, k] + b1 * corner_mm[f, 1, k] + b2 * corner_mm[f, 2, k]
                m = b0 * corner_normal[f, 0, k] + b1 * corner_normal[f, 1, k] + b2 * corner_normal[f, 2, k]
                normal[n, k] = m
                length2 += m * m
            if length2 > 0:
                for k in range(3):
                    normal[n, k] /= np.sqrt(length2)
            n += 1


@kernel
def _extend(first, stop, flat_index, raster, planes, beyond, position):  # type: ignore[no-untyped-def]
    """Move the points whose texel's centre lies beside its chart.

    Parameters
    ----------
    first, stop : int
        Points.
    flat_index : ndarray of shape (T,), int32
    raster : RasterArrays
    planes : _Planes
    beyond : float
        Texels by which a plane is continued at most.
    position : ndarray of shape (T, 3), float32
        Changed in place.
    """
    face_index, barycentric, coverage = raster.face_index, raster.barycentric, raster.coverage
    corner_xy = planes.corner_xy
    width = face_index.shape[1]
    for n in range(first, stop):
        row, col = flat_index[n] // width, flat_index[n] % width
        if coverage[row, col] >= 1:
            continue
        f = face_index[row, col]
        b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
        b0 = 1.0 - b1 - b2
        # From the shown point to the texel's centre, in texels, then along the face's plane
        dx = col + 0.5 - (b0 * corner_xy[f, 0, 0] + b1 * corner_xy[f, 1, 0] + b2 * corner_xy[f, 2, 0])
        dy = row + 0.5 - (b0 * corner_xy[f, 0, 1] + b1 * corner_xy[f, 1, 1] + b2 * corner_xy[f, 2, 1])
        away = np.sqrt(dx * dx + dy * dy)
        if away > 1e-3:
            _continue_plane(planes, f, (dx, dy, away), beyond, position[n])


@kernel(inline=True)
def _continue_plane(planes, f, way, beyond, position):  # type: ignore[no-untyped-def]
    """Move a position by the face's affine map of a step of texels, as far as its mean texel lets it.

    Parameters
    ----------
    planes : _Planes
    f : int
        Face.
    way : tuple of three floats
        Step along x and y, and its length, texels.
    beyond : float
    position : ndarray of shape (3,), float32
        Changed in place.
    """
    xy, mm, mm2 = planes.corner_xy[f], planes.corner_mm[f], planes.face_mm2[f]
    dx, dy, away = way
    e1x, e1y = xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1]
    e2x, e2y = xy[2, 0] - xy[0, 0], xy[2, 1] - xy[0, 1]
    twice_area = e1x * e2y - e1y * e2x
    if twice_area == 0:
        return
    c1, c2 = (dx * e2y - dy * e2x) / twice_area, (dy * e1x - dx * e1y) / twice_area
    step = np.empty(3)
    length2 = 0.0
    for k in range(3):
        step[k] = c1 * (mm[1, k] - mm[0, k]) + c2 * (mm[2, k] - mm[0, k])
        length2 += step[k] * step[k]
    if length2 == 0:
        return
    share = min(1.0, beyond / away)
    share = min(share, 1.5 * beyond * np.sqrt(mm2 / length2))
    for k in range(3):
        position[k] += share * step[k]
