"""A map of the skin's width for walks: how dense the medium is at each place, and where that changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinbake.atlas import tile_of_face
from skinbake.atlas.texel_coordinates import local_uv, texel_xy
from skinbake.bilinear import bilinear_texels
from skinbake.numerics import Float
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.density import DensityGrid, density_grid

NEAR_MM = 3.0  # of a change
CHANGED = 1.05  # ratio of widths that counts as one
FINEST_MM = 0.5  # of the grid, and of the places that it is made of


@dataclass(frozen=True)
class WidthOfSkin:
    """Factors on the width of a profile, at places closely spread over the skin.

    Attributes
    ----------
    place_mm : ndarray of shape (N, 3)
        About a given centre.
    radius : ndarray of shape (N,)
    """

    place_mm: Float
    radius: Float

    @staticmethod
    def of(mesh: SkinMesh, maps: SkinMaps, centre_mm: Float, constant: float) -> WidthOfSkin:
        """What a look's map says.

        Parameters
        ----------
        mesh : SkinMesh
        maps : SkinMaps
        centre_mm : ndarray of shape (3,)
        constant : float
            Where tiles lack a map.
        """
        edge = np.diff(mesh.corner_position_mm[:, [0, 1, 2, 0]], axis=1)
        parts = np.ceil(np.linalg.norm(edge, axis=2).max(axis=1) / FINEST_MM).astype(int).clip(1, 64)
        places, values, tile = [], [], tile_of_face(mesh)
        for count in np.unique(parts).tolist():
            face = np.flatnonzero(parts == count)
            weight = _lattice(count)
            places.append(np.einsum("pk,fki->fpi", weight, mesh.corner_position_mm[face]).reshape(-1, 3) - centre_mm)
            uv = np.einsum("pk,fki->fpi", weight, mesh.corner_uv[face]).reshape(-1, 2)
            values.append(_read(maps, uv, np.repeat(tile[face], len(weight)), constant))
        radius = np.concatenate(values).astype(np.float32)  # as the map: its sums' round-off is no change
        return WidthOfSkin(np.concatenate(places), radius.astype(np.float64))

    def density(self) -> DensityGrid:
        """The density of a medium that is as wide as the nearest skin says: 1 / radius."""
        return density_grid(self.place_mm, 1 / self.radius, FINEST_MM)

    def changes(self, position_mm: Float) -> NDArray[np.bool_]:
        """Whether the width changes near places (N, 3)."""
        around = cKDTree(self.place_mm).query_ball_point(position_mm, NEAR_MM)
        widths = [self.radius[each] if each else np.ones(1) for each in around]
        return np.array([each.max() > CHANGED * each.min() for each in widths], np.bool_)


def _lattice(count: int) -> Float:
    """Barycentrics (P, 3) of the middles of a triangle's `count`^2 equal parts, those that stand upright."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    kept = i + j < count
    b1, b2 = (i[kept] + 1 / 3) / count, (j[kept] + 1 / 3) / count
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def _read(maps: SkinMaps, uv: Float, tile: NDArray[np.int64], constant: float) -> Float:
    """The map at UVs (N, 2) of some tiles, bilinear."""
    found = np.full(len(uv), constant)
    for number, image in maps.radius.items():
        mine = np.flatnonzero(tile == number)
        local = local_uv(uv[mine], number)
        place = np.stack(texel_xy(local[:, 0], local[:, 1], 1, 1)[::-1], axis=1)
        flat, share = bilinear_texels(place, *image.shape)
        found[mine] = (image.reshape(-1)[flat] * share).sum(axis=1)
    return found
