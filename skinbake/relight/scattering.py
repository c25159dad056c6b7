"""What skin makes of the lights of a basis: bounces, albedo, every lobe, light through thin parts; summed to M."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles
from skinbake.bilinear import add_magnified
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.draw_probes import draw_probes
from skinbake.diffuse.light_entering import albedo_of, entering_again
from skinbake.diffuse.make_lobes import make_lobes
from skinbake.diffuse.memoize import Memoizer
from skinbake.diffuse.methods import LobePlan, method_asked_for
from skinbake.diffuse.planning.auto import plan_auto
from skinbake.diffuse.planning.fixed import plan_fixed
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.skin_weights import SkinWeights, uniform_scatter
from skinbake.diffuse.small_blur import SmallBlur
from skinbake.diffuse.terms.bounced_light import SkinLight, add_at_full_size, bounced_light, fitted
from skinbake.diffuse.terms.curvature import curve_skin
from skinbake.diffuse.terms.even_share import hold_back, part_even_light
from skinbake.diffuse.terms.interreflection import Receivers, decide_interreflection
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import SkinView
from skinbake.diffuse.terms.thin_parts import ThinParts, TranslucentSkin
from skinbake.diffuse.terms.transmission import TransmissionSwitch, look_behind, transmit
from skinbake.diffuse.thin_light import SmallLight, sent_on
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.slant import Slant
from skinbake.kernels.threads import on_threads
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.relight.flesh_light import FleshLight
from skinbake.scene.decision import Decision, Decisions
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
Say = Callable[[str], None]


class Scattering:
    """From irradiance to M on one atlas, some lights at a time: what the first ones decide holds for all.

    Lights are physical, nowhere negative. The first one of the first call comes from everywhere and decides, where the
    look says `auto`, whether skin lights skin and whether light comes through.

    Parameters
    ----------
    spec : SceneSpec
        With the texture's size of `atlas`.
    decisions : Decisions
    scene : SceneData
    atlas : Atlas
    skin : EnteredSkin
    slant : Slant, optional
        Where incidence is counted.
    look_around : callable
        Gives what the skin sees of itself; asked only where skin lights skin by enough.
    say : callable
        Told in words what begins.

    Attributes
    ----------
    lines : list of Decision
        What was decided.
    view : SkinView, optional
        What that gave, once light has come.
    thin : ThinParts, optional
        What lies behind the skin, where light comes through that is worth it, once light has come.
    """

    def __init__(
        self,
        spec: SceneSpec,
        decisions: Decisions,
        scene: SceneData,
        atlas: Atlas,
        skin: EnteredSkin,
        slant: Slant | None,
        look_around: Callable[[], SkinView],
        say: Say = lambda _: None,
    ) -> None:
        self._spec, self._scene, self._atlas, self._skin = spec, scene, atlas, skin
        self._budget, self._look_around, self._say = decisions.budget, look_around, say
        self._again = entering_again(spec, decisions, slant)
        gaussians = skin.gaussians
        self._albedo = [albedo_of(scene.maps, raster, scene.mesh) for raster in atlas]
        self._geometry = SkinGeometry(atlas, scene.mesh)
        self._weights = SkinWeights.of(gaussians, scene.maps)
        self._share = self._weights.scattering_share(atlas)
        self._no_probes = draw_probes(self._geometry, 0, 0)
        self._plans: tuple[LobePlan, ...] | None = None
        self.view: SkinView | None = None
        self._enough: tuple[int, float] = (1, 0.0)
        self._bounces: int | None = None
        self.thin: ThinParts | None = None
        # Of the plan and the skin, the same for all lights
        self._flesh_light: FleshLight | None = None
        self._straight: dict[int, Image] | None = None
        self._kept: list[Image] = []
        self._small_blur: SmallBlur | None = None
        self._even_rgb = (slant.diffuse_rgb if slant else np.ones(3)).astype(np.float32)
        area = [raster.area_mm2[..., None] for raster in atlas]
        lit = sum((a * c).sum(axis=(0, 1), dtype=np.float64) for a, c in zip(area, self._albedo, strict=True))
        self._mean_albedo = lit / sum(map(np.sum, area))
        total = [self._weights.total_image(raster.tile, raster.shape) for raster in atlas]
        # What of irradiance leaves as M, by tile
        self._reflected = [albedo * each for albedo, each in zip(self._albedo, total, strict=True)]
        self._curved, line = curve_skin(
            scene.mesh, spec.texture, gaussians, skin.medium, spec.terms.curvature, self._budget.negligible, beams=False
        )
        self.lines: list[Decision] = [replace(line, term="relight.curvature")]

    def exitance(self, light: Tiles) -> Tiles:
        """M of each light before what of the albedo comes after scattering, (L, H, W, 3) a tile.

        Parameters
        ----------
        light : dict of int to ndarray of shape (L, H, W, 3), float32, changed in place
            Irradiance with shadows, incidence and what the oil takes off.
        """
        first = self._plans is None
        if first:
            self._decide_bounces(light)
        self._bounce(light)
        exponent = np.float32(self._spec.texturing.exponent_before)
        for raster, albedo in zip(self._atlas, self._albedo, strict=True):
            light[raster.tile] *= albedo**exponent
        diffused = self._diffused(light)
        through = self._transmitted(diffused, first)
        lobes = self._curved.applied(diffused.lobes, self._straight) if self._curved else diffused.lobes
        alone = np.array([lobe.weight_rgb for lobe in ((*lobes, through) if through else lobes)])
        weights = SkinWeights(alone, self._weights.table, self._scene.maps)
        out = {raster.tile: summed_lobes(lobes, weights, raster.tile, raster.shape) for raster in self._atlas}
        if through is not None:
            through = self._sent_on(through, lobes, light, diffused.lights, out)
            for raster in self._atlas:
                weight = weights.image(len(lobes), raster.tile, raster.shape)
                _add_lobe(through, weight, raster.tile, out[raster.tile])
        return out

    def _decide_bounces(self, light: Tiles) -> None:
        """Look around where skin lights skin by more than the tolerance."""
        spec, scene, terms = self._spec, self._scene, self._spec.terms
        even = [light[raster.tile][:1] for raster in self._atlas]
        # Light through thin parts is decided later, and has its share
        limits = [self._terms_left() / sqrt(2 if terms.transmission == "auto" else 1)]
        skin = TexturedSkin(scene.mesh, scene.occluder, spec.texture.size, spec.texture.udim)
        again = [self._again * colour for colour in self._reflected]
        lines, bounced = decide_interreflection(
            skin, ("relight",), even, again, self._atlas, terms.interreflection, limits
        )
        if any(line.enabled for line in lines):
            self._say("relighting: skin that lights skin")
            self._enough = terms.bounces_for(limits[0], bounced[0].rms)
            self.view = self._look_around()
            taken = Receivers(
                1.0, rays=float(self.view.rays.max(initial=1))
            )  # the sky's texels are as wide as the usual ones
            lines = [replace(line, error=taken.error(each)) for line, each in zip(lines, bounced, strict=True)]
        self.lines += lines

    def _terms_left(self) -> float:
        """What terms may still be wrong by that are left out."""
        return self._budget.terms_left("relight", hypot(*(line.error for line in self.lines)))

    def _bounce(self, light: Tiles) -> None:
        """Add what skin sends on to skin."""
        if self.view is None:
            return
        arrives = [light[raster.tile] for raster in self._atlas]
        again = [self._again * colour for colour in self._reflected]
        if self._bounces is None:
            # As many for every light of the basis, or their sum would not be the light's
            first = [image[:1] for image in arrives]
            even = bounced_light(self.view, first, again, *self._enough, colour=self._reflected)
            self._bounces = int(even.bounces.max())
        found = bounced_light(self.view, arrives, again, self._bounces, measured=False, colour=self._reflected)
        for raster, small in zip(self._atlas, found.tiles, strict=True):
            for k, image in enumerate(light[raster.tile]):
                add_at_full_size(self._again * small[k], raster, image)

    def _diffused(self, light: Tiles) -> DiffuseMap:
        """Every lobe by the plan, which is made where there is none."""
        spec, gaussians = self._budget.of_blur(self._spec.diffusion), self._skin.gaussians
        names = tuple(f"basis.{k}" for k in range(len(next(iter(light.values())))))
        memoizer = Memoizer(LobeResources(light, self._geometry, spec, self._share), names)
        seed, precision = self._spec.output.seed, self._spec.output.precision
        if self._plans is None:
            fixed = method_asked_for(spec.method, spec.normalise)
            if fixed is None:
                self._plans = plan_auto(memoizer, gaussians, self._weights, seed, precision)[0]
            else:
                self._plans = plan_fixed(memoizer.resources, fixed, gaussians)[0]
        made = make_lobes(
            memoizer, self._plans, self._weights, self._no_probes, precision, self._say, lambda _, tiles: tiles
        )
        lobes = [
            Lobe(plan.parameters.variance_mm2, (float(w[0]), float(w[1]), float(w[2])), plan.method.name, tiles)
            for plan, w, tiles in zip(self._plans, gaussians.weight_rgb, made.lobes, strict=True)
        ]
        return DiffuseMap(names, tuple(lobes), None)

    def _transmitted(self, diffused: DiffuseMap, first: bool) -> Lobe | None:
        """Light through thin parts, where that is worth it."""
        spec, scene = self._spec, self._scene
        if first and self.thin is None:
            skin = TranslucentSkin(
                scene.mesh, scene.occluder, spec.texture, self._skin.gaussians, self._mean_albedo, self._skin.medium,
                uniform_scatter(self._skin.gaussians, spec.skin), self._curved,
            )  # fmt: skip
            assert spec.relight is not None
            # What shows beside what the textures leave wrong
            tolerance = max(spec.diffusion.tolerance, spec.relight.tolerance)
            switch = TransmissionSwitch(spec.terms.transmission, tolerance, self._terms_left())
            thin, line = look_behind(skin, switch, partial(transmit, diffused))
            lobe = None
            if thin is not None:
                lobe, line = transmit(diffused, thin, switch)
            self.lines.append(Decision("relight.transmission", line.enabled, line.why, line.error))
            self.thin = thin if lobe else None
            if lobe and thin:
                enters = [self._even_rgb * albedo_of(scene.maps, tile.raster, scene.mesh) for tile in thin.tiles]
                even = part_even_light(diffused, thin, self._curved, enters, self._weights)
                self._straight, self._kept = even
                hold_back(lobe, thin, self._kept)
            return lobe
        if self.thin is None:
            return None
        if self._flesh_light is None:
            self._flesh_light = FleshLight(diffused, self.thin, self._kept)
        return self._flesh_light.lobe(diffused)

    def _sent_on(
        self, through: Lobe, lobes: tuple[Lobe, ...], light: Tiles, names: tuple[str, ...], left: Tiles
    ) -> Lobe:
        """The same with what other skin gets of it; `left` is the sum of the lobes."""
        if self.thin is None or self.view is None or self._bounces is None:
            return through
        seen = [fitted(colour, r.shape) for colour, r in zip(self._reflected, self.view.atlas, strict=True)]
        gain, bounces = dict.fromkeys(names, self._again), dict.fromkeys(names, (self._bounces, 0.0))
        skin_light = SkinLight(self.view, seen, gain, bounces)
        entered = SmallLight.of(light, self.thin)
        spec, scene, gaussians = self._spec, self._scene, self._skin.gaussians
        if self._small_blur is None:
            small = self.view.atlas
            self._small_blur = SmallBlur(small, scene.mesh, gaussians, scene.maps, spec.diffusion, lobes)
        return sent_on(
            through, lobes, entered, names, skin_light, self._small_blur, spec, scene, gaussians, left=left,
            curved=self._curved,
        ).lobe  # fmt: skip


def summed_lobes(lobes: tuple[Lobe, ...], weights: SkinWeights, tile: int, shape: tuple[int, int]) -> Image:
    """Weighted sum of lobes, each read bilinearly at the full size, (L, H, W, 3).

    Parameters
    ----------
    lobes : tuple of Lobe
    weights : SkinWeights
        Of these lobes.
    tile : int
    shape : (H, W)
    """
    out = np.zeros((len(lobes[0].rgb[tile]), *shape, 3), np.float32)
    for i, lobe in enumerate(lobes):
        _add_lobe(lobe, weights.image(i, tile, shape), tile, out)
    return out


def _add_lobe(lobe: Lobe, weight: Image, tile: int, out: Image) -> None:
    """Add a lobe times its weight at each place, read bilinearly, to (L, H, W, 3)."""
    on_threads(lambda k: add_magnified(lobe.rgb[tile][k], weight, out[k]), len(out))
