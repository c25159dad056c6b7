"""Method `identity`: the light itself, for lobes that are too narrow to blur anything."""

from __future__ import annotations

from collections.abc import Iterator

from skinbake.atlas import Tiles
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters, Proposal, Trial
from skinbake.diffuse.probes import Probes, light_at_probes, read_at_probes
from skinbake.diffuse.resources import LobeResources
from skinbake.numerics import Float


class Identity(DiffusionMethod):
    """Leaves the light as it is, at the full size."""

    name = "identity"
    bilinear_error = 0.0
    asked_for = False
    blurs = False
    quick = True
    misses_unseen = True

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """The light that arrives; not a copy."""
        return dict(resources.source)

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """The light that arrives at the probes' own texels.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        return light_at_probes(resources.source, probes)

    def candidates(self, trial: Trial) -> Iterator[Proposal]:
        """The full size, whatever the lobe."""
        read = read_at_probes(trial.resources.source, trial.probes, trial.half)
        yield Proposal(LobeParameters(trial.variance_mm2), 0.0, read, tried=True)
