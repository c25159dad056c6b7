"""Light from all around: an equirectangular radiance map, or a constant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_plan import EnvironmentPlan
from skinbake.irradiance.environment_share import open_shares, open_sums
from skinbake.irradiance.lattice import lattice
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import MeanPassing
from skinbake.irradiance.refine import refine
from skinbake.irradiance.settled_rays import FirstDirections, SettledRays
from skinbake.irradiance.surface import TexelSurface
from skinbake.kernels.threads import for_slices
from skinbake.numerics import Float

Image = NDArray[np.float32]
CLOSE = 4  # of the lattice: within a millimetre, texels beside a chart's border go by the neighbours they have
ROWS = 64  # of irradiance in memory at a time
FEWEST = 256  # directions behind the oil's share where no shadows are traced


def light_environment(
    surface: TexelSurface, occluder: Occluder, plan: EnvironmentPlan, table: Float, out: Image
) -> None:
    """Irradiance and unshadowed share of a sky, written to `out` (H, W, 4); theory.md 10.3, 10.4.

    Irradiance without shadows is the plan's: harmonics, or a table over all normals integrated exactly. Shadows
    multiply it by the share that the plan's directions find open, drawn in proportion to radiance and the same for
    every texel, so that the result is smooth. The ratio is exact wherever nothing is in the way, whatever the
    directions. The oil's maps are finer than the lattice: between its texels is interpolated by how much more passes
    than of a constant sky as open.

    Parameters
    ----------
    surface : TexelSurface
    occluder : Occluder
    plan : EnvironmentPlan
    table : ndarray
        Albedo of the oil layer; of size 0 where the oil takes nothing off.
    out : ndarray of shape (H, W, 4), float32
    """
    addressed = surface.raster.addressed
    if plan.samples or table.size:
        directions, weights = plan.sky.draw(plan.samples or FEWEST, plan.offset)
        normal = surface.smooth_normal.reshape(-1, 3)
        roughness = np.broadcast_to(surface.roughness, addressed.shape).reshape(-1)
        strength = np.broadcast_to(surface.strength, addressed.shape).reshape(-1)
        f0 = np.broadcast_to(surface.f0, addressed.shape).reshape(-1)
        barrier = occluder if plan.samples else None
        coarsest = lattice(surface.raster)
        # What passes in part is no answer of yes or no
        rays = SettledRays(addressed, surface.smooth_normal, coarsest, len(directions))
        settled = rays if plan.samples and not occluder.has_cards else None
        first = FirstDirections(directions) if settled else None

        mean_passing = MeanPassing(table) if table.size else None
        same = surface.roughness.size == surface.strength.size == surface.f0.size == 1

        def passing(texels: NDArray[np.int64] | slice) -> Float:
            assert mean_passing is not None
            here = (surface.roughness, surface.strength, surface.f0) if same else (
                roughness[texels], strength[texels], f0[texels],
            )  # fmt: skip
            return mean_passing.of(*here).reshape(-1, 1)

        def trace(texels: NDArray[np.int64], stride: int) -> Image:
            oil = (roughness[texels], strength[texels], table, f0[texels]) if table.size else None
            answers = settled.of(texels, stride) if settled else None
            at = surface.origins(texels), normal[texels]
            if first and first.count and answers is not None:
                open_sums(*at, directions[: first.count], weights[: first.count], barrier, answers=answers)
                first.settle(answers)
            shares = open_shares(*at, directions, weights, barrier, oil, answers)
            if settled and answers is not None:
                settled.keep(texels, answers)
            if table.size:
                shares[:, :3] -= shares[:, 3:] * passing(texels)
            return shares

        refine(addressed, surface.smooth_normal, 4, trace, plan.variation, coarsest, coarsest // CLOSE, out)

        def add_passing(rows: slice) -> None:
            width = out.shape[1]
            share = passing(slice(rows.start * width, rows.stop * width)).reshape(-1, 1 if same else width, 1)
            out[rows, :, :3] = np.maximum(out[rows, :, :3] + out[rows, :, 3:] * share, 0)

        if table.size:
            for_slices(add_passing, len(out), ROWS)
    else:
        out[...] = addressed[..., None]
    for start in range(0, len(out), ROWS):  # in strips, rather than another image
        rows = slice(start, start + ROWS)
        out[rows, :, :3] *= plan.unshadowed(surface.normal[rows], addressed[rows])
