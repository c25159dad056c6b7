"""Methods by name: a lobe as a map of some size, or at probes only, as the method gives it or as it will be read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.probes import Probes, bilinear_texels, read_bilinear
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.surface_space.gather import gather
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.surface_space.reference_integral import reference_integral
from skinbake.diffuse.surface_space.upsample import interpolate_smooth
from skinbake.diffuse.texture_space.blur import blur_at, level_size, texture_at, texture_blur
from skinbake.diffuse.texture_space.stretch import area_mean, stretch_blur, texel_covariance
from skinbake.numerics import Float

Tiles = list[NDArray[np.float32]]


class LobeEvaluator(LobeResources):
    """Lobes of one light, or of several that go along with one another."""

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
                share[mine] = self.predictor(k, level).shares_of_texels(variance_mm2, threshold, flat, *texels)
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
            share = self.predictor(k, level).shares_of_texels(variance_mm2, threshold, flat.reshape(-1), values, mass)
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
            predictor = self.predictor(k, level)
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

    def _hybrid_map(self, variance_mm2: float, level: int, spacing: float, threshold: float) -> Tiles:
        """One lobe: the texture's blur, then sums where it is predicted to be wrong, light by light."""
        sources, texels2 = self.sources(variance_mm2, spacing), self.variance_texels2(variance_mm2)
        tiles = []
        for k, (pyramid, points) in enumerate(zip(self.pyramids, self.targets(level), strict=True)):
            mass = np.empty(points.row.shape, np.float32)
            image = texture_blur(pyramid, texels2, level, self.source[k] if level == 0 else None, mass)
            share = self.predictor(k, level).share_of_sums(variance_mm2, threshold, image, mass)
            for i in range(self.lights):
                gather(
                    points, sources, variance_mm2, self.cut, self.spec.separate, self.spec.normalise,
                    image[i].reshape(1, -1, 3), i, share[i],
                )  # fmt: skip
            tiles.append(image)
        return tiles

    def _stretch_map(self, variance_mm2: float, level: int) -> Tiles:
        inverse_metric, chart_of = self.metric
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

    def _surface_map(self, variance_mm2: float, level: int, spacing: float) -> Tiles:
        """One lobe: interpolated from half the size where that is smooth enough, else summed."""
        sources = self.sources(variance_mm2, spacing)
        halve = self.interpolates(variance_mm2, level)
        coarse = self._surface_map(variance_mm2, level + 1, spacing) if halve else None
        tiles = []
        for k, points in enumerate(self.targets(level)):
            image = self._unreached(k, level)
            if coarse is not None:
                sigma = float(np.sqrt(variance_mm2))
                points = replace(
                    points, row=interpolate_smooth(coarse[k], points.row, self.least_sigma(level)[k], sigma, image)
                )
            flat = image.reshape(self.lights, -1, 3)
            gather(points, sources, variance_mm2, self.cut, self.spec.separate, self.spec.normalise, flat)
            tiles.append(image)
        return tiles

    def _unreached(self, tile: int, level: int) -> NDArray[np.float32]:
        """What stands where sums find no skin: at the full size a texel that its lobe is too narrow for, or too far
        beside its chart, keeps its light.
        """
        if level == 0:
            return self.source[tile].copy()
        return np.zeros((self.lights, *self.targets(level)[tile].row.shape, 3), np.float32)

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
        for k, points in enumerate(self.targets(level)):
            image = self._unreached(k, level)
            found = self._integral(variance_mm2, points.position, points.normal, points.texel_mm2)
            reached = np.flatnonzero(found.any(axis=1))
            values = found[reached].reshape(len(reached), self.lights, 3).transpose(1, 0, 2)
            image.reshape(self.lights, -1, 3)[:, points.flat_index[reached]] = values
            tiles.append(image)
        return tiles
