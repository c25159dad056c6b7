"""From light that arrives to what is blurred: incidence, light from skin to skin, and the albedo's share before.

Irradiance stays what the lights send, whatever the skin is: a look with another skin reuses it. What a medium and a
face make of it begins here, light by light, so that each stays linear in its light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, sample_map
from skinbake.diffuse.terms.interreflection import (
    add_at_full_size,
    bounced_light,
    decide_interreflection,
    look_around,
    receivers,
)
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.normal_map import shading_normals
from skinbake.irradiance.oil_albedo import mean_specular_albedo
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.slant import Slant, apply_slant, decide_incidence, slant_of
from skinbake.numerics import Float
from skinbake.profile import GaussianSum
from skinbake.profile.incidence import Incidence
from skinbake.scene.decision import TOTAL_LIGHT, Decision, Decisions
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]


@dataclass(frozen=True)
class LightEntering:
    """Light as the Gaussians blur it.

    Attributes
    ----------
    names : tuple of L str
        Of the lights, or "total" where they are summed.
    rgb : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile, times albedo^x.
    mean_albedo : ndarray of shape (3,)
        Of the skin.
    plan : tuple of Decision
    """

    names: tuple[str, ...]
    rgb: dict[int, Image]
    mean_albedo: Float
    plan: tuple[Decision, ...]


def light_entering(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    gaussians: GaussianSum,
    incidence: Incidence | str,
) -> LightEntering:
    """Irradiance with the terms `incidence` and `interreflection`, times albedo^x; theory.md 9.5, 9.7.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
        Of the look.
    scene : SceneData
    atlas : Atlas
    irradiance : tuple of IrradianceMap
        Of the same tiles.
    gaussians : GaussianSum
        Its total is what comes back of light along the normal.
    incidence : Incidence or str
        Of the skin's medium; or why nothing is known of it.
    """
    slant = incidence if isinstance(incidence, str) else slant_of(incidence, _reference(spec, gaussians, incidence))
    names, slanted, plan = _decide_incidence(spec, irradiance[0].lights, slant)
    light = {}
    lamps = any(not isinstance(of, EnvironmentLight) for of in spec.lights if of.name in slanted)
    for raster, tile in zip(atlas, irradiance, strict=True):
        normal = shading_normals(raster, scene.mesh, scene.maps)[1] if lamps else np.zeros((1, 1, 3), np.float32)
        out = np.zeros((len(names) if decisions.separate_lights else 1, *raster.shape, 3), np.float32)
        for i, name in enumerate(names):
            image = tile.rgb[i].astype(np.float32)
            if name in slanted:
                of_name = next(of for of in spec.lights if of.name == name)
                assert isinstance(slant, Slant)
                apply_slant(raster, normal, scene.occluder, of_name, slant, image)
            # Blurring is linear: what is stored summed is blurred summed
            out[i if decisions.separate_lights else 0] += image
        light[raster.tile] = out
    if not decisions.separate_lights:
        names = (TOTAL_LIGHT,)

    albedo = [albedo_of(scene.maps, raster, scene.mesh) for raster in atlas]
    counted = slanted | ({TOTAL_LIGHT} if slanted else set())
    gain = {name: _entering_again(spec, decisions, slant if name in counted else "off") for name in names}
    plan += _bounce(spec, scene, atlas, names, light, [a * _total(gaussians) for a in albedo], gain)

    area = [raster.area_mm2[..., None] for raster in atlas]
    total = sum((a * c).sum(axis=(0, 1), dtype=np.float64) for a, c in zip(area, albedo, strict=True))
    exponent = np.float32(spec.texturing.exponent_before)
    for (_, rgb), colour in zip(light.items(), albedo, strict=True):
        rgb *= colour**exponent
    return LightEntering(names, light, total / sum(map(np.sum, area)), tuple(plan))


def _reference(spec: SceneSpec, gaussians: GaussianSum, incidence: Incidence) -> Float:
    """Share that a factor of 1 stands for.

    A white profile is that of light from everywhere: a constant sky stays what it was. Else what the profile itself
    says of a beam along the normal.
    """
    return incidence.diffuse_rgb if spec.skin.normalise == "white" else _total(gaussians).astype(np.float64)


def _total(gaussians: GaussianSum) -> Image:
    """What the profile gives back of light, (3,)."""
    return gaussians.weight_rgb.sum(axis=0).astype(np.float32)


def _decide_incidence(
    spec: SceneSpec, names: tuple[str, ...], slant: Slant | str
) -> tuple[tuple[str, ...], set[str], list[Decision]]:
    """Names of the lights, those whose light is multiplied by the factors, and the plan's lines."""
    switch = spec.terms.incidence
    if switch == "off" or isinstance(slant, str):
        why = "off" if switch == "off" else f"{switch}: {slant}"
        return names, set(), [Decision("incidence", False, why)]
    lines = [decide_incidence(light, slant, switch, spec.diffusion.tolerance) for light in spec.lights]
    return names, {of.name for of, line in zip(spec.lights, lines, strict=True) if line.enabled}, lines


def _entering_again(spec: SceneSpec, decisions: Decisions, slant: Slant | str) -> Image:
    """Factor on light from skin that falls on skin: what the oil lets in, and that it comes from everywhere; (3,)."""
    share = 1.0
    if decisions.energy_conservation.enabled:
        oil = spec.specular
        share = float(np.clip(1 - oil.strength * mean_specular_albedo(oil.roughness, oil.f0), 0, 1))
    factor = slant.diffuse_rgb if isinstance(slant, Slant) else np.ones(3)
    return (share * factor).astype(np.float32)


def _bounce(
    spec: SceneSpec,
    scene: SceneData,
    atlas: Atlas,
    names: tuple[str, ...],
    light: dict[int, Image],
    reflected: list[Image],
    gain: dict[str, Image],
) -> list[Decision]:
    """Add to each light what skin sends on to skin, where that is worth it, and say so.

    Parameters
    ----------
    spec : SceneSpec
    scene : SceneData
    atlas : Atlas
    names : tuple of L str
    light : dict of int to ndarray of shape (L, H, W, 3), changed in place
        Irradiance, by tile.
    reflected : list of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of it leaves as M, by tile.
    gain : dict of str to ndarray of shape (3,)
        By light, what of light from skin counts where it enters.
    """
    terms, tolerance, udim = spec.terms, spec.diffusion.tolerance, spec.texture.udim
    if terms.interreflection == "off":
        return [Decision("interreflection", False, "off")]
    again = [colour * np.mean(list(gain.values()), axis=0) for colour in reflected]
    lines = decide_interreflection(
        scene.mesh, scene.occluder, names, list(light.values()), again, atlas, udim, terms.interreflection, tolerance
    )
    if not any(line.enabled for line in lines):
        return lines
    receiver_mm, rays = receivers(tolerance)
    view = look_around(
        scene.mesh, scene.occluder, spec.texture.size, spec.texture.gutter, udim, receiver_mm, rays
    )  # fmt: skip
    for i, (name, line) in enumerate(zip(names, lines, strict=True)):
        if not line.enabled:
            continue
        sent = [rgb[i : i + 1] * colour for rgb, colour in zip(light.values(), reflected, strict=True)]
        found = bounced_light(view, sent, [gain[name] * colour for colour in reflected], terms.bounces)
        for raster, small in zip(atlas, found, strict=True):
            add_at_full_size(gain[name] * small[0], raster, light[raster.tile][i])
    return lines


def albedo_of(maps: SkinMaps, raster: AtlasRaster, mesh: SkinMesh) -> Image:
    """Linear albedo at the texels of a tile, shape (H, W, 3), or (1, 1, 3) where it is the same everywhere."""
    if raster.tile not in maps.albedo:
        return np.array(maps.albedo_rgb, np.float32).reshape(1, 1, 3)
    return np.maximum(sample_map(raster, mesh, maps.albedo, maps.albedo_rgb), 0)
