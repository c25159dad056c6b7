"""Rasterisation: a mesh with UVs becomes its atlas."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.border import chart_edges, nearest_chart_points
from skinbake.atlas.coverage import RasterArrays, bin_by_band, rasterize_coverage
from skinbake.atlas.raster import NO_FACE, Atlas, AtlasRaster, ShownFaces
from skinbake.atlas.texel_coordinates import corner_texels, tiles_of
from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh


def rasterize(mesh: SkinMesh, size: tuple[int, int], gutter: int = 8, udim: bool = False) -> Atlas:
    """Atlas of a mesh: for each texel its place on the mesh, its coverage and its area; one raster a tile.

    Coverage and area are exact (each triangle is clipped to each texel's square), so that areas sum to the area of the
    mesh. A texel shows the chart point at its centre; where no chart holds the centre, the closest chart point; where
    charts overlap, the face of lowest index. Every texel within `gutter` of a chart is addressed.

    Parameters
    ----------
    mesh : SkinMesh
        Faces of zero UV area are left out.
    size : (width, height) in texels
    gutter : int
        Texels around each chart that get the closest chart point, without weight.
    udim : bool
        One raster for each UDIM tile that holds the centre of a face; otherwise u, v in [0, 1] only, and what lies
        outside is left out (`uv_report` counts it).

    Returns
    -------
    Atlas
        Tiles in ascending order; a single raster of tile 1001 without `udim`.

    Raises
    ------
    ValueError
        If the size is below 1 x 1 or the gutter negative.
    InputError
        As `tiles_of`.
    """
    width, height = size
    if width < 1 or height < 1 or gutter < 0:
        raise ValueError(f"expected size >= 1 x 1 and gutter >= 0, got {size} and {gutter}")
    uv_area, edges = mesh.derived(_charts)  # of every size alike
    return tuple(_rasterize_tile(mesh, tile, size, gutter, uv_area, edges) for tile in tiles_of(mesh, udim))


def _charts(mesh: SkinMesh) -> tuple[Float, NDArray[np.int64]]:
    """Area of each face in UV space, and the edges on the borders of charts (`chart_edges`)."""
    uv_area = signed_uv_area(mesh)
    return uv_area, chart_edges(mesh, uv_area)


def signed_uv_area(mesh: SkinMesh) -> Float:
    """Area of each face in UV space, shape (F,), negative where flipped."""
    a, b, c = np.moveaxis(mesh.corner_uv, 1, 0)
    ab, ac = b - a, c - a
    return 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def _rasterize_tile(
    mesh: SkinMesh, tile: int, size: tuple[int, int], gutter: int, uv_area: Float, edges: NDArray[np.int64]
) -> AtlasRaster:
    """Raster of one tile: coverage, centres, then closest points for the rest."""
    width, height = size
    corner_xy = corner_texels(mesh, tile, (height, width))

    face_index = np.full((height, width), NO_FACE, dtype=np.int32)
    barycentric = np.zeros((height, width, 2), dtype=np.float32)
    coverage = np.zeros((height, width), dtype=np.float32)
    area_mm2 = np.zeros((height, width), dtype=np.float32)

    # Faces of this tile; NaN rows keep the others (and degenerate ones) out of every band
    y = corner_xy[..., 1]
    first, second, third = np.moveaxis(corner_xy, 1, 0)
    (left, low), (right, high) = (of(of(first, second), third).T for of in (np.minimum, np.maximum))
    outside = (right < 0) | (left > width) | (uv_area == 0)
    low, high = np.where(outside, np.nan, low), np.where(outside, np.nan, high)
    bands = bin_by_band(low, high, height)
    mm2_per_texel = safe_div(mesh.face_area_mm2, np.abs(uv_area) * width * height)
    rasterize_coverage(corner_xy, mm2_per_texel, bands, RasterArrays(face_index, barycentric, coverage, area_mm2))

    # A texel that a chart touches beside its centre lies within half a diagonal of the chart
    radius = max(float(gutter), 1.0)
    ends = y[edges // 3, edges % 3], y[edges // 3, (edges + 1) % 3]
    bands = bin_by_band(np.minimum(*ends) - radius - 1, np.maximum(*ends) + radius + 1, height)
    nearest_chart_points(corner_xy, edges, bands, radius, ShownFaces(face_index, barycentric))
    if gutter == 0:
        untouched = coverage == 0
        face_index[untouched] = NO_FACE
        barycentric[untouched] = 0
    coverage *= face_index != NO_FACE
    return AtlasRaster(tile, face_index, barycentric, coverage, area_mm2)
