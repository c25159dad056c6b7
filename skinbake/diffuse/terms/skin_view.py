"""What texels see of the skin: rays over the hemisphere, traced once for every light (theory.md 9.7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, coarser_atlas, coarser_size
from skinbake.diffuse.terms.neighbours import (
    mean_about,
    mean_of_rays,
    neighbour_weights,
    numbers,
    rays_shared,
    reach_of_rays,
)
from skinbake.diffuse.terms.ray_counts import ray_counts
from skinbake.diffuse.terms.skin_hits import NOTHING, TexturedSkin
from skinbake.irradiance.surface import places_of_texels
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
Index = NDArray[np.int64]
RECEIVER_MM = 2.0  # texels that receive bounced light
RAYS = 64  # from each of those
FINE = 0.65  # of the width asked for, below which texels take more neighbours

_PILOT_RAYS, _PILOT_APART = 16, 2  # rays that ask how much skin there is, and texels along a side that ask once
_PILOT_TURN = 7919  # so that they know nothing of the others
_SCATTERED = 2654435761
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
        Place in the atlas of each texel that looks around, in its order.
    flat_index : ndarray of shape (n,), int64
        row * w + col of each.
    rays : ndarray of shape (n,), int64
        How many each sends.
    first : ndarray of shape (n + 1,), int64
        Where in `seen` its rays begin that meet skin.
    half : ndarray of shape (n,), int64
        Where those of the second half of its rays do.
    seen : ndarray of shape (k,), int32
        Which texel of `met` each ray meets that meets skin.
    weight : ndarray of shape (n, across^2), uint8, optional
        Of its neighbours, where light is the mean with them.
    met : tuple of ndarray of shape (m,), int64
        row * W + col in the full texture of the texels that any ray meets, a tile in the atlas's order; they are
        numbered one tile after the other.
    size : (H, W)
        Of the full texture.
    skin : (point, normal), optional
        Of the texels, (n, 3), where light is the mean over rays of those about them that meet little skin.
    """

    atlas: Atlas
    tile: NDArray[np.int32]
    flat_index: Index
    rays: Index
    first: Index
    half: Index
    seen: NDArray[np.int32]
    weight: NDArray[np.uint8] | None
    met: tuple[Index, ...]
    size: tuple[int, int]
    skin: tuple[Image, Image] | None = None

    @property
    def share(self) -> Image:
        """Share of each texel's rays that meets skin, (n,)."""
        return np.divide(np.diff(self.first), self.rays, dtype=np.float32)

    def met_in(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[Index, Index]]:
        """Rows and columns of the texels that are met in textures of other sizes."""
        height, width = self.size
        return [
            (flat // width * shape[0] // height, flat % width * shape[1] // width)
            for flat, shape in zip(self.met, shapes, strict=True)
        ]

    def receiver(self) -> Index:
        """Which receiving texel each texel lies in that is met, -1 where that receives nothing, (m,)."""
        shapes = [raster.shape for raster in self.atlas]
        at = self.met_in(shapes)
        return np.concatenate([self._numbers(k)[at[k]] for k in range(len(shapes))]).astype(np.int64)

    @cached_property
    def seen_again(self) -> NDArray[np.int32]:
        """Which receiving texel each ray meets, -1 where what it meets receives nothing, (k,): for further bounces."""
        found: NDArray[np.int32] = self.receiver().astype(np.int32)[self.seen]
        return found

    def quieter(self, values: Image) -> Image:
        """Values of the texels, (n, v), each the mean with its neighbours, or with the rays of as many as it needs."""
        if not len(values):
            return values
        out = []
        for k, raster in enumerate(self.atlas):
            mine = slice(*np.searchsorted(self.tile, [k, k + 1]))
            flat = self.flat_index[mine]
            if self.weight is not None:
                out.append(mean_about(values[mine], self.weight[mine], numbers(raster.shape, flat), flat))
            elif self.skin is not None:
                skin = self.skin[0][mine], self.skin[1][mine]
                out.append(mean_of_rays(values[mine], self.rays[mine], self._reach[mine], skin, raster, flat))
        return np.concatenate(out) if out else values

    @cached_property
    def _reach(self) -> NDArray[np.uint8]:
        """How far about each texel rays are taken along, (n,)."""
        met, found = np.diff(self.first), []
        for k, raster in enumerate(self.atlas):
            mine = slice(*np.searchsorted(self.tile, [k, k + 1]))
            found.append(reach_of_rays(raster.shape, self.flat_index[mine], met[mine]))
        return np.concatenate(found)

    def _numbers(self, k: int) -> NDArray[np.int32]:
        """Number of the texel at each place of a tile, (h, w)."""
        start, stop = np.searchsorted(self.tile, [k, k + 1])
        return numbers(self.atlas[k].shape, self.flat_index[start:stop], int(start))


def look_around(
    full: TexturedSkin,
    gutter: int,
    receiver_mm: float = RECEIVER_MM,
    rays: float = RAYS,
    with_neighbours: bool = False,
) -> SkinView:
    """Trace rays from the texels of a texture whose texels are about `receiver_mm` wide.

    Parameters
    ----------
    full : TexturedSkin
        The full texture, whose texels are met.
    gutter : int
        In its texels.
    receiver_mm : float
    rays : float
        The noise is that of so many from every texel. Who sends more of them, and who fewer, a few rays say that count
        for nothing else: else a texel would send many where it happens to have met skin, and the mean be too small.
    with_neighbours : bool
        Whether light will be the mean with the neighbours, which share a sequence of directions then: of 5 x 5 where
        texels are much finer than asked for.
    """
    mesh, occluder, size, udim = full
    atlas = coarser_atlas(mesh, size, gutter, udim, coarser_size(mesh, size, receiver_mm))
    flats, points, seen_shares, weights = [], [], [], []
    across = 1
    if with_neighbours:
        across = 5 if _width_mm(atlas) < FINE * receiver_mm else 3
    for raster in atlas:
        rows, cols = np.nonzero(raster.addressed)
        flats.append(rows * raster.shape[1] + cols)
        points.append(places_of_texels(raster, flats[-1], mesh, occluder))
        seen_shares.append(_seen_about(full, raster, points[-1], flats[-1]))
        if with_neighbours:
            weights.append(neighbour_weights(across, raster, *points[-1], flats[-1]))
    flat, tile = np.concatenate(flats), np.repeat(np.arange(len(atlas), dtype=np.int32), [len(of) for of in flats])
    point, normal = (np.concatenate(each) for each in zip(*points, strict=True))
    weight = np.concatenate(weights) if with_neighbours else None
    area = np.concatenate([r.area_mm2.reshape(-1)[of] for r, of in zip(atlas, flats, strict=True)]).astype(np.float64)
    area = np.maximum(area, 0.25 * area.mean() if len(area) else 0.0)  # gutters are read along with what they surround
    shared = np.ones(len(flat)) if weight is None else rays_shared(weight)
    count = ray_counts(area, np.concatenate(seen_shares), shared, rays)
    begin, turn = np.zeros_like(flat), flat
    if with_neighbours:
        # Of a block of texels each has its own part of one sequence, so that together they have the whole of it; blocks
        # are turned as if by chance: one sequence for all leaves the same error everywhere
        width = np.array([raster.shape[1] for raster in atlas])[tile]
        row, col = flat // width, flat % width
        begin = (row % across * across + col % across) * count
        turn = (row // across * width + col // across) * _SCATTERED % (1 << 31)

    met_skin, in_first_half = np.zeros((2, len(flat)), np.int64)
    parts = []
    for each in np.unique(count):
        of_count = np.flatnonzero(count == each)
        at_once = max(1, _RAYS_AT_ONCE // int(each))
        for some in (of_count[k : k + at_once] for k in range(0, len(of_count), at_once)):
            starts = RayStarts(point[some], normal[some], turn[some], begin[some])
            seen_tile, seen = trace_cosine(full, starts, int(each))
            hit = seen != NOTHING
            met_skin[some] = hit.sum(axis=1)
            in_first_half[some] = hit[:, : each // 2].sum(axis=1)
            place = seen_tile[hit].astype(np.int64) * (size[0] * size[1])
            parts.append((some, place + seen[hit]))
    skin = None if with_neighbours else (point, normal)
    return numbered(atlas, tile, flat, count, met_skin, in_first_half, parts, size, weight, skin)


def _width_mm(atlas: Atlas) -> float:
    """Width of half of the texels at most, mm."""
    area = np.concatenate([raster.area_mm2[raster.area_mm2 > 0] for raster in atlas])
    return float(np.sqrt(np.median(area))) if len(area) else 0.0


def numbered(
    atlas: Atlas,
    tile: NDArray[np.int32],
    flat: Index,
    count: Index,
    met_skin: Index,
    in_first_half: Index,
    parts: Sequence[tuple[Index, Index]],
    size: tuple[int, int],
    weight: NDArray[np.uint8] | None,
    skin: tuple[Image, Image] | None,
) -> SkinView:
    """The view, in the order of its texels.

    Parameters
    ----------
    atlas : Atlas
    tile, flat, count, weight, skin
        As of `SkinView`.
    met_skin, in_first_half : ndarrays of shape (n,)
        How many rays of each texel meet skin; of the first half of them.
    parts : sequence of tuples
        Some texels, and the place in the whole atlas of the skin that each of their rays meets, ray by ray.
    size : (width, height)
        Of the full texture.
    """
    texels = size[0] * size[1]
    first = np.concatenate([[0], np.cumsum(met_skin)])
    among = np.zeros(len(atlas) * texels, np.bool_)
    for _, place in parts:
        among[place] = True
    number = np.cumsum(among, dtype=np.int32) - 1
    seen = np.empty(first[-1], np.int32)
    for some, place in parts:
        many = met_skin[some]
        begins = np.cumsum(many) - many
        seen[np.arange(len(place)) + np.repeat(first[some] - begins, many)] = number[place]
    met = tuple(np.flatnonzero(of_tile) for of_tile in among.reshape(len(atlas), texels))
    return SkinView(atlas, tile, flat, count, first, first[:-1] + in_first_half, seen, weight, met, size[::-1], skin)


def _seen_about(
    full: TexturedSkin, raster: AtlasRaster, points: tuple[Image, Image], flat: Index
) -> NDArray[np.float64]:
    """About which share of each texel's view is skin, between 0 and 1, by a few rays of a few texels about it, (n,).

    Parameters
    ----------
    full : TexturedSkin
    raster : AtlasRaster
    points : (point, normal)
        Of its addressed texels.
    flat : ndarray of shape (n,)
    """
    row, col = np.divmod(flat, raster.shape[1])
    ask = np.flatnonzero((row % _PILOT_APART == 0) & (col % _PILOT_APART == 0))
    starts = RayStarts(points[0][ask], points[1][ask], flat[ask] * _PILOT_TURN, np.zeros_like(ask))
    _, seen = trace_cosine(full, starts, _PILOT_RAYS)
    row, col = row // _PILOT_APART, col // _PILOT_APART
    skin, asked = np.zeros((2, row.max(initial=0) + 3, col.max(initial=0) + 3))
    skin[row[ask] + 1, col[ask] + 1] = (seen != NOTHING).sum(axis=1)
    asked[row[ask] + 1, col[ask] + 1] = _PILOT_RAYS
    skin, asked = (sum(each[dy : len(each) - 2 + dy] for dy in range(3)) for each in (skin, asked))
    skin, asked = (sum(each[:, dx : each.shape[1] - 2 + dx] for dx in range(3)) for each in (skin, asked))
    share: NDArray[np.float64] = ((skin + 0.5) / (asked + 1))[row, col]
    return share


def _blocks(rays: NDArray[np.int32]) -> Iterator[slice]:
    """Rows of an array (n, rays), some at a time."""
    at_once = max(1, _RAYS_AT_ONCE // max(rays.shape[1], 1))
    return (slice(start, start + at_once) for start in range(0, len(rays), at_once))


class RayStarts(NamedTuple):
    """Points of the skin from which rays start, cosine distributed about the normal.

    Attributes
    ----------
    point, normal : ndarrays of shape (n, 3), float32
    turn : ndarray of shape (n,), int64
        A number for each point, which turns its sequence of rays.
    first : ndarray of shape (n,), int64
        The first ray of the sequence that each takes.
    """

    point: Image
    normal: Image
    turn: Index
    first: Index


def trace_cosine(full: TexturedSkin, starts: RayStarts, count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tile's place in the atlas and texel of the full texture that each ray meets, both (n, count).

    Parameters
    ----------
    full : TexturedSkin
    starts : RayStarts
    count : int
        Rays of each point.
    """
    step = np.float32(0.01 + 32 * full.occluder.spacing_mm)
    tile, texel = np.empty((2, len(starts.point), count), np.int32)
    for part in _blocks(tile):  # a ray takes 24 bytes, what it meets 8
        some = RayStarts(starts.point[part], starts.normal[part], starts.turn[part], starts.first[part])
        origin = np.empty((len(some.point) * count, 3), np.float32)
        direction = np.empty_like(origin)
        parallel_for(_aim, len(some.point), some, _Sequence(count, step), origin, direction)
        met = full.met_by(origin, direction)
        tile[part], texel[part] = (each.reshape(-1, count) for each in met)
    return tile, texel


class _Sequence(NamedTuple):
    """Rays of each point's own sequence.

    Attributes
    ----------
    amount : int
        How many.
    step : float32
        Start above the skin, mm.
    """

    amount: int
    step: np.float32


@kernel
def _aim(start, stop, points, sequence, origin, direction):  # type: ignore[no-untyped-def]
    """Write cosine-distributed rays of each point's own sequence.

    Parameters
    ----------
    start, stop : int
        Points.
    points : RayStarts
    sequence : _Sequence
    origin, direction : ndarrays of shape (n * amount, 3), written
    """
    point, normal, turn, first = points.point, points.normal, points.turn, points.first
    count, step = sequence.amount, sequence.step
    for i in range(start, stop):
        nx, ny, nz = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
        sign = 1.0 if nz >= 0.0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        # Neighbouring texels look at other places of the pattern
        turn_0, turn_1 = turn[i] * 0.6180339887498949 % 1.0, turn[i] * 0.41421356237309515 % 1.0
        for k in range(count):
            u, v = (turn_0 + (first[i] + k) * _R2[0]) % 1.0, (turn_1 + (first[i] + k) * _R2[1]) % 1.0
            r, angle = np.sqrt(u), 2.0 * np.pi * v
            p, q, up = r * np.cos(angle), r * np.sin(angle), np.sqrt(1.0 - u)
            at = i * count + k
            direction[at, 0] = p * (1.0 + sign * nx * nx * a) + q * b + up * nx
            direction[at, 1] = p * sign * b + q * (sign + ny * ny * a) + up * ny
            direction[at, 2] = p * -sign * nx + q * -ny + up * nz
            for axis in range(3):
                origin[at, axis] = point[i, axis] + step * normal[i, axis]
