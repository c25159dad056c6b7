"""The bake on one screen: what is called, in which order, on which data. No file, clock or print below this line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, rasterize, sample_map
from skinbake.diffuse import DiffuseMap, diffuse
from skinbake.diffuse.diffuse_map import Decision
from skinbake.diffuse.memoize import Memoize
from skinbake.diffuse.memory import check_memory
from skinbake.diffuse.terms.transmission import transmit
from skinbake.irradiance import IrradianceMap, light_texels
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import mean_specular_albedo
from skinbake.numerics import Float
from skinbake.profile import FitReport, GaussianSum, fit_skin
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

Say = Callable[[str], None]
Rounded = Callable[[NDArray[np.float32]], NDArray[np.floating]]


@dataclass(frozen=True)
class SceneData:
    """What a look's files hold, read.

    Attributes
    ----------
    mesh : SkinMesh
    maps : SkinMaps
    environments : mapping of light name to ndarray of shape (h, w, 3), linear radiance
    building : Future of Occluder, optional
        Of the mesh, where somebody has begun to make one.
    """

    mesh: SkinMesh
    maps: SkinMaps
    environments: Mapping[str, NDArray[np.float32]]
    building: Future[Occluder] | None = None

    @cached_property
    def occluder(self) -> Occluder:
        """What rays meet, one for the whole bake."""
        return self.building.result() if self.building else Occluder(self.mesh)


@dataclass(frozen=True)
class Baked:
    """Everything a bake computes."""

    profile: FitReport
    atlas: Atlas
    irradiance: tuple[IrradianceMap, ...]
    diffuse: DiffuseMap


def bake(spec: SceneSpec, scene: SceneData, profile_table: tuple[Float, Float] | None = None) -> Baked:
    """The five steps in memory; the verbs run the same steps with files between them."""
    profile = fit_skin(spec.skin, profile_table)
    atlas = atlas_of(spec, scene.mesh)
    irradiance = light_skin(spec, scene, atlas)
    return Baked(profile, atlas, irradiance, scatter(spec, scene, atlas, irradiance, profile.gaussians))


def atlas_of(spec: SceneSpec, mesh: SkinMesh) -> Atlas:
    """Raster of the mesh at the look's texture size."""
    return rasterize(mesh, spec.texture.size, spec.texture.gutter, spec.texture.udim)


def refuse_too_large(spec: SceneSpec, tiles: int) -> None:
    """Stop before anything is rasterised that this machine cannot hold.

    Raises
    ------
    MachineError
    """
    lights = len(spec.lights) if spec.output.lights == "separate" else 1
    check_memory(spec.texture.size[::-1], lights, tiles, 6, spec.diffusion.method)


def light_skin(
    spec: SceneSpec,
    scene: SceneData,
    atlas: Atlas,
    names: tuple[str, ...] | None = None,
    rounded: Rounded = lambda image: image,
) -> tuple[IrradianceMap, ...]:
    """Irradiance of the look's lights, or of those in `names`; a light's values do not depend on the others.

    Each is `rounded` before the next is computed.
    """
    return light_texels(
        atlas,
        scene.mesh,
        scene.maps,
        tuple(light for light in spec.lights if names is None or light.name in names),
        shadows=spec.shadows,
        specular=spec.specular,
        energy_conservation=energy_conservation(spec).kept,
        environments=scene.environments,
        seed=spec.output.seed,
        tolerance=spec.diffusion.tolerance,
        occluder=scene.occluder,
        rounded=rounded,
    )


def scatter(
    spec: SceneSpec,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    gaussians: GaussianSum,
    say: Say | None = None,
    remember: Memoize | None = None,
) -> DiffuseMap:
    """Lobes of irradiance times albedo^x, x = 1 for pre-scatter texturing, and light through thin parts."""
    names, light = irradiance[0].lights, {tile.tile: tile.rgb for tile in irradiance}
    if spec.output.lights == "total":  # blurring is linear: what is stored summed is blurred summed
        names = ("total",)
        light = {tile: rgb.sum(axis=0, keepdims=True, dtype=np.float32) for tile, rgb in light.items()}
    coloured, mean_albedo = _coloured(light, spec, scene, atlas)
    diffused = diffuse(
        coloured,
        names,
        atlas,
        scene.mesh,
        gaussians,
        spec.diffusion,
        seed=spec.output.seed,
        precision=spec.output.precision,
        progress=say,
        remember=remember,
    )
    del coloured
    texture, terms = spec.texture, spec.terms
    through, line = transmit(
        diffused,
        scene.mesh,
        gaussians,
        texture.size,
        texture.gutter,
        texture.udim,
        mean_albedo,
        terms.transmission,
        spec.diffusion.tolerance,
        None if terms.transmission == "off" else scene.occluder,
    )
    return replace(diffused, lobes=diffused.lobes + ((through,) if through else ()), plan=(*diffused.plan, line))


def _coloured(
    light: Mapping[int, NDArray[np.floating]], spec: SceneSpec, scene: SceneData, atlas: Atlas
) -> tuple[dict[int, NDArray[np.float32]], Float]:
    """Light times albedo^x, by tile, and the mean albedo of the skin."""
    exponent = np.float32(spec.texturing.exponent_before)
    albedo = [albedo_of(scene.maps, raster, scene.mesh) for raster in atlas]
    area = [raster.area_mm2[..., None] for raster in atlas]
    total = sum((a * c).sum(axis=(0, 1), dtype=np.float64) for a, c in zip(area, albedo, strict=True))
    coloured = {tile: rgb * colour**exponent for (tile, rgb), colour in zip(light.items(), albedo, strict=True)}
    return coloured, total / sum(map(np.sum, area))


def albedo_of(maps: SkinMaps, raster: AtlasRaster, mesh: SkinMesh) -> NDArray[np.float32]:
    """Linear albedo at the texels of a tile, shape (H, W, 3), or (1, 1, 3) where it is the same everywhere."""
    if raster.tile not in maps.albedo:
        return np.array(maps.albedo_rgb, np.float32).reshape(1, 1, 3)
    return np.maximum(sample_map(raster, mesh, maps.albedo, maps.albedo_rgb), 0)


def energy_conservation(spec: SceneSpec) -> Decision:
    """Whether the oil layer's share is taken off the light that enters, and the share that decides `auto`."""
    share = float(spec.specular.strength * mean_specular_albedo(spec.specular.roughness, spec.specular.f0))
    wanted = spec.terms.energy_conservation
    kept = share > spec.diffusion.tolerance if wanted == "auto" else wanted == "on"
    reason = f"the oil layer reflects {share:.2%} of diffuse light"
    return Decision("energy_conservation", kept, f"{wanted}: {reason}, tolerance {spec.diffusion.tolerance:.2%}")


def plan_of(spec: SceneSpec, irradiance: tuple[IrradianceMap, ...], diffused: DiffuseMap) -> tuple[Decision, ...]:
    """Every decision of a bake, in the order of its stages."""
    first = irradiance[0]
    lights = tuple(line for name in first.lights for line in first.plan.get(name, ()))
    return (energy_conservation(spec), *lights, *diffused.plan)
