"""Method `reference`: the exact surface integral (`surface_space.reference_integral`), which others are measured by."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import Tiles
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters
from skinbake.diffuse.probes import Probes, light_at_probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.surface_space.reference_integral import reference_integral
from skinbake.numerics import Float


class Reference(DiffusionMethod):
    """Integrates over every texel within six sigma, in float64."""

    name = "reference"
    bilinear_error = 0.055
    classical = True
    exact = True
    through_flesh = True

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The integral at every texel."""
        gain = resources.gain_of_texels(lobe.variance_mm2, lobe.level)
        tiles = {}
        for tile, points in resources.geometry.targets(lobe.level).items():
            image = resources.unreached(tile, lobe.level)
            found = reference_integral(
                resources.texels(), points.position, points.normal, points.texel_mm2, lobe.variance_mm2,
                resources.rule.separate, resources.rule.normalise,
            )  # fmt: skip
            if gain is not None:
                found *= gain[tile].reshape(-1)[points.flat_index, None]
            reached = np.flatnonzero(found.any(axis=1))
            values = found[reached].reshape(len(reached), resources.lights, 3).transpose(1, 0, 2)
            image.reshape(resources.lights, -1, 3)[:, points.flat_index[reached]] = values
            tiles[tile] = image
        return tiles

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """The integral at the probes; the light that arrives there where the lobe has no width.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        if lobe.variance_mm2 == 0:
            return light_at_probes(resources.source, probes)
        found = reference_integral(
            resources.texels(), probes.position, probes.normal, probes.texel_mm2, lobe.variance_mm2,
            resources.rule.separate, resources.rule.normalise,
        )  # fmt: skip
        return found * resources.gain_at_probes(lobe.variance_mm2, probes)

    def needs(self, resources: LobeResources, lobe: LobeParameters) -> frozenset[Resource]:
        """Every texel."""
        return frozenset({Resource.TEXELS})
