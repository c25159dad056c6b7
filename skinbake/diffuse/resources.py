"""What the lobes of some lights share: the light, its pyramids, the sources of sums, and the geometry of the skin."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled, Tiles
from skinbake.bilinear import read_variance_texels2
from skinbake.diffuse.aside import IN_MEMORY, Aside
from skinbake.diffuse.on_demand import OnDemand
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.shared_skin import SharedSkin
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.surface_space.clusters import bending
from skinbake.diffuse.surface_space.gather import SumRule, cut_sigma
from skinbake.diffuse.surface_space.oblong import oblong_gain
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.surface_space.sources import SourceTree, source_tree
from skinbake.diffuse.surface_space.surface_light import LitTile, sums_texels
from skinbake.diffuse.surface_space.upsample import widest_gap
from skinbake.diffuse.texture_space.blur import TexturePyramid, level_margin, level_size, texture_pyramids
from skinbake.diffuse.texture_space.blur_error import BlurErrorPredictor
from skinbake.numerics import Float, Zeros
from skinbake.scene.spec import DiffusionSpec

LARGE_SHARE = 0.5  # of the texels: sources that are more than this are not kept for later
_WORTH = 1.5  # mean texels of half the size in the widest gap, from which on interpolation is sooner done than sums


class Resource(Enum):
    """What is larger than a lobe, and is released as soon as no lobe needs it."""

    TEXELS = "every texel as a source of sums"
    PYRAMIDS = "light as premultiplied images"


class LobeResources:
    """Whatever two lobes share is made once, when it is first asked for.

    Parameters
    ----------
    source : Tiles
        Light that arrives, (L, H, W, 3) a tile, in the order of the atlas.
    geometry : SkinGeometry
    spec : DiffusionSpec
    share : Tiles, optional
        Share of each texel's light that scatters, (H, W) a tile: its weight as a source, theory.md 5.12.
    aside : Aside, optional
        Where they stand while they are not read.
    skin : SharedSkin, optional
        What resources of other lights on the same skin have made that no light changes.
    """

    def __init__(
        self,
        source: Tiles,
        geometry: SkinGeometry,
        spec: DiffusionSpec,
        share: Tiles | None = None,
        aside: Aside = IN_MEMORY,
        skin: SharedSkin | None = None,
    ) -> None:
        self.share, self._aside, self._skin = share, aside, skin or SharedSkin(aside)
        self.source, self.geometry, self.spec = source, geometry, spec
        self.lights = len(next(iter(source.values())))
        self.rule = SumRule(cut_sigma(spec.tolerance, spec.normalise), spec.separate, spec.normalise)
        self.pyramids = OnDemand(self._pyramids)
        self._clusters: dict[tuple[float, float], SourceTree] = {}

    def of_lights(self, chosen: Sequence[int]) -> LobeResources:
        """Resources of some of the lights, about the same geometry."""
        return self.with_light({tile: rgb[chosen] for tile, rgb in self.source.items()})

    def with_light(self, source: Tiles) -> LobeResources:
        """Resources of another light, (L, H, W, 3) a tile, about the same geometry."""
        return LobeResources(source, self.geometry, self.spec, self.share, self._aside, self._skin)

    @property
    def zeros(self) -> Zeros:
        """Makes large arrays where they are put aside."""
        return self._aside.zeros

    def rest(self) -> None:
        """Free the memory of what was read so far, where it is put aside: another step reads other parts."""
        self._aside.rest()

    def release(self, unneeded: Collection[Resource]) -> None:
        """Free the memory of some resources; they are made again if they are asked for after all."""
        if Resource.TEXELS in unneeded:
            self._skin.release_texels()
        if Resource.PYRAMIDS in unneeded:
            self.pyramids.release()

    def release_lobe(self, variance_mm2: float) -> None:
        """Free the clusters of one lobe."""
        self._clusters = {key: tree for key, tree in self._clusters.items() if key[0] != variance_mm2}

    def texels(self) -> SourceTree:
        """Every texel as a source, until resources of other light on this skin ask for theirs."""
        return self._skin.texels(self, self.lit)

    def _pyramids(self) -> Tiled[TexturePyramid]:
        return texture_pyramids(self.source, self._coverage, self._aside.zeros)

    @cached_property
    def lit(self) -> Tiled[LitTile]:
        """Skin points, light and moments of each tile."""
        points = self.geometry.points
        if self.share is not None:
            points = {tile: each._replace(area_mm2=self._weighed(tile, each)) for tile, each in points.items()}
        return self._skin.lit(self.source, points)

    def _weighed(self, tile: int, points: TexelPoints) -> NDArray[np.float32]:
        """Areas of a tile's points, times the share that scatters."""
        assert self.share is not None
        return points.area_mm2 * self.share[tile].reshape(-1)[points.flat_index]

    @property
    def _coverage(self) -> Tiles:
        """Coverage of each texel, times the share that scatters, (H, W) a tile."""
        share = self.share or {}
        one = np.ones((1, 1), np.float32)
        return {raster.tile: raster.coverage * share.get(raster.tile, one) for raster in self.geometry.atlas}

    @cached_property
    def mean_light(self) -> list[float]:
        """Mean of each light over the skin and its three channels."""
        total, area = np.zeros(3 * self.lights), 0.0
        for _, _, pyramid in self.lit.values():
            blocks = slice(pyramid.start[-1], None)
            weight = pyramid.moments[blocks, 0].astype(np.float64)
            # Not by BLAS, whose threads would divide the sum
            total += (weight[:, None] * pyramid.radiosity[blocks]).sum(axis=0)
            area += weight.sum()
        return [float(mean) for mean in (total / max(area, 1e-30)).reshape(self.lights, 3).mean(axis=1)]

    def sums_texels(self, variance_mm2: float, spacing: float) -> bool:
        """Whether surface sums of a lobe take single texels as their sources."""
        return sums_texels(variance_mm2, spacing, self.geometry.mean_texel_mm2)

    def sources(self, variance_mm2: float, spacing: float) -> SourceTree:
        """Sources of one lobe's surface sums. Clusters of wide lobes are few and kept; of narrow ones only the last.

        `spacing` is the side of the widest cluster in sigma.
        """
        if self.sums_texels(variance_mm2, spacing):
            return self.texels()
        key = (variance_mm2, spacing)
        if key not in self._clusters:
            texels = sum(len(points.flat_index) for points in self.geometry.points.values())
            for other in [k for k, tree in self._clusters.items() if tree.count > LARGE_SHARE * texels]:
                del self._clusters[other]
            spread_mm2 = spacing**2 / 12 * variance_mm2
            tree = source_tree(self.lit, spread_mm2, variance_mm2, self._aside.zeros)
            self._clusters[key] = replace(tree, walked=())  # they get no other light
            self.rest()  # what it was made of
        return self._clusters[key]

    def interpolates(self, variance_mm2: float, level: int) -> bool:
        """Whether a surface lobe of a stored size is interpolated from half that size, where that is smooth enough."""
        height, width = level_size(self.geometry.size, level)
        next_texel = np.sqrt(self.geometry.mean_texel_mm2) * 2 ** (level + 1)
        near = _WORTH * next_texel < widest_gap(self.spec.tolerance) * np.sqrt(variance_mm2)
        return bool(self.spec.normalise and height % 2 == 0 and width % 2 == 0 and near)

    def read_texels2(self, level: int) -> float:
        """By how much reading a stored size spreads light, in squares of its texels' shorter side (`TexelPoints`)."""
        shorter, longer = sorted(self.geometry.mm_per_texel)
        return read_variance_texels2(level) * 0.5 * (1 + (longer / shorter) ** 2) if shorter > 0 else 0.0

    def gain_of_texels(self, variance_mm2: float, level: int) -> Tiles | None:
        """What classical sums at the targets of a stored size are multiplied by, (h, w) a tile; None for no change."""
        of_face = self._gain_of_faces(variance_mm2)
        if of_face is None:
            return None
        # Where a raster is empty its face is -1, and nothing is summed
        narrow = of_face.astype(np.float32)
        return {raster.tile: narrow[raster.face_index] for raster in self.geometry.level_atlas(level)}

    def gain_at_probes(self, variance_mm2: float, probes: Probes) -> Float:
        """The same at probes, (P, 1); 1 where their texel shows no skin."""
        gain = np.ones((len(probes), 1))
        of_face = self._gain_of_faces(variance_mm2)
        if of_face is None:
            return gain
        size = np.array(self.geometry.size)
        texel = np.clip((probes.place * size).astype(np.int64), 0, size - 1)
        for raster in self.geometry.atlas:
            mine = np.flatnonzero(probes.tile == raster.tile)
            face = raster.face_index[texel[mine, 0], texel[mine, 1]]
            gain[mine, 0] = np.where(face >= 0, of_face[face], 1)
        return gain

    def _gain_of_faces(self, variance_mm2: float) -> Float | None:
        if self.rule.normalise or not variance_mm2 > 0:
            return None
        return oblong_gain(self.geometry.mesh, self.geometry.size, variance_mm2)

    def least_sigma(self, level: int) -> Tiles:
        """Narrowest lobe, in mm, that may be interpolated at each texel of a level from the next smaller size."""
        return self.geometry.least_sigma(level, widest_gap(self.spec.tolerance))

    def unreached(self, tile: int, level: int) -> NDArray[np.float32]:
        """What stands where surface sums find no skin, (L, h, w, 3).

        At the full size a texel that its lobe is too narrow for, or that lies too far beside its chart, keeps its
        light.
        """
        if level == 0:
            image = self.zeros(self.source[tile].shape, np.float32)
            image[...] = self.source[tile]
            return image
        return self.zeros((self.lights, *self.geometry.targets(level)[tile].row.shape, 3), np.float32)

    def predictor(self, tile: int, level: int) -> BlurErrorPredictor:
        """Predicts where a tile's blur at a stored size is wrong."""
        row_mm, col_mm = self.geometry.mm_per_texel
        raster = next(r for r in self.geometry.level_atlas(level) if r.tile == tile)
        return BlurErrorPredictor(
            points=self.geometry.targets(level)[tile],
            coverage=raster.coverage,
            image=self.pyramids.get()[tile].level(level),
            margin=level_margin(level),
            level=level,
            pyramid=self.lit[tile].pyramid,
            bend=self._bend[tile],
            foreign_mm=self._skin.foreign_mm(self.lit)[tile],
            mean_texel_mm2=(min(row_mm, col_mm) ** 2 * 4**level, max(row_mm, col_mm) ** 2 * 4**level),
            mean=self.mean_light,
        )

    @cached_property
    def _bend(self) -> Tiled[NDArray[np.float32]]:
        return {tile: bending(lit.pyramid, self._aside.zeros) for tile, lit in self.lit.items()}
