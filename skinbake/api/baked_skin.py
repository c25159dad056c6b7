"""BakedSkin: what a bake leaves, as arrays."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from skinbake.api.arguments import checked_gain, checked_suns, checked_turn, sky_of
from skinbake.api.pixels import Image, Pixels
from skinbake.api.viewer import Viewer
from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse import MeasuredError
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.profile.weight_table import WeightTable
from skinbake.relight.relit import Sun, light_coefficients, relit
from skinbake.relight.transfer import Transfer
from skinbake.scene.budget import is_within, left_wrong
from skinbake.scene.decision import Decision, uncounted_words
from skinbake.scene.spec import SceneSpec

Gains = Mapping[str, float | Sequence[float]]
_NOTEBOOK_TEXELS = 512  # a side, at most twice that


class BakedSkin:
    """Light on skin, baked: in memory by `skinbake.bake`, or read from a folder by `skinbake.open_bake`.

    Attributes
    ----------
    look : SceneSpec
        What was baked.
    lights : tuple of str
        Lights that can be asked for by name: all of the look for `irradiance`; for the others too, unless the look
        says `output.lights: total`.
    tiles : tuple of int
        UDIM numbers; (1001,) where there are no tiles.
    variance_mm2 : ndarray of shape (N,)
        Of each lobe, narrowest first. Light through thin parts, where there is any, comes last.
    weight_rgb : ndarray of shape (N, 3)
        Of each lobe.
    error : MeasuredError, optional
        Measured against the surface integral of the same Gaussians: `rms`, `p95`, `max`, of these `method` and
        `storage`, and the number of `probes`. None where the look asks for none.
    plan : tuple of Decision
        What was decided, `term`, `enabled` and `why`.
    transmits : bool
        Whether the last lobe is light through thin parts.
    folder : Path, optional
        Where the bake lies; None where it is in memory.
    table : WeightTable, optional
        Weights where maps vary the skin; `weight_rgb` is then that of their mean values.
    """

    def __init__(
        self,
        look: SceneSpec,
        pixels: Pixels,
        lights: tuple[str, ...],
        tiles: tuple[int, ...],
        variance_mm2: Float,
        weight_rgb: Float,
        error: MeasuredError | None,
        plan: tuple[Decision, ...],
        transmits: bool = False,
        folder: Path | None = None,
        table: WeightTable | None = None,
    ) -> None:
        self.look, self.lights, self.tiles, self.error, self.plan = look, lights, tiles, error, plan
        self.transmits, self.folder, self.table = transmits, folder, table
        self.variance_mm2, self.weight_rgb = variance_mm2, weight_rgb
        self._pixels = pixels

    @property
    def left_wrong(self) -> float | None:
        """Root mean square of all that is left wrong, as a share of the light that it is worst for: the blur's error as
        measured, and what the plan is estimated to leave out; None where nothing was measured.
        """
        return None if self.error is None else left_wrong(self.plan, self.lights, self.error.rms)

    @property
    def tolerance_met(self) -> bool:
        """Whether what is left wrong is within `diffusion.tolerance`; True where nothing was measured."""
        left = self.left_wrong
        return left is None or is_within(left, self.look.diffusion.tolerance)

    @property
    def verdict(self) -> str:
        """What the bake's errors are, in a sentence."""
        if self.error is None:
            return "the blur was not measured"
        met = "within" if self.tolerance_met else "not within"
        tolerance = self.look.diffusion.tolerance
        uncounted = uncounted_words(line.record() for line in self.plan)
        return (
            f"the blur is off by {self.error.rms:.2%} rms, all that is left wrong by {self.left_wrong:.2%}, {met} the "
            f"tolerance of {tolerance:.2%}{'; ' * bool(uncounted)}{uncounted}"
        )

    def _repr_html_(self) -> str:
        """The light leaving the first tile as a picture, and the verdict: what a notebook shows."""
        from skinbake.io.png import png_bytes
        from skinbake.preview.tonemap import tonemap

        m = self.radiant_exitance() if self.lights else self.relight(np.full((2, 4, 3), 1 / np.pi))
        step = max(1, max(m.shape[:2]) // _NOTEBOOK_TEXELS)
        small = m[: m.shape[0] // step * step, : m.shape[1] // step * step]
        small = small.reshape(small.shape[0] // step, step, small.shape[1] // step, step, 3).mean(axis=(1, 3))
        picture = tonemap(small / np.float32(np.pi), self.look.preview.exposure)
        data = base64.b64encode(png_bytes(picture)).decode("ascii")
        lights = html.escape(", ".join(self.lights) or "come later")
        return (
            f'<figure><img src="data:image/png;base64,{data}" alt="Light leaving the skin">'
            f"<figcaption>{html.escape(self.verdict)}; lights {lights}</figcaption></figure>"
        )

    def viewer(self, height: int = 640) -> Viewer:
        """The page of `skinbake export --web`, for a notebook's cell.

        Parameters
        ----------
        height : int
            In pixels.

        Raises
        ------
        InputError
            The bake is in memory alone, or a file of it is missing or damaged.
        """
        if self.folder is None:
            raise InputError("viewer: expected a bake in a folder, got one in memory; `skinbake bake` it and open_bake")
        from skinbake.page import bake_page

        page, _ = bake_page(self.folder)
        return Viewer(page, height)

    def irradiance(self, light: str | None = None, tile: int | None = None) -> Image:
        """Light arriving at each texel, W/m^2-like, linear Rec.709.

        Parameters
        ----------
        light : str, optional
            One light; the sum of all by default.
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (H, W, 3), float32
            Row 0 is v = 1.

        Raises
        ------
        InputError
            There is no such light or tile, or a file is missing or damaged.
        """
        self._refuse_unlit()
        if light is not None and light not in self.lights:
            raise InputError(f"light: expected one of {', '.join(self.lights)}, got {light}")
        return self._pixels.irradiance(self._tile(tile), light)

    def lobe(self, index: int, light: str | None = None, tile: int | None = None) -> Image:
        """One lobe as it is stored, which may be smaller than the texture: light blurred by its Gaussian.

        Parameters
        ----------
        index : int
            0 is the narrowest.
        light : str, optional
            One light; the sum of all by default.
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (h, w, 3), float32

        Raises
        ------
        InputError
            There is no such lobe, light or tile, or a file is missing or damaged.
        """
        self._refuse_unlit()
        if not 0 <= index < len(self.weight_rgb):
            raise InputError(f"lobe: expected 0 to {len(self.weight_rgb) - 1}, got {index}")
        return self._pixels.lobe(index, self._tile(tile), self._stored(light))

    def radiant_exitance(self, gains: Gains | None = None, tile: int | None = None) -> Image:
        """Light leaving the skin, M: the lobes read bilinearly at full size, weighted and summed; L = M / pi.

        Light through thin parts is in it, and what of the albedo comes after scattering.

        Parameters
        ----------
        gains : mapping of light name to float or (R, G, B), optional
            Factors on lights; 1 for those that are not named.
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (H, W, 3), float32

        Raises
        ------
        InputError
            There is no such light or tile, a gain is no number from 0 up, the bake has summed its lights, or a file is
            missing or damaged.

        References
        ----------
        [dEon2007]
        """
        self._refuse_unlit()
        tile = self._tile(tile)
        width, height = self.look.texture.size
        factors = {name: checked_gain(name, gain) for name, gain in (gains or {}).items()}
        lights: list[str | None] = [None]
        if any((factor != 1).any() for factor in factors.values()):
            lights = [self._stored(name) for name in dict.fromkeys((*factors, *self.lights))]
        else:
            for name in factors:
                self._stored(name)
        total = np.zeros((height, width, 3), np.float32)
        for index in range(len(self.weight_rgb)):
            weight = self.weight_image(index, tile)
            lobe = sum(self._pixels.lobe(index, tile, name) * factors.get(str(name), np.float32(1)) for name in lights)
            total += weight * magnify_bilinear(np.asarray(lobe, np.float32), (height, width))
        if self.look.texturing.exponent_before < 1:
            total *= self.albedo_after(tile)
        return total

    radiance_exitance = radiant_exitance

    def albedo_after(self, tile: int | None = None) -> Image:
        """What of the albedo comes after scattering, theory.md 5.1: a factor on the sum of the lobes.

        Parameters
        ----------
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (H, W, 3) or (1, 1, 3), float32
            Ones where all of it comes before.

        Raises
        ------
        InputError
            There is no such tile, or a map is missing or damaged.
        """
        after = np.float32(1 - self.look.texturing.exponent_before)
        return self._pixels.albedo(self._tile(tile)) ** after if after else np.ones((1, 1, 3), np.float32)

    def weight_image(self, index: int, tile: int | None = None) -> Image:
        """What a lobe counts at each texel.

        Parameters
        ----------
        index : int
            Of the lobe.
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (H, W, 3), or (1, 1, 3) where it is the same everywhere; float32

        Raises
        ------
        InputError
            There is no such tile, or a map is missing or damaged.
        """
        if self.table is None:
            return self.weight_rgb[index].astype(np.float32)[None, None]
        width, height = self.look.texture.size
        weights = SkinWeights(self.weight_rgb, self.table, self._pixels.maps())
        return weights.image(index, self._tile(tile), (height, width))

    def relight(
        self,
        environment: Path | str | Image | None = None,
        rotate_deg: float = 0.0,
        suns: Sequence[Sun] = (),
        tile: int | None = None,
    ) -> Image:
        """Light leaving the skin, M, under a sky and suns that no bake has seen; needs a look with `relight`.

        Linear in the light, but that what is below 0 is set to 0. How wrong it is stands in relight.json.

        Parameters
        ----------
        environment : path, or ndarray of shape (h, w, 3), optional
            Equirectangular radiance, as of a look's environment.
        rotate_deg : float
            Turns sky and suns about +y, +z towards +x.
        suns : sequence of (direction, irradiance_rgb)
            `direction` is where the light travels; irradiance is that of a plane which faces it.
        tile : int, optional
            UDIM number; the first tile by default.

        Returns
        -------
        ndarray of shape (H, W, 3), float32
            Of the size of the look's texture.

        Raises
        ------
        InputError
            The look has no `relight`, there is no such tile, a file is missing, damaged or no sky, or a value is none.

        References
        ----------
        [Sloan2002]
        """
        tile, transfer = self._tile(tile), self._transfer
        sky = None if environment is None else sky_of(environment)
        amount = light_coefficients(transfer.basis, sky, checked_turn(rotate_deg), checked_suns(suns))
        width, height = self.look.texture.size
        total = magnify_bilinear(relit(transfer.textures[tile], transfer.basis, amount), (height, width))
        after = 1 - self.look.texturing.exponent_before
        return total * self._pixels.albedo(tile) ** np.float32(after) if after else total

    @cached_property
    def _transfer(self) -> Transfer:
        return self._pixels.transfer()

    def _refuse_unlit(self) -> None:
        """Stop where there is no light yet.

        Raises
        ------
        InputError
        """
        if not self.lights:
            raise InputError("lights: this bake has no lights of its own; relight(environment, suns=...) shows any")

    def _tile(self, tile: int | None) -> int:
        if tile is not None and tile not in self.tiles:
            raise InputError(f"tile: expected one of {', '.join(map(str, self.tiles))}, got {tile}")
        return self.tiles[0] if tile is None else tile

    def _stored(self, light: str | None) -> str | None:
        """A light of which the lobes are stored apart."""
        if light is not None and light not in self.lights:
            raise InputError(f"light: expected one of {', '.join(self.lights)}, got {light}")
        if light is not None and not self.look.output.separate_lights:
            raise InputError(f"light {light}: this bake summed its lights; bake with output.lights: separate")
        return light
