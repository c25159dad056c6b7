"""Method `texture`: one texel size for the whole texture, separable kernels, K[M E] / K[M]; the 2015 report's way."""

from __future__ import annotations

from collections.abc import Iterator

from skinbake.atlas import Tiles
from skinbake.diffuse.methods.costs import blur_cost
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters, Proposal, Trial
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.texture_space.blur import texture_blur
from skinbake.diffuse.texture_space.blur_at_probes import blur_around_probes, blur_at_probes, read_blur
from skinbake.numerics import Float


class Texture(DiffusionMethod):
    """Blurs in the texture, at the level of a pyramid where the lobe is a few texels wide (`texture_space.blur`)."""

    name = "texture"
    bilinear_error = 0.004  # smooth in UV
    quick = True
    misses_unseen = True
    advice = "set diffusion.method to auto or surface"

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The blur; at the full size light without coverage within reach stays as it is."""
        texels2 = resources.geometry.variance_texels2(lobe.variance_mm2)
        return {
            tile: texture_blur(pyramid, texels2, lobe.level, resources.source[tile] if lobe.level == 0 else None)
            for tile, pyramid in resources.pyramids.get().items()
        }

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """The blur between the texels of its level.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        texels2 = resources.geometry.variance_texels2(lobe.variance_mm2)
        return blur_at_probes(resources.pyramids.get(), texels2, lobe.level, probes)

    def read_stored(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """From the four texels around each probe only.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        texels2 = resources.geometry.variance_texels2(lobe.variance_mm2)
        return read_blur(blur_around_probes(resources.pyramids.get(), texels2, lobe.level, probes), probes)

    def candidates(self, trial: Trial) -> Iterator[Proposal]:
        """Each stored size that shows the lobe."""
        for level in trial.blurred_levels:
            read = read_blur(trial.texture_blur(level), trial.probes)
            cost = blur_cost(trial.resources, trial.variance_mm2, level)
            yield Proposal(LobeParameters(trial.variance_mm2, level), cost, read, tried=True)

    def needs(self, resources: LobeResources, lobe: LobeParameters) -> frozenset[Resource]:
        """The premultiplied images."""
        return frozenset({Resource.PYRAMIDS})

    def memory_bytes_per_texel(self, lights: int) -> float:
        """A premultiplied copy with its pyramid."""
        return 16 * lights + 6
