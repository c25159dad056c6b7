"""Method `stretch`: texture space with each texel's own metric (`texture_space.stretch`)."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import Tiles
from skinbake.bilinear import read_variance_texels2
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.texture_space.stretch import area_mean, stretch_blur, texel_covariance


class Stretch(DiffusionMethod):
    """Gathers with an ellipse of its own at each texel, inside each chart."""

    name = "stretch"
    bilinear_error = 0.004  # smooth in UV
    continuous = False
    advice = "set diffusion.method to auto or surface"

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The blur at each texel, of means over blocks of the full size where the lobe is stored smaller."""
        geometry, level = resources.geometry, lobe.level
        inverse_metric, chart_of = geometry.metric
        tiles = {}
        for full, raster in zip(geometry.atlas, geometry.level_atlas(level), strict=True):
            light, box_variance, area = resources.source[raster.tile], 0.0, raster.area_mm2
            share = resources.share[raster.tile] if resources.share is not None else None
            if share is not None and level == 0:
                area = area * share
            if level > 0:
                means = np.empty((resources.lights, *raster.shape, 3), np.float32)
                area_mean(light, full.area_mm2 if share is None else full.area_mm2 * share, 1 << level, means)
                light = means
                if share is not None:
                    mean_share = np.empty((1, *raster.shape, 3), np.float32)
                    area_mean(np.repeat(share[None, ..., None], 3, axis=3), full.area_mm2, 1 << level, mean_share)
                    area = area * mean_share[0, ..., 0]
                box_variance = (1 - 0.25**level) / 12  # of the mean over a block, in texels of this level
            covariance = texel_covariance(raster, inverse_metric) * np.float32(lobe.variance_mm2)
            covariance -= np.array([box_variance, 0, box_variance], np.float32)
            # What reading adds, but no more than half of what there is
            along = covariance[..., ::2]
            along -= np.minimum(read_variance_texels2(level), 0.5 * np.maximum(along, 0))
            chart = np.where(raster.addressed, chart_of[raster.face_index], -1).astype(np.int32)
            tiles[raster.tile] = stretch_blur(light, area, chart, covariance)
        return tiles

    def coarsest_level(self, size: tuple[int, int], level: int) -> int:
        """Its blocks are whole texels."""
        while level and (size[0] % (1 << level) or size[1] % (1 << level)):
            level -= 1
        return level
