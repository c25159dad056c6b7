"""The skin at every stored size: what all lobes share and no light changes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, Atlas, Tiled, Tiles, rasterize
from skinbake.diffuse.aside import IN_MEMORY, Aside
from skinbake.diffuse.surface_space.points import TexelPoints, extended_points, mean_texel_mm2, texel_points
from skinbake.diffuse.surface_space.upsample import least_sigma
from skinbake.diffuse.texture_space.blur import level_size, mean_mm_per_texel
from skinbake.diffuse.texture_space.stretch import chart_of_face, smooth_inverse_metric, uv_vertices
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

LEVEL_GUTTER = 3  # texels around the charts of a smaller stored size: bilinear reading needs one


class SkinGeometry:
    """Rasters and skin points by stored size, each made when it is first asked for and then kept.

    A stored size is named by its level: the full size halved that many times.

    Parameters
    ----------
    atlas : Atlas
        At the full size.
    mesh : SkinMesh
    aside : Aside, optional
        Where points stand while nobody reads them.
    """

    def __init__(self, atlas: Atlas, mesh: SkinMesh, aside: Aside = IN_MEMORY) -> None:
        self.atlas, self.mesh, self._aside = atlas, mesh, aside
        self.size = atlas[0].shape
        self._atlases: dict[int, Atlas] = {0: atlas}
        self._targets: dict[int, Tiled[TexelPoints]] = {}
        self._least_sigma: dict[tuple[int, float], Tiles] = {}

    @cached_property
    def centre_mm(self) -> Float:
        """Origin of all skin points, (3,): about it float32 resolves them."""
        corners = self.mesh.corner_position_mm.reshape(-1, 3)
        centre: Float = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return centre

    @cached_property
    def points(self) -> Tiled[TexelPoints]:
        """Skin points that the texels of the full size show."""
        return self._points(0)

    @cached_property
    def mean_texel_mm2(self) -> float:
        """Skin area over the number of texels that show it, mm^2."""
        return mean_texel_mm2(self.points)

    @cached_property
    def mm_per_texel(self) -> tuple[float, float]:
        """Mean length of a texel along a step of (row, column), mm: the one texel size of the texture method."""
        return mean_mm_per_texel(self.mesh, self.size)

    @cached_property
    def metric(self) -> tuple[Float, NDArray[np.int32]]:
        """Inverse metric of the skin in UV, smooth over edges, (F, 3, 3), and the chart of each face, (F,)."""
        corner = uv_vertices(self.mesh)
        return smooth_inverse_metric(self.mesh, corner), chart_of_face(corner)

    def variance_texels2(self, variance_mm2: float) -> tuple[float, float]:
        """A variance in mean texels of the full size squared, along (row, column)."""
        return variance_mm2 / self.mm_per_texel[0] ** 2, variance_mm2 / self.mm_per_texel[1] ** 2

    def level_atlas(self, level: int) -> Atlas:
        """The mesh rasterised at a stored size."""
        if level not in self._atlases:
            height, width = level_size(self.size, level)
            udim = len(self.atlas) > 1 or self.atlas[0].tile != FIRST_TILE
            again = {r.tile: r for r in rasterize(self.mesh, (width, height), LEVEL_GUTTER, udim)}
            self._atlases[level] = tuple(again[r.tile] for r in self.atlas)
        return self._atlases[level]

    def targets(self, level: int) -> Tiled[TexelPoints]:
        """Skin points of the texels at a stored size, continued beyond the charts' borders."""
        if level not in self._targets:
            own = self.points if level == 0 else self._points(level)
            self._targets[level] = {
                r.tile: extended_points(own[r.tile], r, self.mesh, self.centre_mm, self._aside.zeros)
                for r in self.level_atlas(level)
            }
        return self._targets[level]

    def least_sigma(self, level: int, gap: float) -> Tiles:
        """Narrowest lobe, in mm, that may be interpolated at each texel of a level from the next smaller size.

        `gap` is the greatest distance, in sigma, between the texels interpolated. Shape (h, w) a tile.
        """
        if (level, gap) not in self._least_sigma:
            coarse, fine = self.targets(level + 1), self.targets(level)
            self._least_sigma[level, gap] = {tile: least_sigma(coarse[tile], fine[tile], gap) for tile in fine}
        return self._least_sigma[level, gap]

    def _points(self, level: int) -> Tiled[TexelPoints]:
        zeros = self._aside.zeros
        points = {r.tile: texel_points(r, self.mesh, self.centre_mm, zeros) for r in self.level_atlas(level)}
        self._aside.rest()  # of the raster
        return points
