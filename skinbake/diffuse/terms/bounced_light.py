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
from skinbake.kernels.simd import LANES, broadcast, load, store
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

Image = NDArray[np.float32]
Index = NDArray[np.int64]
_HALVES = 0.85  # of the noise that two halves of rays seem to leave: they lie apart, so that they err to either side
_READ_BYTES, _MOST_AT_ONCE = 1 << 26, 16  # what lights that go together read, and how many they are at most
_SLOWEST = 0.95  # most that a bounce is believed to keep of the last one: the rest of the series is finite


class BouncedLight(NamedTuple):
    """Light that skin gets from skin.

    Attributes
    ----------
    tiles : list of ndarray of shape (L, h, w, 3), float32
        Irradiance at the small texels, a tile in the atlas's order.
    bounces : ndarray of shape (L,)
        How often each light went from skin to skin.
    left : ndarray of shape (L,)
        Rms of all bounces after these, as a share of the first one's.
    noise : ndarray of shape (L,)
        Standard error that the rays leave, as a share of the first bounce's rms, as it leaves again: by how much the
        two halves of the rays differ.
    first : ndarray of shape (L,)
        Root of the sum of squares of the first bounce, as it leaves again, times area, mm.
    """

    tiles: list[Image]
    bounces: Index
    left: NDArray[np.float64]
    noise: NDArray[np.float64]
    first: NDArray[np.float64]


def bounced_light(
    view: SkinView,
    sent: Sequence[Image],
    reflected: Sequence[Image],
    bounces: int | Sequence[int] = 1,
    negligible: float | Sequence[float] = 0.0,
    gain_rgb: Image | None = None,
    measured: bool = True,
    colour: Sequence[Image] | None = None,
) -> BouncedLight:
    """Irradiance that skin gets from skin, bounce after bounce until the rest is negligible.

    Parameters
    ----------
    view : SkinView
    sent : sequence of ndarray of shape (L, H, W, 3)
        M of each tile, of the light that arrives without a bounce, at any size.
    reflected : sequence of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of the bounced irradiance leaves as M again.
    bounces : int, or L of them
        At most as many, 1 or more.
    negligible : float, or L of them
        Rms of all bounces to come, as a share of the first one's, below which they are left out. The next bounce is
        foreseen as this one times what leaves again and the share of rays that meet skin; those after it follow as a
        geometric series. All but the first go by half of the rays: they are a tenth of it.
    gain_rgb : ndarray of shape (L, 3), optional
        What of each light's bounced irradiance counts, in front of `reflected`.
    measured : bool
        False: as many bounces as asked for; nobody wants to know what is left, nor the noise.
    colour : sequence of ndarray of shape (H, W, 3) or (1, 1, 3), optional
        What `sent` is to be multiplied by, of its size: only where rays meet it, which saves a copy of all lights.

    Raises
    ------
    ValueError
        If `bounces` is below 1.
    """
    lights, shapes = sent[0].shape[0], [raster.shape for raster in view.atlas]
    most, enough = np.broadcast_to(bounces, lights), np.broadcast_to(negligible, lights)
    if most.min(initial=1) < 1:
        raise ValueError(f"bounces: expected at least 1, got {most.min()}")
    again = _reflected_again(view, reflected, gain_rgb)
    area = np.concatenate([r.area_mm2.reshape(-1)[view.flat_index[view.tile == k]] for k, r in enumerate(view.atlas)])
    ones = np.ones_like(area)
    rays = _Rays(view.rays, view.first, view.half, view.seen)
    values = _read(view, sent, colour or [np.ones((1, 1, 3), np.float32)] * len(sent), _row(lights))
    out = np.zeros((len(view.tile), values.shape[1]), np.float32)
    done, going = np.zeros(lights, np.int64), np.ones(lights, np.bool_)
    first, left, noise, here = np.zeros(lights), np.ones(lights), np.zeros(lights), np.ones(lights)
    apart: Image | None = None
    for turn in range(most.max(initial=1)):
        halves = np.zeros((1 if turn else 2, *out.shape), np.float32)
        parallel_for(_collect, len(out), rays, values, halves)
        if measured and not turn:
            apart = halves[0] - halves[1]
        got, sent_again = halves[0], np.empty_like(out)
        parallel_for(_arrive, len(out), halves, again, out, sent_again)
        done += going
        if measured:
            now, then = _rms(got, ones, lights), _rms(sent_again, view.share, lights)
            if not turn:
                first, here = now, np.maximum(_rms(sent_again, np.sqrt(area), lights), 1e-30)
            falls = np.minimum(then / np.maximum(now, 1e-30), _SLOWEST)
            foreseen = np.where(first > 0, now * falls / (1 - falls) / np.maximum(first, 1e-30), 0)
            left = np.where(going, foreseen, left)
            going &= left > enough
        going &= most > turn + 1
        if not going.any():
            break
        if not going.all():
            sent_again[:, : 3 * lights].reshape(len(got), lights, 3)[:, ~going] = 0
        if not turn:
            rays = rays._replace(seen=view.seen_again)
        values = sent_again
    if apart is None:
        out = view.quieter(out)
    else:  # together, as finding the neighbours is what takes time
        out, apart = (each.copy() for each in np.split(view.quieter(np.concatenate([out, apart], axis=1)), 2, axis=1))
        apart[:, : 3 * lights].reshape(len(out), lights, 3)[...] *= again
        noise = _rms(apart, np.sqrt(area), lights) / here * (_HALVES * np.sqrt(0.5) * 2**-NOISE_FALL)
    tiles = [np.zeros((lights, *shape, 3), np.float32) for shape in shapes]
    for k, tile in enumerate(tiles):
        mine = np.flatnonzero(view.tile == k)
        parallel_for(_spread, lights, out, mine, view.flat_index[mine], tile.reshape(lights, -1, 3))
    return BouncedLight(tiles, done, left, noise, here)


def lights_at_once(view: SkinView, shape: tuple[int, int]) -> int:
    """How many lights' bounces go together: a ray's row of memory is read once for all of them.

    Parameters
    ----------
    view : SkinView
    shape : (H, W)
        Of the textures of what they send.
    """
    texels = sum(map(len, view.met)) + len(view.atlas) * shape[0] * shape[1]
    return int(np.clip(_READ_BYTES // (12 * texels), 1, _MOST_AT_ONCE))


def _row(lights: int) -> int:
    """Values of a row of lights in colour: whole vectors of a processor, where there are as many."""
    return 3 * lights if 3 * lights < LANES else -(-3 * lights // LANES) * LANES


def _read(view: SkinView, images: Sequence[Image], colour: Sequence[Image], width: int) -> Image:
    """Values at the texels that are met, (m, width), of images (L, h, w, 3) of any size times their colour.

    The lights stand side by side, 3 L values, and after them zeros.
    """
    out = np.zeros((sum(map(len, view.met)), width), np.float32)
    start = 0
    met = view.met_in([each.shape[1:3] for each in images])
    for image, by, (rows, cols) in zip(images, colour, met, strict=True):
        part = out[start : start + len(rows)]
        floats = np.asarray(image, np.float32), np.asarray(by, np.float32)
        parallel_for(_read_texels, len(rows), *floats, rows, cols, part)
        start += len(rows)
    return out


@kernel
def _read_texels(start, stop, image, colour, rows, cols, out):  # type: ignore[no-untyped-def]
    """Write what lights have at texels, side by side, times a colour.

    Parameters
    ----------
    start, stop : int
        Texels.
    image : ndarray of shape (L, h, w, 3)
    colour : ndarray of shape (h, w, 3) or (1, 1, 3)
    rows, cols : ndarrays of shape (m,)
    out : ndarray of shape (m, 3 L or more), written
    """
    varies = colour.shape[0] > 1
    for k in range(start, stop):
        row, col = (rows[k], cols[k]) if varies else (0, 0)
        for light in range(image.shape[0]):
            for c in range(3):
                out[k, 3 * light + c] = image[light, rows[k], cols[k], c] * colour[row, col, c]


def _reflected_again(view: SkinView, reflected: Sequence[Image], gain_rgb: Image | None) -> Image:
    """What leaves again at the texels that receive, (n, L, 3), or (n, 1, 3) where it is the same for all lights."""
    gain = np.ones((1, 3), np.float32) if gain_rgb is None else gain_rgb
    gain = gain[:1] if (gain == gain[0]).all() else gain
    again = np.empty((len(view.tile), len(gain), 3), np.float32)
    for k, (colour, raster) in enumerate(zip(reflected, view.atlas, strict=True)):
        mine = view.tile == k
        small = np.broadcast_to(fitted(colour, raster.shape), (*raster.shape, 3)).reshape(-1, 3)
        again[mine] = gain * small[view.flat_index[mine], None]
    return again


class SkinLight(NamedTuple):
    """How skin lights skin under the lights that have the term.

    Attributes
    ----------
    view : SkinView
    reflected : list of ndarray of shape (h, w, 3)
        What of irradiance leaves as M, at the small texels, a tile in the atlas's order.
    gain : mapping of str to ndarray of shape (3,)
        By light, what of light from skin counts where it enters.
    bounces : mapping of str to (int, float)
        By light, at most how often it goes from skin to skin, and which share of the first time may be left out.
    wrong : mapping of str to float, optional
        By light, share of what skin sends on that texels and rays leave wrong; without it nothing is measured.
    """

    view: SkinView
    reflected: list[Image]
    gain: Mapping[str, Image]
    bounces: Mapping[str, tuple[int, float]]
    wrong: Mapping[str, float] | None = None

    def lit_by(self, names: Sequence[str], sent: Sequence[Image]) -> tuple[list[Image], Float, Float]:
        """What counts of what skin sends on.

        Parameters
        ----------
        names : sequence of L str
            Of the lights.
        sent : sequence of ndarray of shape (L, H, W, 3)
            M by tile, at any size.

        Returns
        -------
        tiles : list of ndarray of shape (L, h, w, 3)
            Irradiance.
        rms, error : ndarrays of shape (L,)
            Root of the sum of its squares, as it leaves again, times area, mm; and of what is wrong of it, 0 where
            nothing is measured.
        """
        gain = np.stack([self.gain[name] for name in names])
        most, enough = zip(*(self.bounces[name] for name in names), strict=True)
        measured = self.wrong is not None
        found = bounced_light(self.view, sent, self.reflected, most, enough, gain, measured)
        tiles = [(gain[:, None, None] * tile).astype(np.float32, copy=False) for tile in found.tiles]
        if self.wrong is None:
            return tiles, np.zeros(len(names)), np.zeros(len(names))
        square = np.zeros(len(names))
        for tile, colour, raster in zip(tiles, self.reflected, self.view.atlas, strict=True):
            square += [(raster.area_mm2[..., None] * (image * colour) ** 2).sum(dtype=np.float64) for image in tile]
        rms = np.sqrt(square)
        wrong = np.maximum([self.wrong[name] for name in names], found.noise)
        return tiles, rms, np.hypot(wrong * rms, found.left * found.first)


def _rms(values: Image, weight: Image, lights: int) -> NDArray[np.float64]:
    """Root of the sum of squares of each light, (L,), of rows (n, 3 L or more), each times its weight."""
    square = np.zeros(lights)
    parallel_for(_squares, lights, values, weight, square)
    return np.sqrt(square)


@kernel
def _squares(start, stop, values, weight, out):  # type: ignore[no-untyped-def]
    """Sums of squares of lights' values.

    Parameters
    ----------
    start, stop : int
        Lights.
    values : ndarray of shape (n, 3 L or more)
    weight : ndarray of shape (n,)
    out : ndarray of shape (L,), written
    """
    for k in range(start, stop):
        total = 0.0
        for i in range(len(values)):
            r, g, b = values[i, 3 * k], values[i, 3 * k + 1], values[i, 3 * k + 2]
            total += np.float64(r * r + g * g + b * b) * weight[i] * weight[i]
        out[k] = total


class _Rays(NamedTuple):
    """Rays that meet skin, as in `SkinView`.

    Attributes
    ----------
    rays, first, half : ndarrays of shape (n,)
        `first` is longer by one.
    seen : ndarray of shape (k,)
        Rows of the source; -1: nothing comes.
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
    source : ndarray of shape (m, v), float32
        Of fewer values than `LANES`, or of whole vectors.
    out : ndarray of shape (halves, n, v), float32, holding 0; written
    """
    width = source.shape[1]
    flat, to = source.reshape(-1), out.reshape(-1)
    for i in range(start, stop):
        for half in range(out.shape[0]):
            begin, end = (view.first[i], view.half[i]) if half == 0 else (view.half[i], view.first[i + 1])
            row = (half * out.shape[1] + i) * width
            if width < LANES:
                for k in range(begin, end):
                    if view.seen[k] >= 0:
                        for v in range(width):
                            to[row + v] += flat[view.seen[k] * width + v]
            else:
                for v in range(0, width, LANES):
                    total = broadcast(np.float32(0))
                    for k in range(begin, end):
                        if view.seen[k] >= 0:
                            total = total + load(flat, view.seen[k] * width + v)
                    store(to, row + v, total)
            for v in range(width):
                to[row + v] /= 0.5 * view.rays[i]


@kernel
def _arrive(start, stop, halves, again, out, sent_again):  # type: ignore[no-untyped-def]
    """Add what arrives, the mean of the halves, and send on what leaves of it.

    Parameters
    ----------
    start, stop : int
        Points.
    halves : ndarray of shape (1 or 2, n, v), float32
        Of the rays; the first one becomes the mean.
    again : ndarray of shape (n, L or 1, 3), float32
        What leaves.
    out : ndarray of shape (n, v), float32
        Added to.
    sent_again : ndarray of shape (n, v), float32
        Written.
    """
    for i in range(start, stop):
        if len(halves) > 1:
            for v in range(out.shape[1]):
                halves[0, i, v] = (halves[0, i, v] + halves[1, i, v]) * np.float32(0.5)
        for v in range(out.shape[1]):
            out[i, v] += halves[0, i, v]
            light = min(v // 3, again.shape[1] - 1)
            sent_again[i, v] = halves[0, i, v] * again[i, light, v % 3]


@kernel
def _spread(start, stop, rows, texels, flat, out):  # type: ignore[no-untyped-def]
    """Write lights' values to their texels.

    Parameters
    ----------
    start, stop : int
        Lights.
    rows : ndarray of shape (n, 3 L or more)
    texels, flat : ndarrays of shape (k,)
        Rows that are taken, and the texel of each.
    out : ndarray of shape (L, h w, 3), written
    """
    for light in range(start, stop):
        for k in range(len(texels)):
            for c in range(3):
                out[light, flat[k], c] = rows[texels[k], 3 * light + c]


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
