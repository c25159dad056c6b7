"""Light that goes from skin to skin, bounce after bounce, and how it is read at the full size (theory.md 9.7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster
from skinbake.atlas.raster import NO_FACE
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.terms.ray_counts import NOISE_FALL
from skinbake.diffuse.terms.skin_view import SkinView
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
Index = NDArray[np.int64]
_HALVES = 0.85  # of the noise that two halves of rays seem to leave: they lie apart, so that they err to either side
_SLOWEST = 0.95  # most that a bounce is believed to keep of the last one: the rest of the series is finite


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
    noise : float
        Standard error that the rays leave, as a share of the first bounce's rms, as it leaves again, of the light that
        has most: by how much the two halves of the rays differ.
    """

    tiles: list[Image]
    bounces: int
    left: float
    noise: float


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
        geometric series. All but the first go by half of the rays: they are a tenth of it.

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
    area = np.concatenate([r.area_mm2.reshape(-1)[view.flat_index[view.tile == k]] for k, r in enumerate(view.atlas)])
    share = view.share[:, None, None]
    source, lies_in = view.read(sent), view.receiver()
    out = np.zeros((len(view.tile), lights, 3), np.float32)
    first, left, noise = np.zeros(lights), np.ones(lights), np.zeros(lights)
    for turn in range(bounces):
        values = source.reshape(len(source), 3 * lights)
        halves = np.zeros((1 if turn else 2, len(out), 3 * lights), np.float32)
        parallel_for(_collect, len(out), _Rays(view.rays, view.first, view.half, view.seen), values, halves)
        got = halves.mean(axis=0).reshape(out.shape)
        out += got
        sent_again = got * again
        now, then = _rms(got), _rms(sent_again * share)
        if not turn:
            first = now
            apart = view.quieter(halves[0] - halves[1]).reshape(out.shape) * again
            here = np.maximum(_rms(got * again, area), 1e-30)
            noise = _rms(apart, area) / here * (_HALVES * np.sqrt(0.5) * 2**-NOISE_FALL)
        del halves
        falls = np.minimum(then / np.maximum(now, 1e-30), _SLOWEST)
        left = np.where(first > 0, now * falls / (1 - falls) / np.maximum(first, 1e-30), 0)
        if left.max() <= negligible:
            break
        source = np.where(lies_in[:, None, None] >= 0, sent_again[lies_in], 0) if len(got) else source
    out = view.quieter(out.reshape(len(out), -1)).reshape(out.shape)
    tiles = [np.zeros((lights, *shape, 3), np.float32) for shape in shapes]
    for k, tile in enumerate(tiles):
        mine = view.tile == k
        tile.reshape(lights, -1, 3)[:, view.flat_index[mine]] = out[mine].transpose(1, 0, 2)
    return BouncedLight(tiles, turn + 1, float(left.max()), float(noise.max()))


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


def _rms(values: Image, weight: Image | None = None) -> NDArray[np.float64]:
    """Root of the sum of squares of each light, (L,), of (n, L, 3), each times its weight."""
    square = values * values
    if weight is not None:
        square *= weight[:, None, None]
    root: NDArray[np.float64] = np.sqrt(square.sum(axis=(0, 2), dtype=np.float64))
    return root


class _Rays(NamedTuple):
    """Rays that meet skin, as in `SkinView`.

    Attributes
    ----------
    rays, first, half : ndarrays of shape (n,)
        `first` is longer by one.
    seen : ndarray of shape (k,)
    """

    rays: Index
    first: Index
    half: Index
    seen: NDArray[np.int32]


@kernel
def _collect(start, stop, view, source, out):  # type: ignore[no-untyped-def]
    """The mean of what rays see, by halves of them.

    Parameters
    ----------
    start, stop : int
        Points.
    view : _Rays
    source : ndarray of shape (m, v)
    out : ndarray of shape (halves, n, v), added to
    """
    for i in range(start, stop):
        for half in range(out.shape[0]):
            begin, end = (view.first[i], view.half[i]) if half == 0 else (view.half[i], view.first[i + 1])
            for k in range(begin, end):
                for v in range(source.shape[1]):
                    out[half, i, v] += source[view.seen[k], v]
            for v in range(source.shape[1]):
                out[half, i, v] /= 0.5 * view.rays[i]


def fitted(colour: Image, shape: tuple[int, ...]) -> Image:
    """A map at the middle texels of a smaller size, or of its own; a constant as it is."""
    height, width = colour.shape[:2]
    if (height, width) == (1, 1):
        return colour
    return colour[middles(shape[0], height)][:, middles(shape[1], width)]


def middles(count: int, of: int) -> Index:
    """Which of some texels along a side lie at the middles of fewer ones, (count,)."""
    return (2 * np.arange(count) + 1) * of // (2 * count)


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
