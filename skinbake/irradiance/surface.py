"""What the lights meet at each texel: where it is, which way it faces, what its oil lets through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, face_mm_per_texel, interpolate, sample_map
from skinbake.irradiance.normal_map import mapped_normals
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.shadow_origin import place, place_inside_texels
from skinbake.numerics import Float, normalized, safe_div
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec

Image = NDArray[np.float32]
TEXEL_SHARE = 0.01  # of a texel, by which a ray starts above its facet
SPACINGS = 16  # float32 spacings, the same
GOLDEN = (1 + 5**0.5) / 2
WORTH_CHECKING = 0.25  # of a texel: a shorter way to the smooth surface cannot cross anything


@dataclass(frozen=True)
class TexelSurface:
    """The texels of one tile, positions relative to the occluder's centre.

    Attributes
    ----------
    raster : AtlasRaster
    point : ndarray of shape (H, W, 3), float32
        On the facet.
    origin : ndarray of shape (H, W, 3), float32
        Where shadow rays start: on the smooth surface.
    normal, smooth_normal : ndarrays of shape (H, W, 3), float32
        Unit, with and without the normal map; the same array where there is none.
    roughness, strength : ndarrays of shape (H, W) or (1, 1), float32
        Beckmann m, and rho_s times the specular map.
    levels, corners, normals, lift : int and ndarrays by triangle of the smooth surface
    relief, per_texel : ndarrays by face
        For points inside a texel, see `origins_inside`.
    on_facet : ndarray of shape (H, W), bool
        Where another surface bars the way to the smooth surface.
    """

    raster: AtlasRaster
    point: Image
    origin: Image
    normal: Image
    smooth_normal: Image
    roughness: Image
    strength: Image
    levels: int
    corners: Float
    normals: Float
    lift: Float
    relief: Float
    per_texel: Float
    on_facet: NDArray[np.bool_]

    def origins_inside(self, texels: NDArray[np.int64], grid: int) -> Image:
        """Origins of a grid of rays inside each texel (row * W + col), shape (n, grid * grid, 3)."""
        return place_inside_texels(
            texels,
            grid,
            self.raster.face_index,
            self.raster.barycentric,
            self.per_texel,
            self.levels,
            self.corners,
            self.normals,
            self.lift,
            self.relief,
            self.on_facet,
        )


def texel_surface(
    raster: AtlasRaster, mesh: SkinMesh, maps: SkinMaps, specular: SpecularSpec, occluder: Occluder
) -> TexelSurface:
    """Gather it once a tile; every light uses it."""
    height, width = raster.shape
    fine = occluder.surface
    corners, lift, texel_mm = _lifted(mesh, occluder, (width, height))
    point, start, offset = _placed(raster.face_index, raster.barycentric, occluder, corners, lift)
    on_facet = _barred(raster, start, offset, texel_mm, occluder)
    offset[on_facet] = 0
    np.add(start, offset, out=offset)

    smooth = interpolate(raster, mesh.corner_normal)
    length = np.sqrt(np.einsum("hwi,hwi->hw", smooth, smooth))[..., None]
    np.divide(smooth, length, out=smooth, where=length > 0)
    return TexelSurface(
        raster,
        point,
        offset,
        mapped_normals(raster, mesh, maps, smooth),
        smooth,
        _map_or_constant(raster, mesh, maps.roughness, specular.roughness),
        np.float32(specular.strength) * _map_or_constant(raster, mesh, maps.specular, 1.0),
        fine.levels,
        corners,
        fine.corner_normal,
        lift,
        fine.relief_mm,
        _barycentrics_per_texel(mesh, width, height),
        on_facet,
    )


def scattered_origins(mesh: SkinMesh, occluder: Occluder, size: tuple[int, int], count: int) -> tuple[Image, Image]:
    """Ray origins at points spread evenly over the skin's area, and the smooth normals there, both (count, 3).

    The same points for the same mesh: one in each of `count` equal shares of the area, in the order of the faces.
    """
    total = np.cumsum(mesh.face_area_mm2)
    step = np.arange(count) + 0.5
    face = np.searchsorted(total, step / count * total[-1]).clip(max=len(total) - 1).astype(np.int32)
    root, along = np.sqrt(step / GOLDEN % 1), step / GOLDEN**2 % 1
    barycentric = np.stack([root * (1 - along), root * along], axis=-1).astype(np.float32)
    corners, lift, _ = _lifted(mesh, occluder, size)
    _, start, offset = _placed(face[None], barycentric[None], occluder, corners, lift)
    offset[0, occluder.occluded(start[0], offset[0], np.ones(count, np.float32))] = 0
    weight = np.concatenate([1 - barycentric.sum(axis=1, keepdims=True), barycentric], axis=1)
    normal = normalized(np.einsum("nk,nki->ni", weight, mesh.corner_normal[face]))
    return start[0] + offset[0], normal.astype(np.float32)


def _placed(
    face: NDArray[np.int32], barycentric: Image, occluder: Occluder, corners: Float, lift: Float
) -> tuple[Image, Image, Image]:
    """Points of the smooth surface, starts of the steps to ray origins, and those steps, each (H, W, 3)."""
    fine = occluder.surface
    point, start, offset = (np.zeros((*face.shape, 3), np.float32) for _ in range(3))
    place(
        face, barycentric, fine.levels, corners, fine.corner_normal, lift, fine.relief_mm, point, start, offset
    )  # fmt: skip
    return point, start, offset


def _lifted(mesh: SkinMesh, occluder: Occluder, size: tuple[int, int]) -> tuple[Float, Float, Float]:
    """Corners of the smooth surface's triangles, the step off each, both (n, 3) by corner or face, and texels in mm."""
    fine = occluder.surface
    corners = fine.positions_mm[fine.faces] - occluder.centre_mm
    facing = normalized(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    facing *= np.where(np.einsum("fi,fki->f", facing, fine.corner_normal) < 0, -1.0, 1.0)[:, None]
    texel_mm = face_mm_per_texel(mesh, size).min(axis=1)
    step_mm = TEXEL_SHARE * np.minimum(texel_mm, 1.0) + SPACINGS * occluder.spacing_mm
    return corners, facing * np.repeat(step_mm, 4**fine.levels)[:, None], texel_mm


def _barred(raster: AtlasRaster, start: Image, offset: Image, texel_mm: Float, occluder: Occluder) -> NDArray[np.bool_]:
    """Where the way from the facet to the smooth surface meets another surface, as between closed lips."""
    length = np.sqrt(np.einsum("hwi,hwi->hw", offset, offset))
    threshold = (WORTH_CHECKING * texel_mm).astype(np.float32)[raster.face_index]
    rows, cols = np.nonzero(raster.addressed & (length > threshold))
    barred = np.zeros(raster.shape, np.bool_)
    # `offset` is not scaled to length 1: a reach of 1 ends at the smooth surface
    barred[rows, cols] = occluder.occluded(start[rows, cols], offset[rows, cols], np.ones(len(rows), np.float32))
    return barred


def _barycentrics_per_texel(mesh: SkinMesh, width: int, height: int) -> Float:
    """Change of barycentrics 1 and 2 (last axis) with one column and one row (first), shape (F, 2, 2)."""
    d1, d2 = mesh.corner_uv[:, 1] - mesh.corner_uv[:, 0], mesh.corner_uv[:, 2] - mesh.corner_uv[:, 0]
    twice_area = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])[:, None]
    with_u = safe_div(np.stack([d2[:, 1], -d1[:, 1]], axis=1), twice_area)
    with_v = safe_div(np.stack([-d2[:, 0], d1[:, 0]], axis=1), twice_area)
    return np.stack([with_u / width, -with_v / height], axis=1)


def _map_or_constant(raster: AtlasRaster, mesh: SkinMesh, images: dict[int, Image], constant: float) -> Image:
    if raster.tile not in images:
        return np.full((1, 1), constant, np.float32)
    return sample_map(raster, mesh, images, constant)
