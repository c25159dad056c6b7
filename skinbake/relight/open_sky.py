"""Which directions each texel of a small atlas sees: rays that are traced once and serve every light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, Tiles
from skinbake.irradiance.lattice import lattice
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.open_directions import WHOLE, open_directions
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.settled_rays import SettledRays
from skinbake.irradiance.sky_texels import Seen, SkyTexels
from skinbake.irradiance.surface import texel_surface
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.relight.harmonics import harmonics
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
SEEN_ORDER = 2  # of harmonics by which the oil knows what is open


@dataclass(frozen=True)
class OpenSky:
    """What the texels of a small atlas see of the sky.

    Attributes
    ----------
    atlas : Atlas
        The small one.
    towards : ndarray of shape (D, 3), float32
        Unit directions, each for an equal part of the sphere; those that follow each other are near.
    origin, normal : dicts of int to ndarray of shape (n, 3), float32
        By tile: where the rays of the rows of `share` start, about the occluder's centre, and the smooth normals there.
    row : dict of int to ndarray of shape (h, w), int32
        By tile: the row of `share` that a texel has; -1 where the atlas is empty.
    share : dict of int to ndarray of shape (n, D), uint8
        By tile: what arrives of light from a direction, in parts of `WHOLE`. Below the horizon of the smooth surface,
        where a mapped normal may still face, it is the texel's mean.
    shadows : bool
        Whether rays were traced; else all is open.
    """

    atlas: Atlas
    towards: Image
    origin: dict[int, Image]
    normal: dict[int, Image]
    row: dict[int, NDArray[np.int32]]
    share: dict[int, NDArray[np.uint8]]
    shadows: bool


def open_sky(spec: SceneSpec, scene: SceneData, texels: SkyTexels) -> OpenSky:
    """Trace rays from every texel to directions above its horizon, but those that are traced for plans of skies.

    Parameters
    ----------
    spec : SceneSpec
        `shadows: false` leaves everything open.
    scene : SceneData
    texels : SkyTexels
        Of the scene.
    """
    rows, origins, normals, shares = {}, {}, {}, {}
    for raster in texels.atlas:
        surface = texel_surface(raster, scene.mesh, scene.maps, spec.specular, scene.occluder)
        addressed = np.flatnonzero(raster.addressed)
        row = np.full(raster.shape, -1, np.int32)
        row.reshape(-1)[addressed] = np.arange(len(addressed), dtype=np.int32)
        origin, normal = surface.origins(addressed), surface.smooth_normal.reshape(-1, 3)[addressed]
        occluder, seen = (scene.occluder, texels.seen[raster.tile]) if spec.shadows else (None, None)
        rows[raster.tile], origins[raster.tile], normals[raster.tile] = row, origin, normal
        shares[raster.tile] = _shares(raster, surface.smooth_normal, origin, texels.towards, occluder, seen)
    return OpenSky(texels.atlas, texels.towards, origins, normals, rows, shares, spec.shadows)


def _shares(
    raster: AtlasRaster,
    smooth_normal: Image,
    origin: Image,
    towards: Image,
    occluder: Occluder | None,
    seen: Seen | None,
) -> NDArray[np.uint8]:
    """Shares of a tile's n texels by direction, (n, D): of those between others only what these do not agree on.

    Parameters
    ----------
    raster : AtlasRaster
    smooth_normal : ndarray of shape (h, w, 3)
    origin : ndarray of shape (n, 3)
        Of the addressed texels.
    towards : ndarray of shape (D, 3)
    occluder : Occluder, optional
        None: nothing is in the way.
    seen : Seen, optional
        Of this tile: texels that are traced already.
    """
    texels, coarsest = np.flatnonzero(raster.addressed), lattice(raster)
    row, col = np.divmod(texels, raster.shape[1])
    normal = smooth_normal.reshape(-1, 3)[texels]
    settled = SettledRays(raster.addressed, smooth_normal, coarsest, len(towards))
    share, undone, stride = np.empty((len(texels), len(towards)), np.uint8), np.ones(len(texels), np.bool_), coarsest
    in_seen = np.full(len(texels), -1)
    if seen is not None:
        in_seen[np.searchsorted(texels, seen.texels)] = np.arange(len(seen.texels))
    while stride:
        these = np.flatnonzero(undone & (row % stride == 0) & (col % stride == 0))
        answers = settled.of(texels[these], stride)
        known, new = np.flatnonzero(in_seen[these] >= 0), np.flatnonzero(in_seen[these] < 0)
        if seen is not None:
            of = in_seen[these[known]]
            share[these[known]], answers[known] = seen.share[of], seen.answers[of]
        asked, found = these[new], answers[new]
        share[asked] = open_directions(origin[asked], normal[asked], towards, occluder, found)
        answers[new] = found
        undone[these] = False
        if stride > 1:
            settled.keep(texels[these], answers)
        stride //= 2
    return share


def visibility_harmonics(sky: OpenSky) -> Tiles:
    """What is open to the sky as harmonics of the direction up to order 2, (3, h, w, 3) a tile: Y_0 to Y_8 in turn.

    Enough to tell which half of the sky an eye socket sees; the shader reads it for what the oil mirrors.
    """
    part = harmonics(sky.towards, SEEN_ORDER).astype(np.float32) * np.float32(4 * np.pi / len(sky.towards) / WHOLE)
    out = {}
    for raster in sky.atlas:
        share, row = sky.share[raster.tile], sky.row[raster.tile]
        values = np.zeros((len(share), 9), np.float32)
        parallel_for(_project, len(share), share, part, values)
        image = np.zeros((*row.shape, 9), np.float32)
        image[row >= 0] = values[row[row >= 0]]
        out[raster.tile] = np.ascontiguousarray(np.moveaxis(image.reshape(*row.shape, 3, 3), 2, 0))
    return out


@kernel
def _project(first: int, stop: int, share: NDArray[np.uint8], part: Image, out: Image) -> None:
    """Products of shares with harmonics.

    Parameters
    ----------
    first, stop : int
        Points.
    share : ndarray of shape (n, D)
    part : ndarray of shape (D, J)
    out : ndarray of shape (n, J)
        Added to: zeros.
    """
    for i in range(first, stop):
        for d in range(share.shape[1]):
            seen = np.float32(share[i, d])
            for j in range(part.shape[1]):
                out[i, j] += seen * part[d, j]
