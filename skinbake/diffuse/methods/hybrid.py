"""Method `hybrid`: the texture's blur where it is right, surface sums where it is not.

Where it is wrong is predicted texel by texel and light by light (`texture_space.blur_error`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skinbake.atlas import Tiles
from skinbake.diffuse.methods.costs import blur_cost, predict_cost, sources_cost, sum_cost, sums_cost, texels
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters, Proposal, Trial
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.surface_space.gather import gather
from skinbake.diffuse.surface_space.surface_sums import surface_sums
from skinbake.diffuse.texture_space.blur import texture_blur
from skinbake.diffuse.texture_space.blur_at_probes import (
    blur_around_probes,
    blur_at_probes,
    blur_of_texels,
    read_blur,
    shown_texels,
)
from skinbake.numerics import Float

LOOSE = (2.0, 8.0, 32.0)  # tolerances that the blur may be off by, as predicted
_SCATTERED = 2.5  # places in a batch to a texel that is summed, where its neighbours are not
_BESIDE = 0.02  # of the texels lie in the gutter, where all are summed


class Hybrid(DiffusionMethod):
    """Blurs in the texture, and sums over the surface where the blur is predicted to be wrong."""

    name = "hybrid"
    bilinear_error = 0.02
    through_flesh = True

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The blur, then sums where it is predicted to be wrong, light by light."""
        variance, level = lobe.variance_mm2, lobe.level
        texels2, tiles = resources.geometry.variance_texels2(variance), {}
        for tile, pyramid in resources.pyramids.get().items():
            points = resources.geometry.targets(level)[tile]
            mass = np.empty(points.row.shape, np.float32)
            image = texture_blur(pyramid, texels2, level, resources.source[tile] if level == 0 else None, mass)
            share = resources.predictor(tile, level).share_of_sums(variance, lobe.threshold, image, mass)
            resources.rest()
            sources = resources.sources(variance, lobe.spacing)
            read = resources.read_texels2(level)
            for i in range(resources.lights):
                gather(points, sources, variance, resources.rule, image[i].reshape(1, -1, 3), i, share[i], read)
            tiles[tile] = image
        return tiles

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """Blur and sums at the probes themselves, mixed as at the texel of the stored size that shows each.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        variance, level = lobe.variance_mm2, lobe.level
        pyramids, texels2 = resources.pyramids.get(), resources.geometry.variance_texels2(variance)
        blurred = blur_at_probes(pyramids, texels2, level, probes)
        share = np.zeros((len(probes), resources.lights), np.float32)
        for tile, pyramid in pyramids.items():
            mine = np.flatnonzero(probes.tile == tile)
            flat = shown_texels(probes.flat_index[mine], resources.geometry.size, level)
            texel = blur_of_texels(pyramid, texels2, level, flat)
            share[mine] = resources.predictor(tile, level).shares_of_texels(variance, lobe.threshold, flat, *texel)
        sources = resources.sources(variance, lobe.spacing)
        sums = surface_sums(sources, probes.position, probes.normal, probes.texel_mm2, variance, resources.rule)
        return blurred + np.repeat(share, 3, axis=1) * (sums - blurred)

    def read_stored(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """From the four texels around each probe only; those that count nothing are not summed.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        variance, level = lobe.variance_mm2, lobe.level
        texels2 = resources.geometry.variance_texels2(variance)
        out = np.zeros((len(probes), 3 * resources.lights))
        for tile, around in blur_around_probes(resources.pyramids.get(), texels2, level, probes).items():
            flat, values = around.flat.reshape(-1), around.rgb
            share = resources.predictor(tile, level).shares_of_texels(
                variance, lobe.threshold, flat, values, around.mass
            )
            needed = np.flatnonzero((around.weight.reshape(-1) > 1e-6) & share.any(axis=1))
            points = resources.geometry.targets(level)[tile]
            row = points.row.reshape(-1)[flat[needed]]
            sums = surface_sums(
                resources.sources(variance, lobe.spacing), points.position[row], points.normal[row],
                points.texel_mm2[row], variance, resources.rule, resources.read_texels2(level),
            )  # fmt: skip
            values[needed] += np.repeat(share[needed], 3, axis=1) * (sums - values[needed])
            out[around.probe] = around.read(values)
        return out

    def candidates(self, trial: Trial) -> Iterator[Proposal]:
        """Each stored size that shows the lobe, with each of a few thresholds, unless all sums are as cheap."""
        resources, variance, tolerance = trial.resources, trial.variance_mm2, trial.resources.spec.tolerance
        for level in trial.blurred_levels:
            least, _ = _cost(resources, variance, level, trial.spacing, 0.0)
            if least >= sums_cost(resources, variance, level, trial.spacing):
                continue
            around = trial.texture_blur(level)
            blurred = read_blur(around, trial.probes)
            for loose in LOOSE:
                threshold = loose * tolerance
                share = np.zeros((len(trial.probes), resources.lights))
                for tile, texel in around.items():
                    each = resources.predictor(tile, level).shares_of_texels(
                        variance, threshold, texel.flat.reshape(-1), texel.rgb, texel.mass
                    )
                    share[texel.probe] = texel.read(each)
                summed = float(np.mean(trial.probes.weight[:, None] * (share > 0)))
                cost, spacing = _cost(resources, variance, level, trial.spacing, summed)
                read = blurred + np.repeat(share, 3, axis=1) * (trial.exact - blurred)
                yield Proposal(LobeParameters(variance, level, spacing, threshold), cost, read, tried=False)

    def needs(self, resources: LobeResources, lobe: LobeParameters) -> frozenset[Resource]:
        """The premultiplied images, and single texels for the sums of a narrow lobe."""
        sums_texels = resources.sums_texels(lobe.variance_mm2, lobe.spacing)
        return frozenset(Resource) if sums_texels else frozenset({Resource.PYRAMIDS})

    def memory_bytes_per_texel(self, lights: int) -> float:
        """A premultiplied copy with its pyramid."""
        return 16 * lights + 6


def _cost(
    resources: LobeResources, variance_mm2: float, level: int, spacing: float, share: float
) -> tuple[float, float]:
    """Cost of a lobe of which a share of the texels is summed; and the spacing of its sources that costs least.

    A few sums over single texels are sooner done than a lobe's clusters are found.
    """
    summed = (share + _BESIDE) * _SCATTERED * texels(resources, level) * resources.lights
    cost, spacing = min(
        (
            sources_cost(resources, variance_mm2, each) + summed * sum_cost(resources, variance_mm2, level, each, 1),
            each,
        )
        for each in (0.0, spacing)
    )
    return blur_cost(resources, variance_mm2, level) + predict_cost(resources, level) + cost, spacing
