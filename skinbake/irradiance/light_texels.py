"""Irradiance of an atlas's texels under a look's lights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, Atlas
from skinbake.irradiance.environment import light_environment
from skinbake.irradiance.environment_plan import plan_environment
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import OilLayer, oil_table
from skinbake.irradiance.punctual_light import Unshadowed, colour, emitter, unshadowed
from skinbake.irradiance.rectangle import light_rectangle
from skinbake.irradiance.rectangle_plan import RectanglePoints, plan_rectangle
from skinbake.irradiance.shadow import visibility
from skinbake.irradiance.sky_points import SkyPoints
from skinbake.irradiance.sky_texels import SkyTexels, sky_texels
from skinbake.irradiance.surface import TexelSurface, texel_surface
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, Zeros
from skinbake.profile import GaussianSum
from skinbake.scene.decision import Decision
from skinbake.scene.lights import EnvironmentLight, LightSpec, RectangleLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec

Image = NDArray[np.float32]
Kept = NDArray[np.floating]
DARK = "no skin gets any of its light; is it where it should be, does it look the right way, is it not black?"


def light_texels(
    atlas: Atlas,
    mesh: SkinMesh,
    maps: SkinMaps,
    lights: Sequence[LightSpec],
    shadows: bool = True,
    specular: SpecularSpec | None = None,
    energy_conservation: bool = False,
    environments: Mapping[str, Image] | None = None,
    seed: int = 0,
    tolerance: float = 0.01,
    occluder: Occluder | None = None,
    seen: SkyTexels | None = None,
    gaussians: GaussianSum | None = None,
    rounded: Callable[[Image], NDArray[np.floating]] = lambda image: image,
    tell: Callable[[str], None] = lambda text: None,
    zeros: Zeros = np.zeros,
) -> tuple[IrradianceMap, ...]:
    """Irradiance of each light at each texel, one map a tile.

    Each light's values depend on that light alone, not on which others are asked for, nor on the number of threads.

    Parameters
    ----------
    atlas : Atlas
    mesh : SkinMesh
    maps : SkinMaps
        Normal, roughness and specular maps; the albedo is not used: irradiance is light, not colour.
    lights : sequence of LightSpec
    shadows : bool
        For lights that do not say.
    specular : SpecularSpec
        The oil layer, used with `energy_conservation`.
    energy_conservation : bool
        Multiplies by rho_dt(N.L, m), the share that the oil layer lets through; theory.md 7.1.
    environments : mapping of light name to ndarray of shape (h, w, 3)
        Radiance maps of the environment lights that have a path.
    seed : int
        For the samples of area and environment lights.
    tolerance : float
        Rms error of the light of an environment or a rectangle, by which its plan is made.
    occluder : Occluder, optional
        The mesh's, where somebody has one already.
    seen : SkyTexels, optional
        Of the mesh and the texture, likewise: skies are planned by what they see.
    gaussians : GaussianSum, optional
        Of the skin, which smooths a rectangle's noise; else nothing does.
    rounded : callable
        Takes a light's (H, W, 4), irradiance and unshadowed share, and gives what is to be kept of it before the next
        is computed in its place: with halves, only one light's floats are in memory.
    tell : callable
        Told in words which light begins.
    zeros : callable, optional
        Makes images that stay for longer.
    """
    specular, occluder = specular or SpecularSpec(), occluder or Occluder(mesh)
    table = oil_table(specular) if energy_conservation else np.zeros((0, 0, 2))
    height, width = atlas[0].shape
    size, udim = (width, height), [raster.tile for raster in atlas] != [FIRST_TILE]
    points = SkyPoints(seen or sky_texels(mesh, occluder, size, 0, udim), size, tolerance)
    skies = {
        light.name: plan_environment(light, (environments or {}).get(light.name), points, shadows, tolerance, seed)
        for light in lights
        if isinstance(light, EnvironmentLight)
    }
    points_of_rectangles = RectanglePoints(mesh, occluder, size, gaussians)
    rectangles = {
        light.name: plan_rectangle(light, points_of_rectangles, light.casts(shadows), tolerance, seed)
        for light in lights
        if isinstance(light, RectangleLight)
    }
    plan = {name: each.lines for name, each in (skies | rectangles).items() if each.lines}
    names = tuple(light.name for light in lights)
    maps_out, dark = [], set(names)
    for raster in atlas:
        surface = texel_surface(raster, mesh, maps, specular, occluder, zeros)
        rgb = visible = None
        lit = zeros((*raster.shape, 4), np.float32)  # irradiance, and the unshadowed share
        for k, light in enumerate(lights):
            tell(f"{light.name}, {k + 1} of {len(lights)}")
            casts = light.casts(shadows)
            if isinstance(light, RectangleLight):
                arriving, lit[..., 3] = light_rectangle(
                    surface, occluder, light, casts, table, seed, rectangles[light.name].grid
                )
                np.multiply(arriving[..., None], np.asarray(light.radiance, np.float32), out=lit[..., :3])
            elif isinstance(light, EnvironmentLight):
                light_environment(surface, occluder, skies[light.name], table, lit)
            else:
                _light_one(surface, occluder, light, casts, table, lit)
            kept = rounded(lit)
            rgb = _with(rgb, k, kept[..., :3], len(lights), zeros)
            visible = _with(visible, k, kept[..., 3], len(lights), zeros)
        del surface, lit, kept
        assert rgb is not None
        assert visible is not None
        dark -= {name for name, image in zip(names, rgb, strict=True) if any(row.any() for row in image)}
        maps_out.append(IrradianceMap(raster.tile, names, rgb, visible, raster.coverage, plan))
    for name in names:
        if name in dark:
            plan[name] = (*plan.get(name, ()), Decision(name, False, DARK))
    return tuple(maps_out)


def _with(images: Kept | None, k: int, image: Kept, count: int, zeros: Zeros) -> Kept:
    """Images of lights one behind the other, (L, ...), with that of light k, of the type that holds those so far.

    Parameters
    ----------
    images : ndarray of shape (L, ...), optional
        Of the lights before.
    k : int
    image : ndarray of shape (...)
    count : int
        How many lights there are.
    zeros : callable
        Makes the array.
    """
    kind = image.dtype if images is None else np.result_type(images, image)
    if images is None or images.dtype != kind:
        wider = zeros((count, *image.shape), kind)
        if images is not None:
            wider[:k] = images[:k]
        images = wider
    images[k] = image
    return images


def _light_one(
    surface: TexelSurface,
    occluder: Occluder,
    light: LightSpec,
    casts: bool,
    table: Float,
    out: Image,
) -> None:
    """Irradiance and unshadowed share of a directional, point or spot light, written to `out` (H, W, 4)."""
    source = emitter(light, occluder.centre_mm)
    arriving, facing = np.empty(out.shape[:2], np.float32), np.empty(out.shape[:2], np.bool_)
    oil = OilLayer(surface.roughness, surface.strength, table, surface.f0)
    parallel_for(
        unshadowed, len(arriving), source, surface.texels, surface.subdivided, oil, Unshadowed(arriving, facing)
    )
    seen = visibility(surface, occluder, source, facing) if casts else facing.astype(np.float32)
    parallel_for(_colour, len(out), arriving, seen, colour(light), out)


@kernel
def _colour(first: int, stop: int, arriving: Image, seen: Image, light_rgb: Float, out: Image) -> None:
    """Irradiance (R, G, B) and unshadowed share, written to `out` (H, W, 4).

    Parameters
    ----------
    first, stop : int
        Rows.
    arriving, seen : ndarrays of shape (H, W)
        Irradiance of a unit light, and the unshadowed share.
    light_rgb : ndarray of shape (3,)
    out : ndarray of shape (H, W, 4)
    """
    for row in range(first, stop):
        for col in range(arriving.shape[1]):
            value = np.float64(arriving[row, col]) * np.float64(seen[row, col])
            for k in range(3):
                out[row, col, k] = value * light_rgb[k]
            out[row, col, 3] = seen[row, col]
