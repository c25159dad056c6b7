"""Surface that lights meet at each texel: position, normals, and the oil layer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, face_mm_per_texel, sample_map
from skinbake.atlas.raster import ShownFaces
from skinbake.irradiance.normal_map import shading_normals
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.shadow_origin import (
    InsideTexels,
    SubdividedMesh,
    SurfaceTexels,
    long_ways,
    place,
    place_inside_texels,
)
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros, normalized, safe_div
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec

Image = NDArray[np.float32]
Index = NDArray[np.int64]
GOLDEN = (1 + 5**0.5) / 2
TEXEL_SHARE = 0.01  # of a texel, by which a ray starts above its facet
SPACINGS = 16  # float32 spacings, the same
WORTH_CHECKING = 0.25  # of a texel: a shorter way to the smooth surface cannot cross anything


@dataclass(frozen=True)
class TexelSurface:
    """Surface at the texels of one tile.

    Attributes
    ----------
    raster : AtlasRaster
    normal, smooth_normal : ndarrays of shape (H, W, 3), float32
        Unit, with and without the normal map; the same array where there is none.
    roughness, strength : ndarrays of shape (H, W) or (1, 1), float32
        Beckmann m, and rho_s times the specular map.
    f0 : ndarray of shape (H, W) or (1, 1), float64
        Reflectance of the oil at normal incidence.
    occluder : Occluder
        Positions are computed from its triangles where they are asked for, since most texels never are.
    texel_mm : ndarray of shape (F,)
        Shorter length of a texel of each face.
    per_texel : ndarray of shape (F, 2, 2)
        Change of the barycentrics with a step of one column and one row, see `place_inside_texels`.
    """

    raster: AtlasRaster
    normal: Image
    smooth_normal: Image
    roughness: Image
    strength: Image
    f0: Float
    occluder: Occluder
    texel_mm: Float
    per_texel: Float

    @property
    def subdivided(self) -> SubdividedMesh:
        """Triangles that rays meet."""
        return self.occluder.subdivided

    @property
    def texels(self) -> SurfaceTexels:
        """What each texel shows, for the kernels."""
        return SurfaceTexels(self.raster.face_index, self.raster.barycentric, self.normal, self.smooth_normal)

    @cached_property
    def on_facet(self) -> NDArray[np.bool_]:
        """Texels at which another surface, as between closed lips, bars the way from facet to smooth surface, (H,
        W).
        """
        raster, step_mm = self.raster, _step_mm(self.texel_mm, self.occluder)
        barred = np.empty(raster.shape, np.bool_)
        threshold_mm = WORTH_CHECKING * self.texel_mm
        parallel_for(long_ways, len(barred), raster.shown, self.subdivided, step_mm, threshold_mm, barred)
        texels, flat = np.flatnonzero(barred), barred.reshape(-1)
        face, barycentric = raster.face_index.reshape(-1)[texels], raster.barycentric.reshape(-1, 2)[texels]
        *_, flat[texels] = _ways_up(face, barycentric, self.occluder, step_mm)
        return barred

    def origins(self, texels: Index) -> Image:
        """Origins of the shadow rays of texels (row * W + col), on the smooth surface, mm, shape (n, 3)."""
        return self.origins_inside(texels, 1)[:, 0]

    def origins_inside(self, texels: Index, grid: int) -> Image:
        """Origins of a grid of rays inside each texel, mm, shape (n, grid * grid, 3)."""
        out = np.empty((len(texels), grid * grid, 3), np.float32)
        inside = InsideTexels(texels, grid, self.per_texel, self.on_facet)
        step_mm = _step_mm(self.texel_mm, self.occluder)
        parallel_for(place_inside_texels, len(out), inside, self.raster.shown, self.subdivided, step_mm, out)
        return out


def texel_surface(
    raster: AtlasRaster,
    mesh: SkinMesh,
    maps: SkinMaps,
    specular: SpecularSpec,
    occluder: Occluder,
    zeros: Zeros = np.zeros,
) -> TexelSurface:
    """Surface of one tile's texels; every light uses it.

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    maps : SkinMaps
    specular : SpecularSpec
    occluder : Occluder
    zeros : callable, optional
        Makes the normals' images.
    """
    height, width = raster.shape
    smooth, normal = shading_normals(raster, mesh, maps, zeros)
    return TexelSurface(
        raster,
        normal,
        smooth,
        _map_or_constant(raster, mesh, maps.roughness, specular.roughness),
        np.float32(specular.strength) * _map_or_constant(raster, mesh, maps.specular, 1.0),
        _map_or_constant(raster, mesh, maps.f0, specular.f0, np.float64),
        occluder,
        face_mm_per_texel(mesh, (width, height)).min(axis=1),
        _barycentrics_per_texel(mesh, width, height),
    )


def places_of_texels(raster: AtlasRaster, texels: Index, mesh: SkinMesh, occluder: Occluder) -> tuple[Image, Image]:
    """Ray origins of some texels (row * W + col), mm, and the smooth normals there, both (n, 3).

    The same as those of `texel_surface`, which works out those of all.

    Parameters
    ----------
    raster : AtlasRaster
    texels : ndarray of shape (n,), int64
    mesh : SkinMesh
    occluder : Occluder
    """
    height, width = raster.shape
    face, barycentric = raster.face_index.reshape(1, -1)[:, texels], raster.barycentric.reshape(1, -1, 2)[:, texels]
    nothing = np.zeros(face.shape, np.float32)
    some = AtlasRaster(raster.tile, face, barycentric, nothing, nothing)
    normal, _ = shading_normals(some, mesh, SkinMaps())
    unused, one = np.zeros((len(mesh.faces), 2, 2)), np.zeros((1, 1), np.float32)  # one ray a texel, from its centre
    texel_mm = face_mm_per_texel(mesh, (width, height)).min(axis=1)
    surface = TexelSurface(some, normal, normal, one, one, one.astype(np.float64), occluder, texel_mm, unused)
    return surface.origins(np.arange(len(texels))), normal[0]


def scattered_origins(mesh: SkinMesh, occluder: Occluder, size: tuple[int, int], count: int) -> tuple[Image, Image]:
    """Ray origins at points spread evenly over the skin's area, mm, and the smooth normals there, both (count, 3).

    The same points for the same mesh: one in each of `count` equal shares of the area, in the order of the faces.

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
    size : (width, height)
        Size of the texture, whose texels set the step off the facet.
    count : int
    """
    step = np.arange(count) + 0.5
    face = scattered_faces(mesh, count)
    root, along = np.sqrt(step / GOLDEN % 1), step / GOLDEN**2 % 1
    barycentric = np.stack([root * (1 - along), root * along], axis=-1).astype(np.float32)
    start, way, barred = _ways_up(
        face, barycentric, occluder, _step_mm(face_mm_per_texel(mesh, size).min(axis=1), occluder)
    )
    way[barred] = 0
    weight = np.concatenate([1 - barycentric.sum(axis=1, keepdims=True), barycentric], axis=1)
    normal = normalized(np.einsum("nk,nki->ni", weight, mesh.corner_normal[face]))
    return start + way, normal.astype(np.float32)


def scattered_faces(mesh: SkinMesh, count: int) -> NDArray[np.int32]:
    """Faces of the points of `scattered_origins`, (count,)."""
    total = np.cumsum(mesh.face_area_mm2)
    step = np.arange(count) + 0.5
    return np.searchsorted(total, step / count * total[-1]).clip(max=len(total) - 1).astype(np.int32)


def _step_mm(texel_mm: Float, occluder: Occluder) -> Float:
    """Step off each face that round-off asks for, mm, shape (F,)."""
    return TEXEL_SHARE * np.minimum(texel_mm, 1.0) + SPACINGS * occluder.spacing_mm


def _ways_up(
    face: NDArray[np.int32], barycentric: Image, occluder: Occluder, step_mm: Float
) -> tuple[Image, Image, NDArray[np.bool_]]:
    """Starts above the facet and offsets to the smooth surface at places in faces, (n, 3), and which offsets are
    barred.
    """
    start, way = np.empty((len(face), 3), np.float32), np.empty((len(face), 3), np.float32)
    parallel_for(place, len(face), ShownFaces(face, barycentric), occluder.subdivided, step_mm, start, way)
    # `way` is not scaled to length 1: a reach of 1 ends at the smooth surface
    return start, way, occluder.occluded(start, way, np.ones(len(face), np.float32))


def _barycentrics_per_texel(mesh: SkinMesh, width: int, height: int) -> Float:
    """Change of barycentrics 1 and 2 (last axis) with one column and one row (first), shape (F, 2, 2)."""
    d1, d2 = mesh.corner_uv[:, 1] - mesh.corner_uv[:, 0], mesh.corner_uv[:, 2] - mesh.corner_uv[:, 0]
    twice_area = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])[:, None]
    with_u = safe_div(np.stack([d2[:, 1], -d1[:, 1]], axis=1), twice_area)
    with_v = safe_div(np.stack([-d2[:, 0], d1[:, 0]], axis=1), twice_area)
    return np.stack([with_u / width, -with_v / height], axis=1)


def _map_or_constant(
    raster: AtlasRaster, mesh: SkinMesh, images: dict[int, Image], constant: float, kind: Any = np.float32
) -> NDArray[Any]:
    """Map values (H, W) of the raster's tile, or a constant as (1, 1).

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    images : dict of int to ndarray
    constant : float
    kind : dtype
    """
    if raster.tile not in images:
        return np.full((1, 1), constant, kind)
    return sample_map(raster, mesh, images, constant).astype(kind, copy=False)
