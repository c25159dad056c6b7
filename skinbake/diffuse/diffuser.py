"""Everything the methods share for one bake: the light, its pyramids, and the skin points at each stored size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, Atlas, rasterize
from skinbake.diffuse.clusters import bending
from skinbake.diffuse.foreign import distance_to_foreign
from skinbake.diffuse.gather import cut_sigma, gather
from skinbake.diffuse.hybrid import Predictor
from skinbake.diffuse.points import TexelPoints, copy_gutter, extended_points, texel_points
from skinbake.diffuse.probes import Probes, bilinear_texels, read_bilinear
from skinbake.diffuse.reference import reference_integral
from skinbake.diffuse.sources import SourceTree
from skinbake.diffuse.stretch import (
    area_mean,
    chart_of_face,
    smooth_inverse_metric,
    stretch_blur,
    texel_covariance,
    uv_vertices,
)
from skinbake.diffuse.surface import SurfaceLight, lobe_sources, sums_texels, surface_light
from skinbake.diffuse.texture import (
    TexturePyramid,
    blur_at,
    level_margin,
    level_size,
    mean_mm_per_texel,
    texture_at,
    texture_blur,
    texture_pyramids,
)
from skinbake.diffuse.upsample import interpolate_smooth, least_sigma, widest_gap
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

LARGE_SHARE = 0.5  # of the texels: sources that are more than this are not kept for later
_WORTH = 1.5  # mean texels of half the size in the widest gap, from which on interpolation is sooner done than sums
LEVEL_GUTTER = 3  # texels around the charts of a smaller stored size: bilinear reading needs one
Tiles = list[NDArray[np.float32]]


class Diffuser:
    """Methods by name on one light; whatever two lobes share is made once.

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

    def map(self, method: str, variance_mm2: float, level: int, spacing: float, threshold: float = 0.0) -> Tiles:
        """One lobe at a stored size, (L, h, w, 3) a tile; `LobePlan` tells what the arguments are."""
        if method == "identity":
            return list(self.source)
        if method == "texture":
            t = self.variance_texels2(variance_mm2)
            return [
                texture_blur(p, t, level, s if level == 0 else None)
                for p, s in zip(self.pyramids, self.source, strict=True)
            ]
        if method == "stretch":
            return self._stretch_map(variance_mm2, level)
        if method == "hybrid":
            return self._hybrid_map(variance_mm2, level, spacing, threshold)
        if method == "surface":
            return self._surface_map(variance_mm2, level, spacing)
        if method == "reference":
            return self._reference_map(variance_mm2, level)
        raise ValueError(f"method: expected identity, texture, stretch, hybrid, surface or reference, got {method}")

    def at(
        self, method: str, variance_mm2: float, level: int, spacing: float, probes: Probes, threshold: float = 0.0
    ) -> Float:
        """The same lobe at probe points as the method gives it before any storage, (P, 3 L)."""
        if method == "identity":
            return self.at_texel(probes)
        if method == "texture":
            return texture_at(self.pyramids, self.variance_texels2(variance_mm2), level, probes)
        if method == "stretch":
            return self.read(self.map(method, variance_mm2, level, spacing), probes, half=False)
        if method == "hybrid":
            blurred = texture_at(self.pyramids, self.variance_texels2(variance_mm2), level, probes)
            share = np.zeros((len(probes), self.lights), np.float32)
            for k in range(len(self.atlas)):
                mine = np.flatnonzero(probes.tile == k)
                flat = self._texel_of(probes, mine, level)
                texels = self._blurred(k, variance_mm2, level, flat)
                share[mine] = self._predictor(k, level).shares_of_texels(variance_mm2, threshold, flat, *texels)
            sums = self._surface_points(variance_mm2, spacing, probes.position, probes.normal, probes.texel_mm2)
            return blurred + np.repeat(share, 3, axis=1) * (sums - blurred)
        if method == "surface":
            return self._surface_points(variance_mm2, spacing, probes.position, probes.normal, probes.texel_mm2)
        return self.reference(variance_mm2, probes)

    def at_texel(self, probes: Probes) -> Float:
        """The light that arrives at the probes, (P, 3 L)."""
        out = np.zeros((len(probes), 3 * self.lights))
        for k, source in enumerate(self.source):
            mine = probes.tile == k
            values = source.reshape(self.lights, -1, 3)[:, probes.flat_index[mine]]
            out[mine] = values.transpose(1, 0, 2).reshape(-1, 3 * self.lights)
        return out

    def read_surface(self, variance_mm2: float, level: int, spacing: float, probes: Probes) -> Float:
        """What reading a stored `surface` lobe will give at the probes, from the four texels around each only."""
        out = np.zeros((len(probes), 3 * self.lights))
        for k, points in enumerate(self.targets(level)):
            mine = np.flatnonzero(probes.tile == k)
            flat, weight = bilinear_texels(probes.place[mine], *points.row.shape)
            # Texel by texel of each probe in turn, so that the four share a batch; those without weight are left out
            row = points.row.reshape(-1)[flat.reshape(-1)]
            needed = np.flatnonzero((weight.reshape(-1) > 1e-6) & (row >= 0))
            values = np.zeros((flat.size, out.shape[1]))
            values[needed] = self._texel_sums(variance_mm2, spacing, points, row[needed])
            out[mine] = np.einsum("pkc,pk->pc", values.reshape(*flat.shape, -1), weight)
        return out

    def read_hybrid(self, variance_mm2: float, level: int, spacing: float, threshold: float, probes: Probes) -> Float:
        """What reading a stored `hybrid` lobe will give at the probes."""
        out = np.zeros((len(probes), 3 * self.lights))
        for k, points in enumerate(self.targets(level)):
            mine = np.flatnonzero(probes.tile == k)
            flat, weight = bilinear_texels(probes.place[mine], *points.row.shape)
            values, mass = self._blurred(k, variance_mm2, level, flat.reshape(-1))
            share = self._predictor(k, level).shares_of_texels(variance_mm2, threshold, flat.reshape(-1), values, mass)
            needed = np.flatnonzero((weight.reshape(-1) > 1e-6) & share.any(axis=1))
            sums = self._texel_sums(variance_mm2, spacing, points, points.row.reshape(-1)[flat.reshape(-1)[needed]])
            values[needed] += np.repeat(share[needed], 3, axis=1) * (sums - values[needed])
            out[mine] = np.einsum("pkc,pk->pc", values.reshape(*flat.shape, -1), weight)
        return out

    def hybrid_blur(
        self, variance_mm2: float, level: int, thresholds: Sequence[float], probes: Probes
    ) -> tuple[Float, list[Float]]:
        """Of stored `hybrid` lobes: what the blur alone gives, (P, 3 L); by threshold, how much sums count, (P, L)."""
        texture = np.zeros((len(probes), 3 * self.lights))
        shares = [np.zeros((len(probes), self.lights)) for _ in thresholds]
        for k, points in enumerate(self.targets(level)):
            mine = np.flatnonzero(probes.tile == k)
            flat, weight = bilinear_texels(probes.place[mine], *points.row.shape)
            values, mass = self._blurred(k, variance_mm2, level, flat.reshape(-1))
            texture[mine] = np.einsum("pkc,pk->pc", values.reshape(*flat.shape, -1), weight)
            predictor = self._predictor(k, level)
            for share, threshold in zip(shares, thresholds, strict=True):
                each = predictor.shares_of_texels(variance_mm2, threshold, flat.reshape(-1), values, mass)
                share[mine] = np.einsum("pkl,pk->pl", each.reshape(*flat.shape, -1), weight)
        return texture, shares

    def read(self, tiles: Tiles, probes: Probes, half: bool) -> Float:
        """A stored lobe read bilinearly at the probes, (P, 3 L)."""
        out = np.zeros((len(probes), 3 * self.lights))
        for k, image in enumerate(tiles):
            mine = probes.tile == k
            out[mine] = read_bilinear(image, probes.place[mine], half)
        return out

    def reference(self, variance_mm2: float, probes: Probes) -> Float:
        """The exact integral at the probes, (P, 3 L)."""
        if variance_mm2 == 0:
            return self.at_texel(probes)
        return self._integral(variance_mm2, probes.position, probes.normal, probes.texel_mm2)

    def _integral(
        self,
        variance_mm2: float,
        position: NDArray[np.float32],
        normal: NDArray[np.float32],
        texel: NDArray[np.float32],
    ) -> Float:
        return reference_integral(
            self.surface.texels, position, normal, texel, variance_mm2, self.spec.separate, self.spec.normalise
        )

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

    def _texel_of(self, probes: Probes, mine: NDArray[np.int64], level: int) -> NDArray[np.int64]:
        """The texel of a stored size that shows the middle of each probe's texel."""
        height, width = level_size(self.size, level)
        row, col = np.divmod(probes.flat_index[mine], self.size[1])
        row, col = (2 * row + 1) * height // (2 * self.size[0]), (2 * col + 1) * width // (2 * self.size[1])
        flat: NDArray[np.int64] = row * width + col
        return flat

    def _blurred(self, tile: int, variance_mm2: float, level: int, flat: NDArray[np.int64]) -> tuple[Float, Float]:
        """`blur_at` a few texels of a stored size."""
        row, col = np.divmod(flat, level_size(self.size, level)[1])
        at = row.astype(np.float64), col.astype(np.float64)
        return blur_at(self.pyramids[tile], self.variance_texels2(variance_mm2), level, at)

    def _predictor(self, tile: int, level: int) -> Predictor:
        """Of where a tile's blur at a stored size is wrong."""
        return Predictor(
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

    def _hybrid_map(self, variance_mm2: float, level: int, spacing: float, threshold: float) -> Tiles:
        """One lobe: the texture's blur, then sums where it is predicted to be wrong, light by light."""
        sources, texels2 = self.sources(variance_mm2, spacing), self.variance_texels2(variance_mm2)
        tiles = []
        for k, (pyramid, points) in enumerate(zip(self.pyramids, self.targets(level), strict=True)):
            mass = np.empty(points.row.shape, np.float32)
            image = texture_blur(pyramid, texels2, level, self.source[k] if level == 0 else None, mass)
            share = self._predictor(k, level).share_of_sums(variance_mm2, threshold, image, mass)
            for i in range(self.lights):
                gather(
                    points, sources, variance_mm2, self.cut, self.spec.separate, self.spec.normalise,
                    image[i].reshape(1, -1, 3), i, share[i],
                )  # fmt: skip
            tiles.append(image)
        return tiles

    @cached_property
    def _metric(self) -> tuple[Float, NDArray[np.int32]]:
        corner = uv_vertices(self.mesh)
        return smooth_inverse_metric(self.mesh, corner), chart_of_face(corner)

    def _stretch_map(self, variance_mm2: float, level: int) -> Tiles:
        inverse_metric, chart_of = self._metric
        tiles = []
        for k, raster in enumerate(self.level_atlas(level)):
            light, box_variance = self.source[k], 0.0
            if level > 0:
                light = np.empty((self.lights, *raster.shape, 3), np.float32)
                area_mean(self.source[k], self.atlas[k].area_mm2, 1 << level, light)
                box_variance = (1 - 0.25**level) / 12  # of the mean over a block, in texels of this level
            covariance = texel_covariance(raster, inverse_metric) * np.float32(variance_mm2)
            covariance -= np.array([box_variance, 0, box_variance], np.float32)
            chart = np.where(raster.addressed, chart_of[raster.face_index], -1).astype(np.int32)
            tiles.append(stretch_blur(light, raster.area_mm2, chart, covariance))
        return tiles

    def interpolates(self, variance_mm2: float, level: int) -> bool:
        """Whether a surface lobe of a stored size is interpolated from half that size, where that is smooth enough."""
        height, width = level_size(self.size, level)
        next_texel = np.sqrt(self.surface.mean_texel_mm2) * 2 ** (level + 1)
        near = _WORTH * next_texel < widest_gap(self.spec.tolerance) * np.sqrt(variance_mm2)
        return bool(self.spec.normalise and height % 2 == 0 and width % 2 == 0 and near)

    def _surface_map(self, variance_mm2: float, level: int, spacing: float) -> Tiles:
        """One lobe: interpolated from half the size where that is smooth enough, else summed."""
        sources = self.sources(variance_mm2, spacing)
        halve = self.interpolates(variance_mm2, level)
        coarse = self._surface_map(variance_mm2, level + 1, spacing) if halve else None
        tiles = []
        for k, points in enumerate(self.targets(level)):
            image = np.zeros((self.lights, *points.row.shape, 3), np.float32)
            if level == 0:  # what lies too far beside its chart to be reached keeps its light
                copy_gutter(points, self.source[k].reshape(self.lights, -1, 3), image.reshape(self.lights, -1, 3))
            if coarse is not None:
                sigma = float(np.sqrt(variance_mm2))
                points = replace(
                    points, row=interpolate_smooth(coarse[k], points.row, self._least_sigma(level)[k], sigma, image)
                )
            flat = image.reshape(self.lights, -1, 3)
            gather(points, sources, variance_mm2, self.cut, self.spec.separate, self.spec.normalise, flat)
            tiles.append(image)
        return tiles

    def _least_sigma(self, level: int) -> list[NDArray[np.float32]]:
        """Which lobes may be interpolated from half this size, texel by texel; all lobes share it."""
        if level not in self._smooth:
            gap = widest_gap(self.spec.tolerance)
            pairs = zip(self.targets(level + 1), self.targets(level), strict=True)
            self._smooth[level] = [least_sigma(coarse, fine, gap) for coarse, fine in pairs]
        return self._smooth[level]

    def _texel_sums(self, variance_mm2: float, spacing: float, points: TexelPoints, row: NDArray[np.int32]) -> Float:
        """Surface sums at some rows of a size's points, (P, 3 L)."""
        return self._surface_points(
            variance_mm2, spacing, points.position[row], points.normal[row], points.texel_mm2[row]
        )

    def _surface_points(
        self,
        variance_mm2: float,
        spacing: float,
        position: NDArray[np.float32],
        normal: NDArray[np.float32],
        texel: NDArray[np.float32],
    ) -> Float:
        count = np.arange(len(position), dtype=np.int32)
        points = TexelPoints(count[:, None], count, position, normal, np.zeros(len(count), np.float32), texel)
        out = np.zeros((self.lights, len(position), 3), np.float32)
        sources = self.sources(variance_mm2, spacing)
        gather(points, sources, variance_mm2, self.cut, self.spec.separate, self.spec.normalise, out)
        return out.transpose(1, 0, 2).reshape(len(position), 3 * self.lights).astype(np.float64)

    def _reference_map(self, variance_mm2: float, level: int) -> Tiles:
        tiles = []
        for points in self.targets(level):
            flat = np.zeros((self.lights, points.row.size, 3), np.float32)
            found = self._integral(variance_mm2, points.position, points.normal, points.texel_mm2)
            flat[:, points.flat_index] = found.reshape(len(found), self.lights, 3).transpose(1, 0, 2)
            tiles.append(flat.reshape(self.lights, *points.row.shape, 3))
        return tiles
