"""Whether a look may take the blurs of another one that differs in its skin alone.

Lobes are blurs of the light that enters, by variances that a skin's fit has chosen. A skin whose weights on another's
variances are near enough, and which lets the same light in, may use both: its blurs are then the other's, to the bit,
and the cache has them. What it may differ by is a tenth of its tolerance, in its fit and in each term.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.baking.incidence_table import incidence_table
from skinbake.diffuse.terms.beam import free_path_of
from skinbake.errors import SkinbakeError
from skinbake.io.table import read_profile_csv
from skinbake.irradiance.slant import Slant, slant_difference, slant_of
from skinbake.numerics import Float
from skinbake.profile import GaussianSum, fit_skin
from skinbake.profile.diffuse_shape import diffuse_factors
from skinbake.profile.effective_medium import one_layer
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.fit_onto import fit_onto
from skinbake.profile.skin_medium import SkinMedium, skin_medium
from skinbake.scene.maps import OF_SKIN
from skinbake.scene.skin import SkinSpec
from skinbake.scene.spec import SceneSpec

SHARE = 0.1  # of the tolerance, that the skin which is blurred for may differ by


@dataclass(frozen=True)
class BlurBase:
    """The skin whose blurs a look takes.

    Attributes
    ----------
    look : str
        Name of the look that has it.
    skin : SkinSpec
    gaussians : GaussianSum
        Its fit.
    """

    look: str
    skin: SkinSpec
    gaussians: GaussianSum

    @cached_property
    def medium(self) -> SkinMedium:
        """What light is let into."""
        return skin_medium(self.skin)

    @property
    def identity(self) -> list[Any]:
        """Plain values that tell it from others."""
        fit, medium = self.gaussians, self.medium
        values = [each.tolist() for each in (fit.variance_mm2, fit.weight_rgb, fit.energy_rgb)]
        return [*values, fit.normalise, medium.identity, medium.why, medium.named]


@dataclass(frozen=True)
class SharedBlurs:
    """Whether a look's blurs are another's.

    Attributes
    ----------
    base : BlurBase or None
        None where the look is blurred by itself.
    why : str
        In words: whose, and how near the fit is; or what keeps the look from it.
    """

    base: BlurBase | None
    why: str


def share_blurs(spec: SceneSpec, look: str, of: SceneSpec) -> SharedBlurs:
    """Whether a look may take the blurs of another one with which it has all but its skin in common.

    Parameters
    ----------
    spec : SceneSpec
    look : str
        Name of the other one.
    of : SceneSpec
    """
    skin, other = spec.skin, of.skin
    if spec.relight is not None:
        return SharedBlurs(None, "relight has blurs of its own")
    varied = [name for name in OF_SKIN if getattr(spec.maps, name) is not None]
    if varied:
        return SharedBlurs(None, f"maps.{varied[0]} varies the skin")
    if getattr(skin, "albedo", None) is not None or getattr(other, "albedo", None) is not None:
        return SharedBlurs(None, "skin.albedo makes another colour of each skin")
    if "transport" in (skin.model, other.model):
        return SharedBlurs(None, "skin.model: transport is walked, with noise")
    for key in ("normalise", "scatter", "fit"):
        if getattr(skin, key) != getattr(other, key):
            return SharedBlurs(None, f"skin.{key} is another than of {look}")
    try:
        base = BlurBase(look, other, fit_skin(other, _csv(other)).gaussians)
        fit = fit_onto(skin, base.gaussians.variance_mm2, _csv(skin)).gaussians
    except SkinbakeError as fault:  # the bakes will say it, with what is to be done
        return SharedBlurs(None, str(fault))
    limit, error = SHARE * spec.diffusion.tolerance, float(fit.relative_error_rgb.max())
    if error > limit:
        return SharedBlurs(None, _beyond(f"on the Gaussians of {look} its fit is off", error, limit))
    why = _other_light(spec, fit, base, limit)
    if why:
        return SharedBlurs(None, why)
    return SharedBlurs(base, f"blurs of {look}, fit {100 * error:.2g} %")


def _other_light(spec: SceneSpec, fit: GaussianSum, base: BlurBase, limit: float) -> str:
    """Why the light that enters the skin is not that of the base; empty where it is, within the limit.

    Parameters
    ----------
    spec : SceneSpec
    fit : GaussianSum
        The skin on the base's variances.
    base : BlurBase
    limit : float
        Share of the light.
    """
    terms, medium = spec.terms, skin_medium(spec.skin)
    if terms.interreflection != "off":
        ours, theirs = (each.weight_rgb.sum(axis=0) for each in (fit, base.gaussians))
        off = float(np.abs(ours - theirs).max() / max(theirs.max(), 1e-12))
        if off > limit:
            return _beyond("interreflection: light from skin differs", off, limit)
    same = medium.identity == base.medium.identity
    if terms.incidence != "off" and not (same and medium.named == base.medium.named and spec.skin.normalise == "white"):
        if bool(medium.layers) != bool(base.medium.layers):
            return f"incidence: {_known(medium, base.look)}"
        if medium.layers:
            off = slant_difference(_slant(fit, medium), _slant(base.gaussians, base.medium))
            if off > limit:
                return _beyond("incidence: slanted light comes back otherwise", off, limit)
    if terms.beam != "off" and not same:
        ours, theirs = free_path_of(medium, fit), free_path_of(base.medium, base.gaussians)
        if isinstance(ours, str) != isinstance(theirs, str):
            return f"beam: {_known(medium, base.look)}"
        if not isinstance(ours, str) and not isinstance(theirs, str):
            off = float(np.abs(ours[0] / theirs[0] - 1).max())
            if ours[1] != theirs[1]:
                return f"beam: skin.eta is another than of {base.look}"
            if off > limit:
                return _beyond("beam: free paths differ", off, limit)
    if terms.diffuse_profile == "on" and not same:
        layers = one_layer(medium, fit), one_layer(base.medium, base.gaussians)
        if isinstance(layers[0], str) or isinstance(layers[1], str):
            neither = isinstance(layers[0], str) and isinstance(layers[1], str)
            return "" if neither else f"diffuse_profile: {_known(medium, base.look)}"
        weight = base.gaussians.weight_rgb
        ours, theirs = diffuse_factors(fit, layers[0]), diffuse_factors(base.gaussians, layers[1])
        off = float((np.abs(weight * (ours - theirs)).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)).max())
        if off > limit:
            return _beyond("diffuse_profile: lobes weigh otherwise", off, limit)
    return ""


def _slant(gaussians: GaussianSum, medium: SkinMedium) -> Slant:
    """What slants make of light in a medium with layers."""
    incidence = incidence_table(medium)
    return slant_of(incidence, EnteredSkin(gaussians, medium, incidence).reference_rgb)


def _known(medium: SkinMedium, look: str) -> str:
    return f"the skin says {'a' if medium.layers else 'no'} medium, that of {look} {'none' if medium.layers else 'one'}"


def _beyond(what: str, off: float, limit: float) -> str:
    return f"{what} by {100 * off:.2g} %, more than a tenth of the tolerance, {100 * limit:.2g} %"


def _csv(skin: SkinSpec) -> tuple[Float, Float] | None:
    """Content of a `table` skin's file."""
    path = getattr(skin, "path", None)
    return read_profile_csv(Path(path)) if path else None
