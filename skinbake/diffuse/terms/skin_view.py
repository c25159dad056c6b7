"""What texels see of the skin: rays over the hemisphere, traced once for every light (theory.md 9.7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, coarser_atlas, coarser_size
from skinbake.diffuse.terms.skin_hits import NOTHING, locate_hits, skin_points
from skinbake.irradiance.occluder import Occluder
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
RECEIVER_MM = 2.0  # texels that receive bounced light
LOOKING, MORE = 32, 64  # rays that look whether there is skin at all; rays where there is

_RAYS_AT_ONCE = 1 << 20
_R2 = 0.7548776662466927, 0.5698402909980532  # [Roberts2018]


@dataclass(frozen=True)
class SkinView:
    """What texels of a small atlas see of the skin.

    Attributes
    ----------
    atlas : Atlas
        The small one.
    tile : ndarray of shape (n,), int32
        Place in the atlas of each texel that sees skin.
    flat_index : ndarray of shape (n,), int64
        row * w + col of each.
    seen : ndarray of shape (n, rays), int32
        Which texel of `met` each ray meets, NOTHING where it meets no skin.
    met : tuple of ndarray of shape (m,), int64
        row * W + col in the full texture of the texels that any ray meets, a tile in the atlas's order; they are
        numbered one tile after the other.
    size : (H, W)
        Of the full texture.
    """

    atlas: Atlas
    tile: NDArray[np.int32]
    flat_index: Index
    seen: NDArray[np.int32]
    met: tuple[Index, ...]
    size: tuple[int, int]

    def read(self, images: Sequence[Image]) -> Image:
        """Values at the texels that are met, (m, L, 3), of images (L, h, w, 3) of any size, a tile each."""
        return np.concatenate(
            [
                image[:, rows, cols].transpose(1, 0, 2)
                for image, (rows, cols) in zip(images, self._at([each.shape[1:3] for each in images]), strict=True)
            ],
            dtype=np.float32,
        )

    def receiver(self) -> Index:
        """Which receiving texel each texel lies in that is met, -1 where that receives nothing, (m,)."""
        number, found = np.arange(len(self.tile)), []
        shapes = [raster.shape for raster in self.atlas]
        for k, (rows, cols) in enumerate(self._at(shapes)):
            of_texel = np.full(shapes[k], -1)
            mine = self.tile == k
            of_texel.reshape(-1)[self.flat_index[mine]] = number[mine]
            found.append(of_texel[rows, cols])
        return np.concatenate(found)

    def _at(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[Index, Index]]:
        """Rows and columns of the texels that are met in textures of other sizes."""
        height, width = self.size
        return [
            (flat // width * shape[0] // height, flat % width * shape[1] // width)
            for flat, shape in zip(self.met, shapes, strict=True)
        ]


def look_around(
    mesh: SkinMesh,
    occluder: Occluder,
    size: tuple[int, int],
    gutter: int,
    udim: bool,
    receiver_mm: float = RECEIVER_MM,
    rays: tuple[int, int] = (LOOKING, MORE),
) -> SkinView:
    """Trace rays from the texels of a texture whose texels are about `receiver_mm` wide.

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
        The mesh's.
    size : (width, height)
        Of the full texture.
    gutter : int
        In its texels.
    udim : bool
    receiver_mm : float
    rays : (int, int)
        From every texel; from those of which one of these meets skin.
    """
    atlas = coarser_atlas(mesh, size, gutter, udim, coarser_size(mesh, size, receiver_mm))
    parts = []
    for k, raster in enumerate(atlas):
        rows, cols = np.nonzero(raster.addressed)
        flat = rows * raster.shape[1] + cols
        point, normal = skin_points(raster, mesh, occluder, rows, cols)
        first = trace_cosine(mesh, occluder, size, udim, point, normal, flat, 0, rays[0])
        near = np.flatnonzero((first[1] != NOTHING).any(axis=1))
        more = trace_cosine(
            mesh, occluder, size, udim, point[near], normal[near], flat[near], rays[0], rays[1] - rays[0]
        )
        seen_tile, seen = (np.concatenate([a[near], b], axis=1) for a, b in zip(first, more, strict=True))
        del first, more  # of fine texels and many rays a gigabyte
        parts.append((np.full(len(near), k, np.int32), flat[near], seen_tile, seen))
        del seen_tile, seen
    texels = size[0] * size[1]
    among = np.zeros(len(atlas) * texels, np.bool_)
    for _, _, seen_tile, seen in parts:
        for _, _, place in _hits(seen_tile, seen, texels):
            among[place] = True
    number = np.cumsum(among, dtype=np.int32) - 1
    for _, _, seen_tile, seen in parts:
        for some, hit, place in _hits(seen_tile, seen, texels):
            some[hit] = number[place]
    met = tuple(np.flatnonzero(of_tile) for of_tile in among.reshape(len(atlas), texels))
    tile, texel = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    seen = parts[0][3] if len(parts) == 1 else np.concatenate([part[3] for part in parts])
    return SkinView(atlas, tile, texel, seen, met, size[::-1])


def _hits(
    seen_tile: NDArray[np.int32], seen: NDArray[np.int32], texels: int
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.bool_], Index]]:
    """Some rows of `seen` at a time, which of their rays meet skin, and the place in the whole atlas that those meet.

    Parameters
    ----------
    seen_tile, seen : ndarrays of shape (n, rays)
        Tile's place in the atlas and texel of it.
    texels : int
        Of a tile.
    """
    for block in _blocks(seen):
        some = seen[block]
        hit = some != NOTHING
        yield some, hit, seen_tile[block][hit].astype(np.int64) * texels + some[hit]


def _blocks(rays: NDArray[np.int32]) -> Iterator[slice]:
    """Rows of an array (n, rays), some at a time."""
    at_once = max(1, _RAYS_AT_ONCE // max(rays.shape[1], 1))
    return (slice(start, start + at_once) for start in range(0, len(rays), at_once))


def trace_cosine(
    mesh: SkinMesh,
    occluder: Occluder,
    size: tuple[int, int],
    udim: bool,
    point: Image,
    normal: Image,
    flat: Index,
    first: int,
    count: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tile's place in the atlas and texel of the full texture that each ray meets, both (n, count).

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
        The mesh's.
    size : (width, height)
        Of the full texture.
    udim : bool
    point, normal : ndarrays of shape (n, 3), float32
        From where rays start, cosine distributed about the normal.
    flat : ndarray of shape (n,), int64
        Number of each point, which turns its sequence of rays.
    first, count : int
        The first ray of the sequence, and how many.
    """
    step = np.float32(0.01 + 32 * occluder.spacing_mm)
    tile, texel = np.empty((2, len(point), count), np.int32)
    for part in _blocks(tile):  # a ray takes 24 bytes, what it meets 8
        points = _Points(point[part], normal[part], flat[part])
        origin = np.empty((len(points.point) * count, 3), np.float32)
        direction = np.empty_like(origin)
        parallel_for(_aim, len(points.point), points, _Sequence(first, count, step), origin, direction)
        met = locate_hits(mesh, occluder, size, udim, origin, direction)
        tile[part], texel[part] = (each.reshape(-1, count) for each in met)
    return tile, texel


class _Points(NamedTuple):
    """Points of the skin from which rays start.

    Attributes
    ----------
    point, normal : ndarrays of shape (n, 3), float32
    flat : ndarray of shape (n,), int64
        Number of the texel, which turns its sequence of rays.
    """

    point: Image
    normal: Image
    flat: Index


class _Sequence(NamedTuple):
    """Rays of each point's own sequence.

    Attributes
    ----------
    first, amount : int
        The first one, and how many.
    step : float32
        Start above the skin, mm.
    """

    first: int
    amount: int
    step: np.float32


@kernel
def _aim(start, stop, points, sequence, origin, direction):  # type: ignore[no-untyped-def]
    """Write cosine-distributed rays of each point's own sequence.

    Parameters
    ----------
    start, stop : int
        Points.
    points : _Points
    sequence : _Sequence
    origin, direction : ndarrays of shape (n * amount, 3), written
    """
    point, normal, flat = points.point, points.normal, points.flat
    first, count, step = sequence.first, sequence.amount, sequence.step
    for i in range(start, stop):
        nx, ny, nz = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
        sign = 1.0 if nz >= 0.0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        # Neighbouring texels look at other places of the pattern
        turn_0, turn_1 = flat[i] * 0.6180339887498949 % 1.0, flat[i] * 0.41421356237309515 % 1.0
        for k in range(count):
            u, v = (turn_0 + (first + k) * _R2[0]) % 1.0, (turn_1 + (first + k) * _R2[1]) % 1.0
            r, angle = np.sqrt(u), 2.0 * np.pi * v
            p, q, up = r * np.cos(angle), r * np.sin(angle), np.sqrt(1.0 - u)
            at = i * count + k
            direction[at, 0] = p * (1.0 + sign * nx * nx * a) + q * b + up * nx
            direction[at, 1] = p * sign * b + q * (sign + ny * ny * a) + up * ny
            direction[at, 2] = p * -sign * nx + q * -ny + up * nz
            for axis in range(3):
                origin[at, axis] = point[i, axis] + step * normal[i, axis]
