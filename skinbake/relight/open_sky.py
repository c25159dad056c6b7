"""Which directions each texel of a small atlas sees: rays that are traced once and serve every light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, Tiles, coarser_atlas, signed_uv_area
from skinbake.irradiance.environment import lattice
from skinbake.irradiance.environment_share import aim
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.settled_rays import Answers, SettledRays, has_bit, set_bit
from skinbake.irradiance.sky_points import all_around
from skinbake.irradiance.surface import texel_surface
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import for_slices, parallel_for
from skinbake.relight.harmonics import harmonics
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
DIRECTIONS = 1024  # all around, half of them above a texel's horizon
TEXEL_MM = 2.0  # of the small atlas, on average; penumbras of what 25 textures can hold are a centimetre and more wide
SMALLEST = 64  # texels of its shorter side
WHOLE = 255  # a share of 1
SEEN_ORDER = 2  # of harmonics by which the oil knows what is open
RAYS = 1 << 16  # that a thread has in memory at a time
_CELLS_BITS = 5  # cells along each axis by which directions are put in order: 2^5


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


def small_size(scene: SceneData, size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of an atlas whose texels hold `TEXEL_MM`^2 of skin on average, a whole number of the full one's.

    Parameters
    ----------
    scene : SceneData
    size : (width, height)
        Of the full texture, the largest that comes back.
    """
    texels = np.abs(signed_uv_area(scene.mesh)).sum() * size[0] * size[1]
    full_mm = float(np.sqrt(scene.mesh.face_area_mm2.sum() / max(texels, 1e-12)))
    coarser = max(1, min(round(TEXEL_MM / max(full_mm, 1e-6)), min(size) // SMALLEST))
    return max(1, -(-size[0] // coarser)), max(1, -(-size[1] // coarser))


def open_sky(spec: SceneSpec, scene: SceneData, size: tuple[int, int], directions: int = DIRECTIONS) -> OpenSky:
    """Trace rays from every texel to the directions above its horizon.

    Parameters
    ----------
    spec : SceneSpec
        `shadows: false` leaves everything open.
    scene : SceneData
    size : (width, height)
        Of the small atlas.
    directions : int
    """
    texture = spec.texture
    atlas = coarser_atlas(scene.mesh, texture.size, texture.gutter, texture.udim, size)
    towards = all_around(directions).astype(np.float32)
    towards = towards[near_together(towards)]
    rows, origins, normals, shares = {}, {}, {}, {}
    for raster in atlas:
        surface = texel_surface(raster, scene.mesh, scene.maps, spec.specular, scene.occluder)
        texels = np.flatnonzero(raster.addressed)
        row = np.full(raster.shape, -1, np.int32)
        row.reshape(-1)[texels] = np.arange(len(texels), dtype=np.int32)
        origin, normal = surface.origins(texels), surface.smooth_normal.reshape(-1, 3)[texels]
        occluder = scene.occluder if spec.shadows else None
        rows[raster.tile], origins[raster.tile], normals[raster.tile] = row, origin, normal
        shares[raster.tile] = _shares(raster, surface.smooth_normal, origin, towards, occluder)
    return OpenSky(atlas, towards, origins, normals, rows, shares, spec.shadows)


def near_together(towards: Image) -> NDArray[np.int64]:
    """Order of unit directions (D, 3) in which those that follow each other are near: by an octree's cells."""
    cell = np.minimum(((towards + 1) * 2 ** (_CELLS_BITS - 1)).astype(np.int64), 2**_CELLS_BITS - 1)
    place = sum((cell[:, axis] >> bit & 1) << (3 * bit + axis) for bit in range(_CELLS_BITS) for axis in range(3))
    return np.argsort(place, kind="stable")


def _shares(
    raster: AtlasRaster, smooth_normal: Image, origin: Image, towards: Image, occluder: Occluder | None
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
    """
    texels, coarsest = np.flatnonzero(raster.addressed), lattice(raster)
    row, col = np.divmod(texels, raster.shape[1])
    normal = smooth_normal.reshape(-1, 3)[texels]
    settled = SettledRays(raster.addressed, smooth_normal, coarsest, len(towards))
    share, undone, stride = np.empty((len(texels), len(towards)), np.uint8), np.ones(len(texels), np.bool_), coarsest
    while stride:
        these = np.flatnonzero(undone & (row % stride == 0) & (col % stride == 0))
        answers = settled.of(texels[these], stride)
        share[these] = _traced(origin[these], normal[these], towards, occluder, answers)
        undone[these] = False
        if stride > 1:
            settled.keep(texels[these], answers)
        stride //= 2
    return share


def _traced(
    origin: Image, normal: Image, towards: Image, occluder: Occluder | None, answers: Answers
) -> NDArray[np.uint8]:
    """Shares of points (n, 3) by direction, (n, D).

    Parameters
    ----------
    origin, normal : ndarrays of shape (n, 3)
    towards : ndarray of shape (D, 3)
    occluder : Occluder, optional
    answers : ndarray of shape (n, 2, words), changed in place
        What is known; completed.
    """
    columns = np.ascontiguousarray(towards.T)
    share = np.empty((len(origin), len(towards)), np.uint8)

    def trace(part: slice) -> None:
        starts, rays = (np.empty((len(share[part]) * len(towards), 3), np.float32) for _ in range(2))
        count = aim(origin[part], normal[part], columns, answers[part], starts, rays)
        clear = np.ones(count, np.float32)
        if occluder is not None:
            reach = np.full(count, np.inf, np.float32)
            clear = occluder.unhindered(starts[:count], rays[:count], reach).astype(np.float32)
        _keep(clear, normal[part], columns, answers[part], share[part])

    for_slices(trace, len(origin), max(1, RAYS // len(towards)))
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


@kernel
def _keep(clear: Image, normal: Image, columns: Image, answers: Answers, share: NDArray[np.uint8]) -> None:
    """Write the shares, by `aim`'s rays and what was known, and each texel's cosine-weighted mean below its horizon.

    Parameters
    ----------
    clear : ndarray of shape (rays,)
    normal : ndarray of shape (n, 3)
    columns : ndarray of shape (3, D)
    answers : ndarray of shape (n, 2, words)
        Completed; what a ray passes in part is neither open nor blocked.
    share : ndarray of shape (n, D)
        Written.
    """
    ray = 0
    for i in range(len(normal)):
        seen, whole = 0.0, 0.0
        for d in range(columns.shape[1]):
            cosine = normal[i, 0] * columns[0, d] + normal[i, 1] * columns[1, d] + normal[i, 2] * columns[2, d]
            if cosine > 0.0:
                if has_bit(answers[i, 0], d):
                    passed = np.float32(1)
                elif has_bit(answers[i, 1], d):
                    passed = np.float32(0)
                else:
                    passed = clear[ray]
                    ray += 1
                    if passed == 0.0 or passed == 1.0:
                        set_bit(answers[i, 0 if passed > 0.0 else 1], d)
                share[i, d] = np.uint8(255.0 * passed + 0.5)
                seen += cosine * passed
                whole += cosine
        mean = np.uint8(255.0 * seen / whole + 0.5) if whole > 0.0 else np.uint8(0)
        for d in range(columns.shape[1]):
            cosine = normal[i, 0] * columns[0, d] + normal[i, 1] * columns[1, d] + normal[i, 2] * columns[2, d]
            if not cosine > 0.0:
                share[i, d] = mean
