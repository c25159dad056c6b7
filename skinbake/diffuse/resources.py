"""What the lobes of one bake share: the light, its pyramids and trees, and the skin points at each stored size."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, Atlas, rasterize
from skinbake.diffuse.surface_space.clusters import bending
from skinbake.diffuse.surface_space.gather import cut_sigma
from skinbake.diffuse.surface_space.points import TexelPoints, extended_points, texel_points
from skinbake.diffuse.surface_space.sources import SourceTree
from skinbake.diffuse.surface_space.surface_light import SurfaceLight, lobe_sources, sums_texels, surface_light
from skinbake.diffuse.surface_space.upsample import least_sigma, widest_gap
from skinbake.diffuse.texture_space.blur import (
    TexturePyramid,
    level_margin,
    level_size,
    mean_mm_per_texel,
    texture_pyramids,
)
from skinbake.diffuse.texture_space.blur_error import BlurErrorPredictor
from skinbake.diffuse.texture_space.stretch import chart_of_face, smooth_inverse_metric, uv_vertices
from skinbake.diffuse.texture_space.uv_gaps import distance_to_foreign
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

LARGE_SHARE = 0.5  # of the texels: sources that are more than this are not kept for later
_WORTH = 1.5  # mean texels of half the size in the widest gap, from which on interpolation is sooner done than sums
LEVEL_GUTTER = 3  # texels around the charts of a smaller stored size: bilinear reading needs one


class LobeResources:
    """Whatever two lobes share is made once, when it is first asked for; what is large can be let go.

    Parameters
    ----------
    source : sequence of ndarray of shape (L, H, W, 3), float32
        In the order of the atlas.
    """

    def __init__(
        self, source: Sequence[NDArray[np.float32]], atlas: Atlas, mesh: SkinMesh, spec: DiffusionSpec
    ) -> None:
        self.source, self.atlas, self.mesh, self.spec = list(source), atlas, mesh, spec
        self.size = atlas[0].shape
        self.lights = self.source[0].shape[0]
        self.cut = cut_sigma(spec.tolerance, spec.normalise)  # of surface sums, in sigma
        self._atlases: dict[int, Atlas] = {}
        self._targets: dict[int, list[TexelPoints]] = {}
        self._smooth: dict[int, list[NDArray[np.float32]]] = {}
        self._sources: dict[tuple[float, float], SourceTree] = {}

    @cached_property
    def surface(self) -> SurfaceLight:
        """Light as clusters."""
        return surface_light(self.source, self.atlas, self.mesh)

    @cached_property
    def pyramids(self) -> list[TexturePyramid]:
        """Light as premultiplied images."""
        return texture_pyramids(self.source, self.atlas)

    @cached_property
    def mm_per_texel(self) -> tuple[float, float]:
        """The one texel size of the texture method, (row, column)."""
        return mean_mm_per_texel(self.mesh, self.size)

    def variance_texels2(self, variance_mm2: float) -> tuple[float, float]:
        """A variance in texels of the full size, along rows and columns."""
        return variance_mm2 / self.mm_per_texel[0] ** 2, variance_mm2 / self.mm_per_texel[1] ** 2

    def targets(self, level: int) -> list[TexelPoints]:
        """Skin points of each tile's texels at a stored size, continued beyond the charts' borders."""
        if level not in self._targets:
            atlas, centre = self.level_atlas(level), self.surface.centre_mm
            own = (
                [p for p, _, _ in self.surface.tiles]
                if level == 0
                else [texel_points(r, self.mesh, centre) for r in atlas]
            )
            self._targets[level] = [extended_points(p, r, self.mesh, centre) for p, r in zip(own, atlas, strict=True)]
        return self._targets[level]

    def sources(self, variance_mm2: float, spacing: float) -> SourceTree:
        """Clusters of one lobe. Those of wide lobes are few and kept; of narrow ones only the last."""
        key = (variance_mm2, spacing)
        if key not in self._sources:
            texels = sum(len(points.flat_index) for points, _, _ in self.surface.tiles)
            for other in [k for k, tree in self._sources.items() if tree.count > LARGE_SHARE * texels]:
                del self._sources[other]
            self._sources[key] = lobe_sources(self.surface, variance_mm2, spacing)
        return self._sources[key]

    def forget(self, variance_mm2: float) -> None:
        """Let one lobe's clusters go."""
        self._sources = {key: tree for key, tree in self._sources.items() if key[0] != variance_mm2}

    def sums_texels(self, method: str, variance_mm2: float, spacing: float) -> bool:
        """Whether a lobe is summed over single texels."""
        return method in ("surface", "hybrid") and sums_texels(self.surface, variance_mm2, spacing)

    def drop_texels(self) -> None:
        """Let the single texels go; they are larger than a lobe."""
        texels = self.surface.__dict__.pop("texels", None)
        self._sources = {key: tree for key, tree in self._sources.items() if tree is not texels}

    def drop_pyramids(self) -> None:
        """Let the premultiplied images go."""
        self.__dict__.pop("pyramids", None)

    @cached_property
    def mean_light(self) -> list[float]:
        """Mean of each light over the skin and its three channels."""
        total, area = np.zeros(3 * self.lights), 0.0
        for _, _, pyramid in self.surface.tiles:
            blocks = slice(pyramid.start[-1], None)
            weight = pyramid.moments[blocks, 0].astype(np.float64)
            total, area = total + weight @ pyramid.radiosity[blocks].astype(np.float64), area + weight.sum()
        return [float(mean) for mean in (total / max(area, 1e-30)).reshape(self.lights, 3).mean(axis=1)]

    def level_atlas(self, level: int) -> Atlas:
        """The mesh rasterised at a stored size."""
        if level == 0:
            return self.atlas
        if level not in self._atlases:
            height, width = level_size(self.size, level)
            udim = len(self.atlas) > 1 or self.atlas[0].tile != FIRST_TILE
            again = {r.tile: r for r in rasterize(self.mesh, (width, height), LEVEL_GUTTER, udim)}
            self._atlases[level] = tuple(again[r.tile] for r in self.atlas)
        return self._atlases[level]

    def predictor(self, tile: int, level: int) -> BlurErrorPredictor:
        """Of where a tile's blur at a stored size is wrong."""
        return BlurErrorPredictor(
            points=self.targets(level)[tile],
            coverage=self.level_atlas(level)[tile].coverage,
            image=self.pyramids[tile].level(level),
            margin=level_margin(level),
            level=level,
            pyramid=self.surface.tiles[tile][2],
            bend=self._bend[tile],
            foreign_mm=self._foreign_mm[tile],
            mean_texel_mm2=(min(self.mm_per_texel) ** 2 * 4**level, max(self.mm_per_texel) ** 2 * 4**level),
            mean=self.mean_light,
        )

    @cached_property
    def _bend(self) -> list[NDArray[np.float32]]:
        return [bending(pyramid) for _, _, pyramid in self.surface.tiles]

    @cached_property
    def _foreign_mm(self) -> list[NDArray[np.float32]]:
        return distance_to_foreign([pyramid for _, _, pyramid in self.surface.tiles])

    @cached_property
    def metric(self) -> tuple[Float, NDArray[np.int32]]:
        """Inverse metric of the skin in UV, smooth over edges, and the chart of each face."""
        corner = uv_vertices(self.mesh)
        return smooth_inverse_metric(self.mesh, corner), chart_of_face(corner)

    def interpolates(self, variance_mm2: float, level: int) -> bool:
        """Whether a surface lobe of a stored size is interpolated from half that size, where that is smooth enough."""
        height, width = level_size(self.size, level)
        next_texel = np.sqrt(self.surface.mean_texel_mm2) * 2 ** (level + 1)
        near = _WORTH * next_texel < widest_gap(self.spec.tolerance) * np.sqrt(variance_mm2)
        return bool(self.spec.normalise and height % 2 == 0 and width % 2 == 0 and near)

    def least_sigma(self, level: int) -> list[NDArray[np.float32]]:
        """Which lobes may be interpolated from half this size, texel by texel; all lobes share it."""
        if level not in self._smooth:
            gap = widest_gap(self.spec.tolerance)
            pairs = zip(self.targets(level + 1), self.targets(level), strict=True)
            self._smooth[level] = [least_sigma(coarse, fine, gap) for coarse, fine in pairs]
        return self._smooth[level]
