"""Skin that lights skin: nostrils, eye sockets, lips, behind the ear.

What leaves a point of the skin falls on what faces it. Rays from every texel of a smaller texture, cosine distributed
over the hemisphere, say which other texels it sees: that is found once and serves every light. The irradiance of skin
is then the mean of what the texels that were hit send back, M; rays that meet no skin bring nothing (theory.md 9.7).
Bounced light is smooth, so that few and coarse texels are enough, read bilinearly at the full size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, coarser_atlas, coarser_size
from skinbake.atlas.raster import NO_FACE
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.terms.skin_hits import NOTHING, locate_hits, skin_points
from skinbake.irradiance.occluder import Occluder
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.scene.decision import Decision
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
RECEIVER_MM = 2.0  # texels that receive bounced light
RECEIVERS_ACROSS = 190  # of them at least across what is smaller than a head: its forms are smaller, too
LOOKING, MORE = 32, 64  # rays that look whether there is skin at all; rays where there is
MOST_RAYS = 512
COARSE_ERROR = 0.1  # of the bounced light: what such texels and rays leave wrong; 0.09 on a head, 0.2 about a hill
COARSENESS = 0.4, 3.0  # the finest and the coarsest there are, in units of these
ESTIMATED, ESTIMATE_RAYS = 4000, 16  # texels and rays by which `auto` decides
NOISE_FALL = 0.85  # exponent by which rays on a lattice lose their noise, on a head and about a hill
_OTHER_TURN = 7919
_ALL = np.ones(3, np.float32)
_SLOWEST = 0.95  # most that a bounce is believed to keep of the last one: the rest of the series is finite

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
        first = _trace(mesh, occluder, size, udim, point, normal, flat, 0, rays[0])
        near = np.flatnonzero((first[1] != NOTHING).any(axis=1))
        more = _trace(mesh, occluder, size, udim, point[near], normal[near], flat[near], rays[0], rays[1] - rays[0])
        seen_tile, seen = (np.concatenate([a[near], b], axis=1) for a, b in zip(first, more, strict=True))
        parts.append((np.full(len(near), k, np.int32), flat[near], seen_tile, seen))
    tile, texel, seen_tile, seen = (np.concatenate(each) for each in zip(*parts, strict=True))
    texels = size[0] * size[1]
    hit = seen != NOTHING
    place = seen_tile[hit].astype(np.int64) * texels + seen[hit]
    among = np.zeros(len(atlas) * texels, np.bool_)
    among[place] = True
    seen[hit] = (np.cumsum(among, dtype=np.int32) - 1)[place]
    met = tuple(np.flatnonzero(of_tile) for of_tile in among.reshape(len(atlas), texels))
    return SkinView(atlas, tile, texel, seen, met, size[::-1])


class Bounced(NamedTuple):
    """What skin sends on of a light, found with few rays.

    Attributes
    ----------
    rms : float
        As a share of the light's rms.
    noise : float
        Standard error of it for `ESTIMATE_RAYS` / 2 rays a texel, a share of the same.
    """

    rms: float
    noise: float

    def rays_for(self, limit: float) -> float:
        """How many rays a texel leave an error of `limit`."""
        return ESTIMATE_RAYS / 2 * (self.noise / max(limit, 1e-12)) ** (1 / NOISE_FALL)

    def noise_of(self, rays: int) -> float:
        """Error that is left by that many rays."""
        return self.noise * (ESTIMATE_RAYS / 2 / rays) ** NOISE_FALL


class Receivers(NamedTuple):
    """How finely light from skin is taken.

    Attributes
    ----------
    coarser : float
        Texels are this times as wide as the usual ones, and have as many times fewer rays.
    usual_mm : float
        Width of those.
    least_rays : int
        From texels that see skin, however coarse they are.
    """

    coarser: float
    usual_mm: float = RECEIVER_MM
    least_rays: int = 32

    @property
    def width_mm(self) -> float:
        """Width of the texels that receive, mm."""
        return self.usual_mm * self.coarser

    @property
    def rays(self) -> tuple[int, int]:
        """Rays from every texel, and from those that see skin (`look_around`).

        Half as many look as are traced: what few see none of sends light, too.
        """
        looking = max(16, round(LOOKING / self.coarser), self.least_rays // 2)
        return looking, max(self.least_rays, round(MORE / self.coarser))

    def error(self, bounced: Bounced) -> float:
        """Rms that is left wrong of a light, as a share of it."""
        return max(COARSE_ERROR * self.coarser * bounced.rms, bounced.noise_of(self.rays[1]))


def receivers(bounced: Sequence[Bounced], limits: Sequence[float], atlas: Atlas) -> Receivers:
    """The coarsest texels that receive, whose error no light's limit forbids.

    Parameters
    ----------
    bounced : sequence of Bounced
        Light from skin, of each light that has the term.
    limits : sequence of float
        Rms that may be made, of each.
    atlas : Atlas
        Its area says how small the skin's forms are.
    """
    across_mm = float(np.sqrt(sum(raster.area_mm2.sum(dtype=np.float64) for raster in atlas)))
    pairs = list(zip(bounced, limits, strict=True))
    allowed = min(limit / max(COARSE_ERROR * each.rms, 1e-12) for each, limit in pairs)
    rays = min(max(each.rays_for(limit) for each, limit in pairs), MOST_RAYS)
    usual_mm = min(RECEIVER_MM, across_mm / RECEIVERS_ACROSS)
    return Receivers(float(np.clip(allowed, *COARSENESS)), usual_mm, max(32, round(rays)))


class BouncedLight(NamedTuple):
    """Light that skin gets from skin.

    Attributes
    ----------
    tiles : list of ndarray of shape (L, h, w, 3), float32
        Irradiance at the small texels, a tile in the atlas's order.
    bounces : int
        How often it went from skin to skin.
    left : float
        Rms of all bounces after these, as a share of the first one's, of the light that leaves most.
    """

    tiles: list[Image]
    bounces: int
    left: float


def bounced_light(
    view: SkinView, sent: Sequence[Image], reflected: Sequence[Image], bounces: int = 1, negligible: float = 0.0
) -> BouncedLight:
    """Irradiance that skin gets from skin, bounce after bounce until the rest is negligible.

    Parameters
    ----------
    view : SkinView
    sent : sequence of ndarray of shape (L, H, W, 3)
        M of each tile, of the light that arrives without a bounce, at any size.
    reflected : sequence of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of the bounced irradiance leaves as M again.
    bounces : int
        At most as many, 1 or more.
    negligible : float
        Rms of all bounces to come, as a share of the first one's, below which they are left out. The next bounce is
        foreseen as this one times what leaves again and the share of rays that meet skin; those after it follow as a
        geometric series.

    Raises
    ------
    ValueError
        If `bounces` is below 1.
    """
    if bounces < 1:
        raise ValueError(f"bounces: expected at least 1, got {bounces}")
    lights, shapes = sent[0].shape[0], [raster.shape for raster in view.atlas]
    again = np.empty((len(view.tile), 1, 3), np.float32)
    for k, (colour, shape) in enumerate(zip(reflected, shapes, strict=True)):
        mine = view.tile == k
        small = np.broadcast_to(fitted(colour, shape), (*shape, 3)).reshape(-1, 3)
        again[mine, 0] = small[view.flat_index[mine]]
    share = (view.seen != NOTHING).mean(axis=1, dtype=np.float32)[:, None, None] if view.seen.size else 0
    source, lies_in = view.read(sent), view.receiver()
    out = np.zeros((len(view.tile), lights, 3), np.float32)
    first, left = np.zeros(lights), np.ones(lights)
    for turn in range(bounces):
        got = np.zeros_like(out)
        values = source.reshape(len(source), 3 * lights)
        parallel_for(_collect, len(got), view.seen, values, got.reshape(len(got), 3 * lights))
        out += got
        sent_again = got * again
        now, then = _rms(got), _rms(sent_again * share)
        first = first if turn else now
        falls = np.minimum(then / np.maximum(now, 1e-30), _SLOWEST)
        left = np.where(first > 0, now * falls / (1 - falls) / np.maximum(first, 1e-30), 0)
        if left.max() <= negligible:
            break
        source = np.where(lies_in[:, None, None] >= 0, sent_again[lies_in], 0) if len(got) else source
    tiles = [np.zeros((lights, *shape, 3), np.float32) for shape in shapes]
    for k, tile in enumerate(tiles):
        mine = view.tile == k
        tile.reshape(lights, -1, 3)[:, view.flat_index[mine]] = out[mine].transpose(1, 0, 2)
    return BouncedLight(tiles, turn + 1, float(left.max()))


class SkinLight(NamedTuple):
    """How skin lights skin under the lights that have the term.

    Attributes
    ----------
    view : SkinView
    reflected : list of ndarray of shape (h, w, 3)
        What of irradiance leaves as M, at the small texels, a tile in the atlas's order.
    gain : mapping of str to ndarray of shape (3,)
        By light, what of light from skin counts where it enters.
    bounces : mapping of str to int
        By light, how often it goes from skin to skin.
    """

    view: SkinView
    reflected: list[Image]
    gain: Mapping[str, Image]
    bounces: Mapping[str, int]

    def lit_by(self, name: str, sent: Sequence[Image]) -> list[Image]:
        """Irradiance that counts of what skin sends on, (h, w, 3) a tile.

        Parameters
        ----------
        name : str
            Of the light.
        sent : sequence of ndarray of shape (H, W, 3)
            M by tile, at any size.
        """
        again = [self.gain[name] * colour for colour in self.reflected]
        found = bounced_light(self.view, [each[None] for each in sent], again, self.bounces[name])
        return [self.gain[name] * tile[0] for tile in found.tiles]


def _rms(values: Image) -> NDArray[np.float64]:
    """Root of the sum of squares of each light, (L,), of (n, L, 3)."""
    root: NDArray[np.float64] = np.sqrt(np.einsum("nlc,nlc->l", values, values, dtype=np.float64))
    return root


def decide_interreflection(
    mesh: SkinMesh,
    occluder: Occluder,
    names: Sequence[str],
    light: Sequence[Image],
    reflected: Sequence[Image],
    atlas: Atlas,
    udim: bool,
    switch: str,
    limits: Sequence[float],
    gain: Image = _ALL,
) -> tuple[list[Decision], list[Bounced]]:
    """Whether skin lights skin by more than may be left out, a line a light, and how much that is.

    `auto` looks from a few texels with a few rays, the same for all lights.

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
    names : sequence of L str
        Of the lights.
    light : sequence of ndarray of shape (L, H, W, 3)
        Irradiance, by tile.
    reflected : sequence of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of it leaves.
    atlas : Atlas
        The full one.
    udim : bool
    switch : "auto", "on" or "off"
    limits : sequence of L float
        What may be left out of each light.
    gain : ndarray of shape (3,), float32
        What of that enters where it falls on skin.
    """
    if switch == "off":
        return [Decision("interreflection", False, "off")], []
    arrived, bounced, apart = np.zeros((3, len(names)))
    height, width = atlas[0].shape
    for number, (raster, image) in enumerate(zip(atlas, light, strict=True)):
        area = np.cumsum(raster.area_mm2.ravel(), dtype=np.float64)
        if area[-1] <= 0:
            continue
        places = (np.arange(ESTIMATED) + 0.5) / ESTIMATED * area[-1]
        flat = np.minimum(np.searchsorted(area, places), len(area) - 1)
        rows, cols = np.divmod(flat, width)
        point, normal = skin_points(raster, mesh, occluder, rows, cols)
        # Two halves that know nothing of each other: the second one's rays are turned otherwise
        halves = [
            _trace(mesh, occluder, (width, height), udim, point, normal, flat * turn, 0, ESTIMATE_RAYS // 2)
            for turn in (1, _OTHER_TURN)
        ]
        seen_tile, seen = (np.concatenate(each, axis=1) for each in zip(*halves, strict=True))
        got = np.zeros((len(names), len(flat), 2, 3))
        for k, (other, colour) in enumerate(zip(light, reflected, strict=True)):
            texel, ray = np.nonzero((seen != NOTHING) & (seen_tile == k))
            at = np.divmod(seen[texel, ray], width)
            sent = other[:, at[0], at[1]].astype(np.float64)
            sent *= np.broadcast_to(colour, (height, width, 3))[at] * gain
            for total, each in zip(got, sent, strict=True):
                np.add.at(total, (texel, ray // (ESTIMATE_RAYS // 2)), each * (2 / ESTIMATE_RAYS))
        # As it leaves again: what is red counts more where the skin is
        colour = (np.broadcast_to(reflected[number], (height, width, 3))[rows, cols] * gain).astype(np.float64)
        direct = image[:, rows, cols] * colour
        got *= colour[:, None]
        share = area[-1] / len(flat)
        arrived += share * (direct**2).sum(axis=(1, 2))
        # The product of two halves is, on average, the square without the rays' own noise
        bounced += share * (got[:, :, 0] * got[:, :, 1]).sum(axis=(1, 2))
        apart += share * ((got[:, :, 0] - got[:, :, 1]) ** 2).sum(axis=(1, 2)) / 2
    found, shares = [], []
    for name, lit, got_light, square, limit in zip(names, arrived, bounced, apart, limits, strict=True):
        rms, noise = (float(np.sqrt(max(each, 0) / lit)) if lit > 0 else 0.0 for each in (got_light, square))
        why = f"{switch}: skin lights skin with {rms:.2%} of its light (rms), may be left out {limit:.2%}"
        kept = switch == "on" or rms > limit
        found.append(Decision(f"{name}.interreflection", kept, why, 0.0 if kept else rms))
        shares.append(Bounced(rms, noise))
    return found, shares


def _trace(
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
    """Tile's place in the atlas and texel of the full texture that each ray meets, both (n, count)."""
    origin = np.empty((len(point) * count, 3), np.float32)
    direction = np.empty_like(origin)
    step = np.float32(0.01 + 32 * occluder.spacing_mm)
    points, sequence = _Points(point, normal, flat), _Sequence(first, count, step)
    parallel_for(_aim, len(point), points, sequence, origin, direction)
    tile, texel = np.empty((2, len(origin)), np.int32)
    for start in range(0, len(origin), 1 << 20):
        part = slice(start, start + (1 << 20))
        tile[part], texel[part] = locate_hits(mesh, occluder, size, udim, origin[part], direction[part])
    return tile.reshape(-1, count), texel.reshape(-1, count)


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


@kernel
def _collect(start, stop, seen, source, out):  # type: ignore[no-untyped-def]
    """The mean of what rays see.

    Parameters
    ----------
    start, stop : int
        Points.
    seen : ndarray of shape (n, rays)
        Row of `source` that each ray sees; below 0 where there is no skin.
    source : ndarray of shape (m, v)
    out : ndarray of shape (n, v), added to
    """
    rays = seen.shape[1]
    for i in range(start, stop):
        for k in range(rays):
            row = seen[i, k]
            if row >= 0:
                for v in range(source.shape[1]):
                    out[i, v] += source[row, v]
        for v in range(source.shape[1]):
            out[i, v] /= rays


def fitted(colour: Image, shape: tuple[int, ...]) -> Image:
    """A map at the middle texels of a smaller size, or of its own; a constant as it is."""
    height, width = colour.shape[:2]
    if (height, width) == (1, 1):
        return colour
    rows = (2 * np.arange(shape[0]) + 1) * height // (2 * shape[0])
    cols = (2 * np.arange(shape[1]) + 1) * width // (2 * shape[1])
    return colour[rows][:, cols]


def add_at_full_size(small: Image, raster: AtlasRaster, out: Image) -> None:
    """Add bounced light to the addressed texels of the full texture, read bilinearly.

    Parameters
    ----------
    small : ndarray of shape (h, w, 3)
    raster : AtlasRaster
        The full one.
    out : ndarray of shape (H, W, 3), float32, added to
    """
    parallel_for(_enlarge, raster.shape[0], small, raster.face_index, out)


@kernel
def _enlarge(start, stop, small, face_index, out):  # type: ignore[no-untyped-def]
    """Bilinear reading at the centres of larger texels, added to `out`.

    Parameters
    ----------
    start, stop : int
        Which rows.
    small : ndarray of shape (h, w, 3)
    face_index : ndarray of shape (H, W)
    out : ndarray of shape (H, W, 3)
    """
    h, w = small.shape[0], small.shape[1]
    height, width = face_index.shape
    for row in range(start, stop):
        for col in range(width):
            if face_index[row, col] == NO_FACE:
                continue
            around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, h, w)
            for c in range(3):
                out[row, col, c] += bilinear(small, c, around)
