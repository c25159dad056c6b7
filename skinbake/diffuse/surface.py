"""Method `surface`: Gaussian sums over area-weighted clusters of skin in three dimensions; no seams, stretch or tiles.

At a target x:  M(x) = sum_j w_j E_j / sum_j w_j,   w_j = A_j k_j exp(-|x - x_j|^2 k_j / 2 v) p_j,  k_j = v/(v - s_j^2).

Moving the light of a cluster to its centroid is a blur of its own, by the cluster's spread s_j^2 (variance along each
tangent direction), so each cluster spreads by that much less: a single texel has k_j = 1. Where texels are coarser
than the lobe, v is widened at the target, so that their lattice still spreads light by v (`lattice_gaussian`).

Distances are straight lines, as the dipole integral wants [Jensen2002]; `separate` keeps what faces across air apart.
Row normalisation keeps constant light constant. It does not keep each light's total exactly; a symmetric, doubly
stochastic scaling would, but then M would no longer be the integral that the error is measured against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.clusters import MomentPyramid, cut_clusters, moment_pyramid
from skinbake.diffuse.gather import gather, make_batches
from skinbake.diffuse.lattice import lattice_gaussian
from skinbake.diffuse.points import TexelPoints, texel_points
from skinbake.diffuse.rows import AMPLITUDE, NARROWING, SourceRows, sort_into_rows
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

SPACING = 0.8  # widest cluster, in sigma: side of the square whose spread it may have
CUT_SIGMA = 3.5  # measured: what lies beyond changes no error by a tenth, as the sums are normalised
_BLOCK = 4
_LEVELS = 9


@dataclass(frozen=True)
class SurfaceLight:
    """Light on the skin, ready to be summed: all tiles' texels and their moment pyramids.

    Attributes
    ----------
    centre_mm : ndarray of shape (3,)
        Origin of every position, so that float32 resolves them.
    tiles : tuple of (TexelPoints, radiosity (L, H * W, 3), MomentPyramid)
    """

    centre_mm: Float
    tiles: tuple[tuple[TexelPoints, NDArray[np.float32], MomentPyramid], ...]

    @property
    def channels(self) -> int:
        """Three for each light."""
        return 3 * len(self.tiles[0][1])

    @cached_property
    def mean_texel_mm2(self) -> float:
        """Skin area over the number of texels that show it."""
        area = sum(float(p.area_mm2.sum(dtype=np.float64)) for p, _, _ in self.tiles)
        return area / max(1, sum(int(np.count_nonzero(p.area_mm2)) for p, _, _ in self.tiles))

    @cached_property
    def texels(self) -> SourceRows:
        """Every texel that has area, its area as the amplitude: sources of the narrowest lobes and of the reference."""
        singles = cut_clusters(self.tiles, 0.0, 0)
        singles[:, NARROWING] = 1
        return sort_into_rows(singles, 2 * np.sqrt(max(self.mean_texel_mm2, 1e-12)))


@dataclass(frozen=True)
class LobeSources:
    """Sources of one lobe, and how far a target looks."""

    rows: SourceRows
    variance_mm2: float
    cut: float
    widest_amplitude: float


def surface_light(radiosity: Sequence[NDArray[np.float32]], atlas: Atlas, mesh: SkinMesh) -> SurfaceLight:
    """Points and pyramids of each tile.

    Parameters
    ----------
    radiosity : sequence of ndarray of shape (L, H, W, 3), float32
        In the order of the atlas; not copied.
    """
    corners = mesh.corner_position_mm.reshape(-1, 3)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    tiles = []
    for raster, values in zip(atlas, radiosity, strict=True):
        points = texel_points(raster, mesh, centre)
        flat = values.reshape(len(values), -1, 3)
        levels = min(_LEVELS, max(raster.shape).bit_length())
        tiles.append((points, flat, moment_pyramid(points, flat, levels)))
    return SurfaceLight(centre, tuple(tiles))


def lobe_sources(
    light: SurfaceLight, variance_mm2: float, spacing: float = SPACING, cut: float = CUT_SIGMA
) -> LobeSources:
    """Clusters of one lobe, sorted for lookup.

    Parameters
    ----------
    spacing : float
        Side of the widest cluster, in sigma; 0 keeps every texel.
    cut : float
        Radius of the sum in sigma.
    """
    max_spread = spacing**2 / 12 * variance_mm2
    if max_spread < light.mean_texel_mm2 / 16:  # a quarter of the spread of four texels: most would stand alone
        rows = light.texels
    else:
        # Wider blocks than four times the limit are rare enough to be left as several clusters
        levels = int(np.log2(4 * np.sqrt(12 * max_spread / light.mean_texel_mm2))) + 1
        clusters = cut_clusters(light.tiles, max_spread, levels)
        clusters[:, NARROWING] = np.float32(variance_mm2) / (np.float32(variance_mm2) - clusters[:, NARROWING])
        clusters[:, AMPLITUDE] *= clusters[:, NARROWING]
        rows = sort_into_rows(clusters, cut * np.sqrt(variance_mm2) / 3)
    widest = float(rows.source[:, AMPLITUDE].max(initial=0)) or 1.0
    return LobeSources(rows, variance_mm2, cut, widest)


def evaluate(
    sources: LobeSources,
    points: TexelPoints,
    separate: bool,
    normalise: bool,
    out: NDArray[np.float32],
    weight: NDArray[np.float32] | None = None,
) -> None:
    """Write M at each point into `out` (texels, C), at row `points.flat_index`; without any source, nothing."""
    # Where texels are coarser than the lobe, their lattice spreads light as far as the next texel
    variance, gain = lattice_gaussian(sources.variance_mm2, points.texel_mm2)
    near = sources.cut * np.sqrt(sources.variance_mm2) + 4 * np.sqrt(
        np.median(points.texel_mm2) if len(variance) else 0.0
    )
    batches = make_batches(points.row, _BLOCK, points.position, np.float32(near))
    rows = sources.rows
    if weight is None:
        weight = np.zeros(len(out), np.float32)
    density = 0.0 if normalise else sources.widest_amplitude / (2 * np.pi * sources.variance_mm2)
    gather(
        batches, points.position, points.normal, variance, gain, points.flat_index,
        rows.source, rows.row_start, rows.origin, rows.cell, rows.rows_y, rows.rows_z,
        np.float32(sources.cut), separate, np.float32(1 / sources.widest_amplitude), np.float32(density), out, weight,
    )  # fmt: skip


def surface_blur(
    light: SurfaceLight,
    target: Sequence[TexelPoints],
    variance_mm2: float,
    separate: bool = True,
    normalise: bool = True,
    spacing: float = SPACING,
    cut: float = CUT_SIGMA,
) -> list[NDArray[np.float32]]:
    """One lobe at the texels of each target tile, by the sums above.

    Parameters
    ----------
    light : SurfaceLight
    target : sequence of TexelPoints
        Of any texture size, made with `light.centre_mm` and `extend=True`.

    Returns
    -------
    list of ndarray of shape (h, w, C), float32
        Zero where the atlas is empty.
    """
    sources = lobe_sources(light, variance_mm2, spacing, cut)
    result = []
    for points in target:
        out = np.zeros((points.row.size, light.channels), np.float32)
        evaluate(sources, points, separate, normalise, out)
        result.append(out.reshape(*points.row.shape, -1))
    return result
