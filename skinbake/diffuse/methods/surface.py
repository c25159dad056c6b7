"""Method `surface`: Gaussian sums over area-weighted clusters of skin in three dimensions; no seams, stretch or tiles.

At a target x:  M(x) = sum_j w_j E_j / sum_j w_j,   w_j = A_j k_j exp(-|x - x_j|^2 k_j / 2 v) p_j,  k_j = v/(v - s_j^2).

Moving the light of a cluster to its centroid is a blur of its own, by the cluster's spread s_j^2 (variance along each
tangent direction), so each cluster spreads by that much less: a single texel has k_j = 1. Where texels are coarser
than the lobe, v is widened at the target, so that their lattice still spreads light by v (`lattice_variance`).

Distances are straight lines, as the dipole integral wants [Jensen2002]; `separate` keeps what faces across air apart.
Row normalisation keeps constant light constant. It does not keep each light's total exactly; a symmetric, doubly
stochastic scaling would, but then M would no longer be the integral that the error is measured against.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skinbake.atlas import Tiles
from skinbake.bilinear import bilinear_texels
from skinbake.diffuse.methods.costs import sums_cost
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters, Proposal, Trial
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.surface_space.gather import gather
from skinbake.diffuse.surface_space.surface_sums import surface_sums
from skinbake.diffuse.surface_space.upsample import interpolate_smooth
from skinbake.numerics import Float


class Surface(DiffusionMethod):
    """Sums over the surface at every texel, interpolated from half the size where that is smooth enough."""

    name = "surface"
    bilinear_error = 0.02  # measured on a scan whose texels vary 7.7 times
    classical = True
    through_flesh = True

    def map(self, resources: LobeResources, lobe: LobeParameters) -> Tiles:
        """Interpolated from half the size where that is smooth enough, else summed."""
        return self._summed(resources, lobe, lobe.level, resources.read_texels2(lobe.level))

    def _summed(self, resources: LobeResources, lobe: LobeParameters, level: int, read: float) -> Tiles:
        """Sums at the texels of any size, whose reading spreads light by `read` of these."""
        variance = lobe.variance_mm2
        sources = resources.sources(variance, lobe.spacing)
        halve = resources.interpolates(variance, level)
        coarse = self._summed(resources, lobe, level + 1, read / 4) if halve else None
        gain = resources.gain_of_texels(variance, level)
        tiles = {}
        for tile, points in resources.geometry.targets(level).items():
            image = resources.unreached(tile, level)
            if coarse is not None:
                least_sigma = resources.least_sigma(level)[tile]
                left = interpolate_smooth(coarse[tile], points.row, least_sigma, float(np.sqrt(variance)), image)
                points = points._replace(row=left)
            resources.rest()
            gather(points, sources, variance, resources.rule, image.reshape(resources.lights, -1, 3), read=read)
            if gain is not None:
                image *= np.where(points.row >= 0, gain[tile], np.float32(1))[..., None]
            tiles[tile] = image
        return tiles

    def at_probes(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """Sums at the probes themselves.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        sources = resources.sources(lobe.variance_mm2, lobe.spacing)
        sums = surface_sums(
            sources, probes.position, probes.normal, probes.texel_mm2, lobe.variance_mm2, resources.rule
        )
        return sums * resources.gain_at_probes(lobe.variance_mm2, probes)

    def read_stored(self, resources: LobeResources, lobe: LobeParameters, probes: Probes) -> Float:
        """From sums at the four texels around each probe only.

        Parameters
        ----------
        resources, lobe, probes
            As in `DiffusionMethod`.
        """
        sources = resources.sources(lobe.variance_mm2, lobe.spacing)
        gain = resources.gain_of_texels(lobe.variance_mm2, lobe.level)
        out = np.zeros((len(probes), 3 * resources.lights))
        for tile, points in resources.geometry.targets(lobe.level).items():
            mine = np.flatnonzero(probes.tile == tile)
            flat, weight = bilinear_texels(probes.place[mine], *points.row.shape)
            # Texel by texel of each probe in turn, so that the four share a batch; those without weight are left out
            row = points.row.reshape(-1)[flat.reshape(-1)]
            needed = np.flatnonzero((weight.reshape(-1) > 1e-6) & (row >= 0))
            summed = row[needed]
            values = np.zeros((flat.size, out.shape[1]))
            values[needed] = surface_sums(
                sources, points.position[summed], points.normal[summed], points.texel_mm2[summed],
                lobe.variance_mm2, resources.rule, resources.read_texels2(lobe.level),
            )  # fmt: skip
            if gain is not None:
                values[needed] *= gain[tile].reshape(-1)[flat.reshape(-1)[needed], None]
            out[mine] = np.einsum("pkc,pk->pc", values.reshape(*flat.shape, -1), weight)
        return out

    def candidates(self, trial: Trial) -> Iterator[Proposal]:
        """Each stored size that shows the lobe; untried, as sums cost the most to try and are the most exact."""
        for level in trial.levels:
            lobe = LobeParameters(trial.variance_mm2, level, trial.spacing)
            cost = sums_cost(trial.resources, trial.variance_mm2, level, trial.spacing)
            yield Proposal(lobe, cost, trial.exact, tried=False)

    def needs(self, resources: LobeResources, lobe: LobeParameters) -> frozenset[Resource]:
        """Single texels for the sums of a narrow lobe."""
        sums_texels = resources.sums_texels(lobe.variance_mm2, lobe.spacing)
        return frozenset({Resource.TEXELS}) if sums_texels else frozenset()
