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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.surface_space.clusters import MomentPyramid, moment_pyramid
from skinbake.diffuse.surface_space.gather import gather
from skinbake.diffuse.surface_space.points import TexelPoints, texel_points
from skinbake.diffuse.surface_space.sources import SourceTree, source_tree
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

SPACING = 0.8  # widest cluster, in sigma: side of the square whose spread it may have
CUT_SIGMA = 4.0  # what lies beyond makes sums wrong by 3e-5


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
    def lights(self) -> int:
        """L."""
        return len(self.tiles[0][1])

    @cached_property
    def mean_texel_mm2(self) -> float:
        """Skin area over the number of texels that show it."""
        area = sum(float(p.area_mm2.sum(dtype=np.float64)) for p, _, _ in self.tiles)
        return area / max(1, sum(int(np.count_nonzero(p.area_mm2)) for p, _, _ in self.tiles))

    @cached_property
    def texels(self) -> SourceTree:
        """Every texel that has area, its area as the amplitude: sources of the narrowest lobes and of the reference."""
        return source_tree(self.tiles)


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
        tiles.append((points, flat, moment_pyramid(points, flat)))
    return SurfaceLight(centre, tuple(tiles))


def lobe_sources(light: SurfaceLight, variance_mm2: float, spacing: float = SPACING) -> SourceTree:
    """Clusters of one lobe.

    Parameters
    ----------
    spacing : float
        Side of the widest cluster, in sigma; 0 keeps every texel.
    """
    if sums_texels(light, variance_mm2, spacing):
        return light.texels
    return source_tree(light.tiles, spacing**2 / 12 * variance_mm2, variance_mm2)


def sums_texels(light: SurfaceLight, variance_mm2: float, spacing: float) -> bool:
    """Whether a lobe is so narrow that most texels would be clusters by themselves."""
    return spacing**2 / 12 * variance_mm2 < light.mean_texel_mm2 / 8  # half of the spread of four texels


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
        Of any texture size, `extended_points` about `light.centre_mm`.

    Returns
    -------
    list of ndarray of shape (L, h, w, 3), float32
        Zero where the atlas is empty.
    """
    sources = lobe_sources(light, variance_mm2, spacing)
    result = []
    for points in target:
        out = np.zeros((light.lights, points.row.size, 3), np.float32)
        gather(points, sources, variance_mm2, cut, separate, normalise, out)
        result.append(out.reshape(light.lights, *points.row.shape, 3))
    return result
