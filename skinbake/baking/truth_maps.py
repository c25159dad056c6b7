"""Maps of the skin for walks: what each place is like, and where that changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinbake.atlas import tile_of_face
from skinbake.atlas.texel_coordinates import local_uv, texel_xy
from skinbake.bilinear import bilinear_texels
from skinbake.numerics import Float
from skinbake.scene.maps import Image, SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.skin_grid import SkinGrid, skin_grid
from skinbake.transport.walk_medium import DENSITY

WALKED = ("radius", "melanin", "haemoglobin")  # maps that walks know
NEAR_MM = 3.0  # of a change
CHANGED = 1.05  # ratio of widths, or of a pigment's shares, that counts as one
FINEST_MM = 0.5  # of the grid, and of the places that it is made of


@dataclass(frozen=True)
class VaryingSkin:
    """What maps say of places closely spread over the skin.

    Attributes
    ----------
    place_mm : ndarray of shape (N, 3)
        About a given centre.
    values : dict of str to ndarray of shape (N,)
        By the map's name.
    """

    place_mm: Float
    values: dict[str, Float]

    @staticmethod
    def of(mesh: SkinMesh, maps: SkinMaps, centre_mm: Float, constants: Mapping[str, float]) -> VaryingSkin:
        """What a look's maps say.

        Parameters
        ----------
        mesh : SkinMesh
        maps : SkinMaps
        centre_mm : ndarray of shape (3,)
        constants : mapping of str to float
            Names of the maps, and what stands where tiles lack one.
        """
        edge = np.diff(mesh.corner_position_mm[:, [0, 1, 2, 0]], axis=1)
        parts = np.ceil(np.linalg.norm(edge, axis=2).max(axis=1) / FINEST_MM).astype(int).clip(1, 64)
        places, uvs, tiles, tile = [], [], [], tile_of_face(mesh, True)
        for count in np.unique(parts).tolist():
            face = np.flatnonzero(parts == count)
            weight = _lattice(count)
            places.append(np.einsum("pk,fki->fpi", weight, mesh.corner_position_mm[face]).reshape(-1, 3) - centre_mm)
            uvs.append(np.einsum("pk,fki->fpi", weight, mesh.corner_uv[face]).reshape(-1, 2))
            tiles.append(np.repeat(tile[face], len(weight)))
        uv, of_tile = np.concatenate(uvs), np.concatenate(tiles)
        # As the maps, of single precision: their sums' round-off is no change
        values = {
            name: _read(getattr(maps, name), uv, of_tile, constant).astype(np.float32).astype(np.float64)
            for name, constant in constants.items()
        }
        return VaryingSkin(np.concatenate(places), values)

    def grid(self) -> tuple[SkinGrid, tuple[str, ...]]:
        """Values inside, those of the nearest skin, and the names of its quantities: 1 / radius is a `DENSITY`."""
        columns = [1 / v if name == "radius" else v for name, v in self.values.items()]
        names = tuple(DENSITY if name == "radius" else name for name in self.values)
        return skin_grid(self.place_mm, np.stack(columns, axis=1), FINEST_MM), names

    def changes(self, position_mm: Float) -> NDArray[np.bool_]:
        """Whether a value changes near places (N, 3)."""
        found = np.zeros(len(position_mm), np.bool_)
        for n, around in enumerate(cKDTree(self.place_mm).query_ball_point(position_mm, NEAR_MM)):
            near = [values[around] for values in self.values.values()] if around else []
            found[n] = any(each.max() > CHANGED * each.min() for each in near)
        return found


def _lattice(count: int) -> Float:
    """Barycentrics (P, 3) of the middles of a triangle's `count`^2 equal parts, those that stand upright."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    kept = i + j < count
    b1, b2 = (i[kept] + 1 / 3) / count, (j[kept] + 1 / 3) / count
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def _read(images: Mapping[int, Image], uv: Float, tile: NDArray[np.int64], constant: float) -> Float:
    """A map at UVs (N, 2) of some tiles, bilinear."""
    found = np.full(len(uv), constant)
    for number, image in images.items():
        mine = np.flatnonzero(tile == number)
        local = local_uv(uv[mine], number)
        place = np.stack(texel_xy(local[:, 0], local[:, 1], 1, 1)[::-1], axis=1)
        flat, share = bilinear_texels(place, *image.shape)
        found[mine] = (image.reshape(-1)[flat] * share).sum(axis=1)
    return found
