"""Light of skies and from skin comes from everywhere and leaves by another profile than a beam (theory.md 9.9).

Its total is the incidence's. Of its shape the lobes know this much: each weighs a little more or less of such light.
Blurring is linear, so a lobe blurs what lamps send plus its factor times what comes from everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles
from skinbake.diffuse.terms.curvature import MOST_GAIN, STEPS, CurvedSkin, add_by_gain, lobe_factors
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.curved_skin import curved_share
from skinbake.profile.diffuse_shape import LEAST, MOST, diffuse_factors
from skinbake.profile.effective_medium import one_layer
from skinbake.profile.layers import Layer
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.decision import Decision
from skinbake.scene.skin import SkinSpec, TransportSkin

Image = NDArray[np.float32]
TERM = "diffuse_profile"
COARSE = 256  # texels across, at most, of the copy that says how much the term is worth
# Of its effect over that of a blur on a coarse plane: 3.9 and 4.4 under a sky at an index of 1 and 1.4, for what goes
# through thin parts is blurred less or more, too, and not seen there
MORE_IN_ALL = 4.0
HELD = 3  # lights more than without it: what comes from everywhere, one lobe's and the next one's
LEAST_LEFT = 0.2  # of the tolerance: so much may be left out where the other terms have no part of it


class EverywhereLight(NamedTuple):
    """Light that comes from everywhere.

    Attributes
    ----------
    rgb : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile; it is part of the light that is blurred.
    variance_mm2 : ndarray of shape (N,)
        Of the lobes.
    factor : ndarray of shape (N, STEPS + 1, 3)
        How many times each lobe takes it, by the gain, from 0 to `MOST_GAIN`.
    gain : dict of int to ndarray of shape (h, w, 3), float32
        Of round skin, by tile.
    """

    rgb: Tiles
    variance_mm2: Float
    factor: Float
    gain: Tiles

    def changes(self, variance_mm2: float) -> bool:
        """Whether a lobe takes it otherwise than once."""
        return bool((self.factor[self.variance_mm2 == variance_mm2] != 1).any())

    def times(self, source: Tiles) -> Float:
        """How many times lobes have each light on flat skin, on the average, (L, N, 3); `source` is all light."""
        part, whole = (np.sum([_sum(each) for each in of.values()], axis=0) for of in (self.rgb, source))
        return 1 + safe_div(part, whole)[:, None] * (self.factor[:, round(STEPS / MOST_GAIN)] - 1)

    def added_to(self, source: Tiles, variance_mm2: float, zeros: Zeros, room: Tiles | None = None) -> Tiles:
        """What a lobe blurs of light that has it once.

        Parameters
        ----------
        source : Tiles
        variance_mm2 : float
            Of the lobe.
        zeros : callable
            Makes large arrays.
        room : Tiles, optional
            Arrays to write it into, as they were given before, in place of others.
        """
        found, factor = {}, self.factor[self.variance_mm2 == variance_mm2][0]
        for tile, rgb in self.rgb.items():
            found[tile] = zeros(rgb.shape, np.float32) if room is None else room[tile]
            add_by_gain(self.gain[tile], factor - 1, rgb, source[tile], found[tile])
        return found


def layer_of_profile(skin: SkinSpec, medium: SkinMedium, gaussians: GaussianSum) -> Layer | str:
    """The layer whose light from everywhere has another profile; or why there is none.

    Parameters
    ----------
    skin : SkinSpec
    medium : SkinMedium
        Its medium.
    gaussians : GaussianSum
        Its profile.
    """
    if isinstance(skin, TransportSkin) and skin.incidence == "diffuse":
        return "the skin's profile is that of light from everywhere"
    return one_layer(medium, gaussians)


class DiffuseProfile:
    """Weighs, on a coarse copy of the light, what the shape of the profile changes.

    Parameters
    ----------
    gaussians : GaussianSum
    layer : Layer
        Of the skin, or one that stands for it.
    atlas : Atlas
    lights : int
        How many are stored.
    curved : CurvedSkin, optional
        Where curvature is counted.
    """

    def __init__(
        self, gaussians: GaussianSum, layer: Layer, atlas: Atlas, lights: int, curved: CurvedSkin | None = None
    ) -> None:
        self._gaussians, self._layer, self._atlas, self._curved = gaussians, layer, atlas, curved
        self._factor_rgb = diffuse_factors(gaussians, layer)
        step = -(-max(atlas[0].shape) // COARSE)
        self._thin = (slice(step // 2, None, step), slice(step // 2, None, step))
        area = [(float(r.area_mm2.sum(dtype=np.float64)), np.count_nonzero(r.area_mm2)) for r in atlas]
        self._texel_mm = step * float(np.sqrt(sum(mm2 for mm2, _ in area) / max(sum(count for _, count in area), 1)))
        self._lamps = {r.tile: np.zeros((lights, *r.area_mm2[self._thin].shape, 3), np.float32) for r in atlas}

    def add_lamp(self, tile: int, place: int, image: Image) -> None:
        """Note what of a stored light comes from a lamp.

        Parameters
        ----------
        tile : int
        place : int
            Of the stored light.
        image : ndarray of shape (H, W, 3)
        """
        self._lamps[tile][place] += image[self._thin]

    def decide(self, light: Tiles, names: Sequence[str], switch: str, limits: Sequence[float]) -> list[Decision]:
        """The plan's lines.

        Parameters
        ----------
        light : dict of int to ndarray of shape (L, H, W, 3)
            All that arrives, from lamps, skies and skin.
        names : sequence of L str
        switch : "auto" or "on"
        limits : sequence of L float
            What may be left out of each light.
        """
        squares = np.zeros((len(names), 2))
        for raster in self._atlas:
            images, area = light[raster.tile][:, *self._thin], raster.area_mm2[self._thin][..., None]
            mask = (area > 0).astype(np.float32)
            kernel = self._kernel(mask.shape[:2])
            even = _filtered(mask, kernel)
            total = self._gaussians.weight_rgb.sum(axis=0)
            for i, image in enumerate(images):
                part = np.maximum(image - self._lamps[raster.tile][i], 0) * mask
                if part.max(initial=0) > 1e-5 * image.max(initial=0):  # else round-off
                    squares[i, 0] += np.sum(area * (_filtered(part, kernel) - part * even) ** 2, dtype=np.float64)
                squares[i, 1] += np.sum(area * (image * total) ** 2, dtype=np.float64)
        lines = []
        for name, (moved, whole), limit in zip(names, squares, limits, strict=True):
            rms = MORE_IN_ALL * float(np.sqrt(moved / whole)) if whole > 0 else 0.0
            why = f"{switch}: the profile of light from skies and skin moves about {rms:.2%} of the light (rms)"
            kept = rms > 0 and (switch == "on" or rms > limit)
            lines.append(Decision(f"{name}.{TERM}", kept, f"{why}, worth it from {limit:.2%}", 0.0 if kept else rms))
        return lines

    def _kernel(self, shape: tuple[int, int]) -> Image:
        """What the shape changes of a spatial frequency of the texture, (h, w // 2 + 1, 3)."""
        across, along = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1])
        s = 2 * np.pi / self._texel_mm * np.hypot(across[:, None], along)
        more = self._gaussians.weight_rgb * (self._factor_rgb - 1)
        return np.asarray(np.exp(-0.5 * s[..., None] ** 2 * self._gaussians.variance_mm2) @ more, np.float32)

    def light(
        self, light: Tiles, kept: Sequence[int], lamps: Callable[[int], Iterable[tuple[int, Image]]], zeros: Zeros
    ) -> EverywhereLight:
        """What of some lights comes from everywhere, with each lobe's factors; nothing of the others.

        Parameters
        ----------
        light : dict of int to ndarray of shape (L, H, W, 3)
            All that arrives.
        kept : sequence of int
            These lights.
        lamps : callable
            Gives, for a tile by its place in the atlas, the images of lamps and which light they are part of.
        zeros : callable
            Makes large arrays.
        """
        rgb = {}
        for k, raster in enumerate(self._atlas):
            out = rgb[raster.tile] = zeros(light[raster.tile].shape, np.float32)
            for i in kept:
                out[i] = light[raster.tile][i]
            for i, image in lamps(k):
                out[i] -= image
            np.maximum(out, 0, out=out)  # round-off
        return EverywhereLight(rgb, self._gaussians.variance_mm2, *self._by_gain())

    def _by_gain(self) -> tuple[Float, Tiles]:
        """Each lobe's factors by the gain of round skin, and that gain.

        What round skin adds is known of light from everywhere, and lobes share it where light leaves. So that their sum
        is still that, they take such light also by the share that they should have over that which they have, within
        the bounds of the factors: a hollow may leave next to nothing of wide lobes, where they should have some.
        """
        gaussians, factor, curved = self._gaussians, self._factor_rgb, self._curved
        if curved is None:
            flat = {raster.tile: np.ones((1, 1, 3), np.float32) for raster in self._atlas}
            return np.repeat(factor[:, None], STEPS + 1, axis=1), flat
        own = replace(gaussians, weight_rgb=gaussians.weight_rgb * factor, table=None)
        share = curved_share(own, self._layer.medium, self._layer.eta) if curved.share.any() else curved.share
        has, should_have = lobe_factors(curved.weight, curved.share), lobe_factors(own.weight_rgb, share)
        return factor[:, None] * np.clip(safe_div(should_have, has), LEAST, MOST), curved.gain


def _filtered(image: Image, kernel: Image) -> Image:
    """An image (h, w, 3 or 1) with its frequencies times a kernel (h, w // 2 + 1, 3)."""
    spectrum = np.fft.rfft2(image, axes=(0, 1)) * kernel
    return np.asarray(np.fft.irfft2(spectrum, image.shape[:2], axes=(0, 1)), np.float32)


def _sum(images: Image) -> Float:
    """Sum over the texels of images (L, H, W, 3), (L, 3): by rows, so that threads cannot change it."""
    rows = np.zeros((images.shape[1], len(images), 3))
    parallel_for(_sum_rows, len(rows), images, rows)
    return rows.sum(axis=0)


@kernel
def _sum_rows(first, stop, images, rows):  # type: ignore[no-untyped-def]
    """Sums of rows `first` to `stop` of images (L, H, W, 3), written into `rows`, (H, L, 3)."""
    for row in range(first, stop):
        for light in range(len(images)):
            red, green, blue = 0.0, 0.0, 0.0
            for col in range(images.shape[2]):
                red += images[light, row, col, 0]
                green += images[light, row, col, 1]
                blue += images[light, row, col, 2]
            rows[row, light, 0], rows[row, light, 1], rows[row, light, 2] = red, green, blue
