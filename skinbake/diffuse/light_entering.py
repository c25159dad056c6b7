"""From light that arrives to what is blurred: incidence, beams, light from skin to skin, and the albedo's share.

Irradiance stays what the lights send, whatever the skin is: a look with another skin reuses it. What a medium and a
face make of it begins here, light by light, so that each stays linear in its light.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, sample_map
from skinbake.diffuse.add_bounces import add_bounces
from skinbake.diffuse.aside import IN_MEMORY, Aside
from skinbake.diffuse.skin_weights import SkinWeights, scatter_of
from skinbake.diffuse.terms.beam import BeamLight, ShiftedLights, decide_beams, free_path_of, has_beam, narrowest_mm2
from skinbake.diffuse.terms.bounced_light import SkinLight
from skinbake.diffuse.terms.curvature import CurvedSkin, curve_skin, formed_already
from skinbake.diffuse.terms.diffuse_profile import (
    LEAST_LEFT,
    TERM,
    DiffuseProfile,
    EverywhereLight,
    layer_of_profile,
)
from skinbake.diffuse.terms.skin_view import SkinView
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.normal_map import shading_normals
from skinbake.irradiance.oil_albedo import mean_specular_albedo, oil_table
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.slant import SkySlant, Slant, apply_slant, decide_incidence, slant_of, slant_of_sky
from skinbake.kernels.threads import for_slices
from skinbake.machine import return_freed
from skinbake.numerics import Float, Zeros
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.scene.budget import Budget, left_wrong
from skinbake.scene.decision import TOTAL_LIGHT, Decision, Decisions
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
_ROWS = 256  # that are summed at a time


@dataclass(frozen=True)
class LightEntering:
    """Light as the Gaussians blur it.

    Attributes
    ----------
    names : tuple of L str
        Of the lights, or "total" where they are summed.
    rgb : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile, times albedo^x.
    beam : BeamLight, optional
        The same for wider lobes: what lamps send stands where it first scatters.
    mean_albedo : ndarray of shape (3,)
        Of the skin.
    even_rgb : ndarray of shape (3,)
        How many times light from everywhere counts, by its incidence.
    slanted : frozenset of str
        Lights of the look that count by their incidence.
    plan : tuple of Decision
    curved : CurvedSkin, optional
        What curvature makes of the lobes, where that is counted.
    skin_light : SkinLight, optional
        How skin lights skin, where that is counted.
    everywhere : EverywhereLight, optional
        What of `rgb` comes from everywhere, where its lobes weigh otherwise.
    """

    names: tuple[str, ...]
    rgb: dict[int, Image]
    beam: BeamLight | None
    mean_albedo: Float
    even_rgb: Image
    slanted: frozenset[str]
    plan: tuple[Decision, ...]
    curved: CurvedSkin | None = None
    skin_light: SkinLight | None = None
    everywhere: EverywhereLight | None = None

    def digests(self) -> dict[str, str]:
        """Digest of each light by name: the same light gives the same lobes, whatever it was made of."""
        found = {}
        for i, name in enumerate(self.names):
            digest = hashlib.sha256(repr(self.beam and self.beam.narrowest_mm2).encode())
            for images in (self.rgb, self.beam.rgb if self.beam else {}):
                for tile, rgb in images.items():
                    digest.update(f"{tile} {rgb[i].shape}".encode())
                    digest.update(np.ascontiguousarray(rgb[i]).data)
            if self.everywhere and any(rgb[i].any() for rgb in self.everywhere.rgb.values()):
                digest.update(self.everywhere.factor.tobytes())
                for tile, rgb in self.everywhere.rgb.items():
                    digest.update(np.ascontiguousarray(rgb[i]).data)
                    digest.update(np.ascontiguousarray(self.everywhere.gain[tile]).data)
            found[name] = digest.hexdigest()
        return found


def light_entering(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    skin: EnteredSkin,
    aside: Aside = IN_MEMORY,
    view: SkinView | None = None,
) -> LightEntering:
    """Irradiance with the terms `incidence`, `beam`, `interreflection`, `diffuse_profile`, times albedo^x; theory.md 9.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
        Of the look.
    scene : SceneData
    atlas : Atlas
    irradiance : tuple of IrradianceMap
        Of the same tiles.
    skin : EnteredSkin
    aside : Aside, optional
        Where large arrays stand while they are not read.
    view : SkinView, optional
        What the skin sees of itself, where somebody has looked around already.
    """
    gaussians, medium, incidence = skin
    slant = slant_of(incidence, skin.reference_rgb) if incidence else None
    names = irradiance[0].lights
    skies = {}
    if slant and spec.terms.incidence != "off":
        skies = {
            of.name: slant_of_sky(slant, scene.environments[of.name], of.rotate_deg)
            for of in spec.lights
            if isinstance(of, EnvironmentLight) and of.name in scene.environments
        }
    budget = decisions.budget
    slanted, plan = _decide_incidence(spec, budget, slant, skies, medium.why)
    albedo = [aside.array(albedo_of(scene.maps, raster, scene.mesh)) for raster in atlas]
    total = np.sum([_area_sum(r.area_mm2, colour) for r, colour in zip(atlas, albedo, strict=True)], axis=0)
    mean_albedo = total / sum(np.sum(raster.area_mm2) for raster in atlas)
    exponent = np.float32(spec.texturing.exponent_before)
    terms = spec.terms
    beams = terms.beam != "off" and any(has_beam(light) for light in spec.lights)
    flat = None
    if beams and gaussians.normalise == "white":
        # A white profile has the skin's own form in it: curvature only spreads beams, if a plane would have any shifted
        flat = decide_beams(spec, budget, scene, atlas, irradiance, skin, mean_albedo, None)
        beams = bool(flat[1])
    curved, line = curve_skin(scene.mesh, spec.texture, gaussians, medium, terms.curvature, budget.negligible, beams)
    if flat is None or curved is not None:
        before = flat[0] if flat else ()
        flat = decide_beams(spec, budget, scene, atlas, irradiance, skin, mean_albedo, curved, before)
    shifts, shifted, lines = flat
    if curved and not shifted and curved.spreads_beams_alone:
        curved, line = None, formed_already(terms.curvature)
    plan += [*lines, line]
    light, further = {}, {}
    turned = any(not of.everywhere or of.name in skies for of in spec.lights if of.name in slanted)
    scatters = scatter_of(gaussians, spec.skin, scene.maps)

    def arrive(raster: AtlasRaster, normal: Image, tile: IrradianceMap, name: str, image: Image) -> None:
        np.copyto(image, tile.rgb[tile.lights.index(name)])
        if name in slanted:
            assert slant is not None
            share = scatters(raster.tile, raster.shape)
            straight = image * (1 - share[..., None]) if (share != 1).any() else None  # what was in no medium
            apply_slant(raster, normal, scene.occluder, spec.light(name), slant, skies.get(name), image)
            if straight is not None:
                image *= share[..., None]
                image += straight

    upstream = ShiftedLights()
    places = [i if decisions.separate_lights else 0 for i in range(len(names))]
    layer = layer_of_profile(spec.skin, medium, gaussians) if terms.diffuse_profile != "off" else ""
    shape = None if isinstance(layer, str) else DiffuseProfile(gaussians, layer, atlas, places[-1] + 1, curved)
    for k, (raster, tile) in enumerate(zip(atlas, irradiance, strict=True)):
        normal = np.zeros((1, 1, 3), np.float32)
        if turned:
            normal = shading_normals(raster, scene.mesh, scene.maps, aside.zeros)[1]
        out = aside.zeros((len(names) if decisions.separate_lights else 1, *raster.shape, 3), np.float32)
        moved = aside.zeros(out.shape, np.float32) if shifted else None
        image = None if decisions.separate_lights else np.empty((*raster.shape, 3), np.float32)
        for i, name in enumerate(names):
            arrived = out[i] if image is None else image
            arrive(raster, normal, tile, name, arrived)
            if image is not None:  # blurring is linear: what is stored summed is blurred summed
                out[0] += image
            if shape and not spec.light(name).everywhere:
                shape.add_lamp(raster.tile, places[i], arrived)
            if moved is not None and name in shifted:
                coloured = arrived * (albedo[k] if exponent == 1 else albedo[k] ** exponent)
                upstream.add(raster, places[i], name, coloured, shifts[k].read(spec.light(name), coloured))
                moved[places[i]] -= coloured
                del coloured
            del arrived
        light[raster.tile] = out
        if moved is not None:
            further[raster.tile] = moved
        del out, moved, normal, image  # large, and the terms that follow need room
    upstream.add_to(further)
    aside.rest()
    return_freed()
    if not decisions.separate_lights:
        names = (TOTAL_LIGHT,)

    counted = slanted | ({TOTAL_LIGHT} if slanted else set())
    gain = {name: entering_again(spec, decisions, slant if name in counted else None) for name in names}
    # What of a light is left out already; of lights that are stored summed, each may be the only one
    held = {name: (name,) if decisions.separate_lights else irradiance[0].lights for name in names}

    def left(name: str) -> float:
        return min(budget.terms_left(of, left_wrong(plan, (of, name), 0.0)) for of in held[name])

    limits = [left(name) for name in names]
    weights = SkinWeights.of(gaussians, scene.maps)
    reflected = [
        _product(a, weights.total_image(r.tile, r.shape, aside.zeros), aside.zeros)
        for a, r in zip(albedo, atlas, strict=True)
    ]
    lines, skin_light = add_bounces(spec, scene, atlas, names, light, reflected, gain, limits, view)
    plan += lines
    del reflected
    everywhere = None
    if shape:
        least = LEAST_LEFT * budget.tolerance
        lines = shape.decide(light, names, terms.diffuse_profile, [max(left(name), least) for name in names])
        kept = [i for i, line in enumerate(lines) if line.enabled]

        def lamps(k: int) -> Iterator[tuple[int, Image]]:
            raster, tile = atlas[k], irradiance[k]
            normal = shading_normals(raster, scene.mesh, scene.maps, aside.zeros)[1]
            image = np.empty((*raster.shape, 3), np.float32)
            for place, name in zip(places, tile.lights, strict=True):
                if place in kept and not spec.light(name).everywhere:
                    arrive(raster, normal, tile, name, image)
                    yield place, image

        everywhere = shape.light(light, kept, lamps, aside.zeros) if kept else None
    else:
        why = f"{terms.diffuse_profile}: {layer}" if layer else "off"
        lines = [Decision(TERM, False, why)]
    plan += lines

    for (tile_number, rgb), colour in zip(light.items(), albedo, strict=True):
        for images in [rgb] if everywhere is None else [rgb, everywhere.rgb[tile_number]]:
            images *= colour if exponent == 1 else colour**exponent
        if tile_number in further:
            further[tile_number] += rgb
            np.maximum(further[tile_number], 0, out=further[tile_number])  # round-off
    free_path = free_path_of(medium, gaussians)
    beam = None if isinstance(free_path, str) or not further else BeamLight(further, narrowest_mm2(free_path[0]))
    even_rgb = (slant.diffuse_rgb if slant and slanted else np.ones(3)).astype(np.float32)
    return LightEntering(
        names, light, beam, mean_albedo, even_rgb, frozenset(slanted), tuple(plan), curved, skin_light, everywhere
    )


def _product(one: Image, other: Image, zeros: Zeros) -> Image:
    """Product of two images that fit one another, in an array that `zeros` makes."""
    out: Image = np.multiply(one, other, out=zeros(np.broadcast_shapes(one.shape, other.shape), np.float32))
    return out


def _area_sum(area_mm2: Image, colour: Image) -> Float:
    """Sum over texels of area times colour, (3,), some rows at a time.

    Parameters
    ----------
    area_mm2 : ndarray of shape (H, W)
    colour : ndarray of shape (H, W, 3) or (1, 1, 3)
    """
    sums = np.zeros((-(-len(area_mm2) // _ROWS), 3))

    def add(rows: slice) -> None:
        weighted = area_mm2[rows, :, None] * (colour[rows] if len(colour) > 1 else colour)
        sums[rows.start // _ROWS] = weighted.sum(axis=(0, 1), dtype=np.float64)

    for_slices(add, len(area_mm2), _ROWS)
    total: Float = sums.sum(axis=0)
    return total


def _decide_incidence(
    spec: SceneSpec, budget: Budget, slant: Slant | None, skies: dict[str, SkySlant], why_not: str
) -> tuple[set[str], list[Decision]]:
    """Names of the lights whose light is multiplied by the factors, and the plan's lines."""
    switch = spec.terms.incidence
    if switch == "off" or slant is None:
        return set(), [Decision("incidence", False, "off" if switch == "off" else f"{switch}: {why_not}")]
    lines = [decide_incidence(light, slant, skies.get(light.name), switch, budget.negligible) for light in spec.lights]
    return {of.name for of, line in zip(spec.lights, lines, strict=True) if line.enabled}, lines


def entering_again(spec: SceneSpec, decisions: Decisions, slant: Slant | None) -> Image:
    """Factor on light from skin that falls on skin: what the oil lets in, and that it comes from everywhere; (3,).

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
    slant : Slant, optional
        None where incidence is not counted.
    """
    share = 1.0
    if decisions.energy_conservation.enabled:
        oil = spec.specular
        share = float(np.clip(1 - oil.strength * mean_specular_albedo(oil.roughness, oil.f0, oil_table(oil)), 0, 1))
    factor = slant.diffuse_rgb if slant else np.ones(3)
    return (share * factor).astype(np.float32)


def albedo_of(maps: SkinMaps, raster: AtlasRaster, mesh: SkinMesh) -> Image:
    """Linear albedo at the texels of a tile, shape (H, W, 3), or (1, 1, 3) where it is the same everywhere.

    Parameters
    ----------
    maps : SkinMaps
    raster : AtlasRaster
    mesh : SkinMesh
    """
    if raster.tile not in maps.albedo:
        return np.array(maps.albedo_rgb, np.float32).reshape(1, 1, 3)
    image = sample_map(raster, mesh, maps.albedo, maps.albedo_rgb)
    return np.maximum(image, 0, out=image)
