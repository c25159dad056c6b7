"""From texels to points that rays start at, and from what rays hit back to texels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, local_uv, tile_of_face, tiles_of
from skinbake.atlas.texel_coordinates import texel_xy
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.shadow_origin import SubdividedMesh, facet_point, point_of
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
NOTHING = -1


def skin_points(
    raster: AtlasRaster, mesh: SkinMesh, occluder: Occluder, rows: Index, cols: Index
) -> tuple[Image, Image]:
    """Points of texels on the surface that rays meet, about the occluder's centre, and unit normals; shapes (n, 3).

    Parameters
    ----------
    raster : AtlasRaster
    mesh : SkinMesh
    occluder : Occluder
    rows, cols : ndarrays of shape (n,)
        Addressed texels.
    """
    point, normal = np.empty((len(rows), 3), np.float32), np.empty((len(rows), 3), np.float32)
    skin = _Skin(occluder.subdivided, mesh.corner_normal)
    texels = np.ascontiguousarray(rows), np.ascontiguousarray(cols)
    parallel_for(_place, len(rows), raster.shown, texels, skin, point, normal)
    return point, normal


class _Skin(NamedTuple):
    """The surface that rays meet, and the mesh's normals.

    Attributes
    ----------
    subdivided : SubdividedMesh
    corner_normal : ndarray of shape (F, 3, 3)
    """

    subdivided: SubdividedMesh
    corner_normal: Float


@kernel
def _place(first, stop, shown, texels, skin, point, normal):  # type: ignore[no-untyped-def]
    """Write the points and normals of texels of a list.

    Parameters
    ----------
    first, stop : int
        Which of them.
    shown : ShownFaces
    texels : tuple of two ndarrays of shape (n,), int64
        Rows and columns.
    skin : _Skin
    point, normal : ndarrays of shape (n, 3), float32
        Written.
    """
    face_index, barycentric = shown.face_index, shown.barycentric
    rows, cols = texels
    for k in range(first, stop):
        face, b = face_index[rows[k], cols[k]], barycentric[rows[k], cols[k]]
        x, y, z = facet_point(skin.corner_normal, face, np.float64(b[0]), np.float64(b[1]))
        length = max(np.sqrt(x * x + y * y + z * z), 1e-30)
        normal[k, 0], normal[k, 1], normal[k, 2] = x / length, y / length, z / length
        point[k, 0], point[k, 1], point[k, 2] = point_of(skin.subdivided, face, np.float64(b[0]), np.float64(b[1]))


@kernel
def ascend(child, b1, b2, levels):  # type: ignore[no-untyped-def]
    """Face of the mesh and place in it of a place in a triangle of the smooth surface: the inverse of `descend`.

    Parameters
    ----------
    child : int
    b1, b2 : float
        Barycentrics 1 and 2.
    levels : int
        Of the surface.
    """
    for _ in range(levels):
        corner, child = child % 4, child // 4
        if corner == 3:
            b1, b2 = (1 - b1) / 2, (1 - b2) / 2
        else:
            b1, b2 = (b1 + (corner == 1)) / 2, (b2 + (corner == 2)) / 2
    return child, b1, b2


@kernel
def _met(first, stop, hits, direction, surface, face, uv):  # type: ignore[no-untyped-def]
    """Write the face and the UVs that rays meet from outside; NOTHING for the face of others.

    Parameters
    ----------
    first, stop : int
        Rays.
    hits : tuple of three ndarrays of shape (n,)
        Triangles of the smooth surface, -1 for none, and barycentrics 1 and 2.
    direction : ndarray of shape (n, 3)
    surface : tuple of SubdividedMesh and ndarray of shape (F, 3, 2)
        The one that rays meet, and the mesh's UVs.
    face : ndarray of shape (n,), int64, written
    uv : ndarray of shape (n, 2), float64, written
    """
    children, in_1, in_2 = hits
    subdivided, corner_uv = surface
    for k in range(first, stop):
        child = np.int64(children[k])
        face[k] = NOTHING
        if child < 0:
            continue
        against = np.float32(0)
        for axis in range(3):
            against += subdivided.facing[child, axis] * direction[k, axis]
        if against >= 0:
            continue
        of, b1, b2 = ascend(child, np.float64(in_1[k]), np.float64(in_2[k]), subdivided.levels)
        face[k] = of
        for axis in range(2):
            uv[k, axis] = (
                (1 - b1 - b2) * corner_uv[of, 0, axis] + b1 * corner_uv[of, 1, axis] + b2 * corner_uv[of, 2, axis]
            )


class TexturedSkin(NamedTuple):
    """Skin that rays meet, and the texture whose texels tell where.

    Attributes
    ----------
    mesh : SkinMesh
    occluder : Occluder
        The mesh's.
    size : (width, height)
        Of the texture.
    udim : bool
    """

    mesh: SkinMesh
    occluder: Occluder
    size: tuple[int, int]
    udim: bool = False

    def met_by(self, origin: Image, direction: Image) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Which texel shows the skin that each ray meets first.

        Parameters
        ----------
        origin, direction : ndarrays of shape (n, 3)

        Returns
        -------
        tile : ndarray of shape (n,), int32
            Place of the tile in the atlas.
        texel : ndarray of shape (n,), int32
            row * W + col; NOTHING where a ray meets no skin, or skin from behind.
        """
        mesh, (width, height) = self.mesh, self.size
        tile, texel = np.zeros(len(origin), np.int32), np.full(len(origin), NOTHING, np.int32)
        child, b1, b2, _ = self.occluder.first_hit(origin, direction)
        faces, places = np.empty(len(origin), np.int64), np.empty((len(origin), 2))
        surface = self.occluder.subdivided, mesh.corner_uv
        parallel_for(_met, len(faces), (child, b1, b2), direction, surface, faces, places)
        met = np.flatnonzero(faces != NOTHING)
        face, uv = faces[met], places[met]
        owner = tile_of_face(mesh, True)[face] if self.udim else None
        for k, number in enumerate(tiles_of(mesh, self.udim)):
            mine = np.arange(len(met)) if owner is None else np.flatnonzero(owner == number)
            local = local_uv(uv[mine], number)
            x, y = texel_xy(local[:, 0], local[:, 1], height, width)
            col = np.clip(x.astype(np.int64), 0, width - 1)
            row = np.clip(y.astype(np.int64), 0, height - 1)
            tile[met[mine]], texel[met[mine]] = k, row * width + col
        return tile, texel
