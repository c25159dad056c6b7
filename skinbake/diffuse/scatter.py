"""Light leaving the skin of a look: `diffuse` and `transmit` with what the look says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, sample_map
from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.diffuse_map import DiffuseMap
from skinbake.diffuse.memoize import Memoize
from skinbake.diffuse.memory import check_memory
from skinbake.diffuse.terms.transmission import transmit
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.scene_data import SceneData
from skinbake.numerics import Float
from skinbake.profile import GaussianSum
from skinbake.scene.decision import TOTAL_LIGHT, Decisions
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

LIKELY_LOBES = 6  # before the profile is fitted


def scatter(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    gaussians: GaussianSum,
    say: Callable[[str], None] | None = None,
    remember: Memoize | None = None,
) -> DiffuseMap:
    """Lobes of irradiance times albedo^x, x = 1 for pre-scatter texturing, and light through thin parts.

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
    say : callable, optional
        Told in words what begins.
    remember : callable, optional
        As in `diffuse`.
    """
    names, light = irradiance[0].lights, {tile.tile: tile.rgb for tile in irradiance}
    if not decisions.separate_lights:  # blurring is linear: what is stored summed is blurred summed
        names = (TOTAL_LIGHT,)
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


def refuse_too_large(spec: SceneSpec, decisions: Decisions, tiles: int) -> None:
    """Stop before anything is rasterised that this machine cannot hold.

    Raises
    ------
    MachineError
    """
    lights = len(decisions.stored_lights)
    check_memory(spec.texture.size[::-1], lights, tiles, LIKELY_LOBES, spec.diffusion.method)


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
