"""Light from all around: an equirectangular radiance map, or a constant."""

from __future__ import annotations

import zlib

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster
from skinbake.irradiance.environment_map import environment_samples, irradiance_table, look_up
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import albedo_at
from skinbake.irradiance.refine import refine
from skinbake.irradiance.surface import TexelSurface
from skinbake.numerics import Float
from skinbake.scene.lights import EnvironmentLight

Image = NDArray[np.float32]
DEFAULT_SAMPLES = 256
LATTICE_MM = 4.0  # between the first texels traced: ambient light varies over what shades it, not over texels
VARIATION = 0.05  # of the visible share, above which texels between lattice points are traced
CHUNK = 1 << 20


def light_environment(
    surface: TexelSurface,
    occluder: Occluder,
    light: EnvironmentLight,
    casts: bool,
    radiance: Image | None,
    table: Float,
    f0: float,
    seed: int,
) -> tuple[Image, Image]:
    """Irradiance (H, W, 3) and unshadowed share (H, W).

    Irradiance without shadows comes from a table over all normals, integrated exactly. Shadows multiply it by the share
    that `samples` directions find open, drawn in proportion to radiance and the same for every texel, so that the
    result is smooth. The ratio is exact wherever nothing is in the way, whatever the directions.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3), optional
        Of a light with a path.
    """
    if light.radiance is not None:
        radiance = np.full((8, 16, 3), light.radiance, np.float32)
    if radiance is None:
        raise ValueError(f"light {light.name}: expected its radiance map, got none")
    addressed = surface.raster.addressed
    irradiance = np.zeros((*addressed.shape, 3), np.float32)
    look_up(irradiance_table(radiance, light.rotate_deg) * light.scale, surface.normal, addressed, irradiance)
    if not casts and not table.size:
        return irradiance, addressed.astype(np.float32)

    offset = (seed * 0x9E3779B97F4A7C15 + zlib.crc32(light.name.encode())) % 2**32 / 2**32
    directions, weights = environment_samples(radiance, light.samples or DEFAULT_SAMPLES, light.rotate_deg, offset)
    origin, normal = surface.origin.reshape(-1, 3), surface.smooth_normal.reshape(-1, 3)
    roughness = np.broadcast_to(surface.roughness, addressed.shape).reshape(-1)
    strength = np.broadcast_to(surface.strength, addressed.shape).reshape(-1)

    def trace(texels: NDArray[np.int64]) -> Image:
        out = np.empty((len(texels), 4), np.float32)
        step = max(1, CHUNK // len(directions))
        for start in range(0, len(texels), step):
            part = texels[start : start + step]
            bounds, sample = _above(normal[part], directions)
            clear = np.ones(len(sample), np.bool_)
            if casts:
                starts, rays = np.empty((len(sample), 3), np.float32), np.empty((len(sample), 3), np.float32)
                _aim(bounds, sample, origin[part], directions, starts, rays)
                clear = ~occluder.occluded(starts, rays, np.full(len(sample), np.inf, np.float32))
            _shares(
                bounds, sample, clear, normal[part], directions, weights, roughness[part], strength[part], table, f0,
                out[start : start + step],
            )  # fmt: skip
        return out

    share = refine(addressed, surface.smooth_normal, 4, trace, VARIATION, lattice(surface.raster))
    return irradiance * share[..., :3], np.ascontiguousarray(share[..., 3])


def lattice(raster: AtlasRaster) -> int:
    """Texels, a power of two up to 32, that span `LATTICE_MM` on average: finer textures do not ask for more rays."""
    texels, area = raster.coverage.sum(dtype=np.float64), raster.area_mm2.sum(dtype=np.float64)
    if texels == 0 or area == 0:
        return 1
    return int(2 ** np.clip(np.floor(np.log2(LATTICE_MM / np.sqrt(area / texels))), 0, 5))


@njit(cache=True, parallel=True)
def _above(normal: Image, directions: Image) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Directions above each texel's horizon, as compressed lists."""
    count = np.zeros(len(normal) + 1, dtype=np.int64)
    for i in prange(len(normal)):
        for s in range(len(directions)):
            c = normal[i, 0] * directions[s, 0] + normal[i, 1] * directions[s, 1] + normal[i, 2] * directions[s, 2]
            if c > 0.0:
                count[i + 1] += 1
    bounds = np.cumsum(count)
    sample = np.empty(bounds[-1], dtype=np.int32)
    for i in prange(len(normal)):
        k = bounds[i]
        for s in range(len(directions)):
            c = normal[i, 0] * directions[s, 0] + normal[i, 1] * directions[s, 1] + normal[i, 2] * directions[s, 2]
            if c > 0.0:
                sample[k] = s
                k += 1
    return bounds, sample


@njit(cache=True, parallel=True)
def _aim(
    bounds: NDArray[np.int64], sample: NDArray[np.int32], origin: Image, directions: Image, starts: Image, rays: Image
) -> None:
    for i in prange(len(origin)):
        for k in range(bounds[i], bounds[i + 1]):
            for axis in range(3):
                starts[k, axis] = origin[i, axis]
                rays[k, axis] = directions[sample[k], axis]


@njit(cache=True, parallel=True)
def _shares(
    bounds: NDArray[np.int64],
    sample: NDArray[np.int32],
    clear: NDArray[np.bool_],
    normal: Image,
    directions: Image,
    weights: Image,
    roughness: Image,
    strength: Image,
    table: Float,
    f0: float,
    out: Image,
) -> None:
    """Share of each channel that arrives and passes the oil, and of the mean of the channels that arrives."""
    for i in prange(len(normal)):
        sent, passed = np.zeros(4), np.zeros(4)
        for j in range(bounds[i], bounds[i + 1]):
            s = sample[j]
            cosine = np.float64(normal[i, 0]) * directions[s, 0]
            cosine += np.float64(normal[i, 1]) * directions[s, 1] + np.float64(normal[i, 2]) * directions[s, 2]
            oil = 1.0
            if table.size > 0:
                oil = min(max(1.0 - strength[i] * albedo_at(table, cosine, roughness[i], f0), 0.0), 1.0)
            for k in range(3):
                sent[k] += cosine * weights[s, k]
                sent[3] += cosine * weights[s, k]
                if clear[j]:
                    passed[k] += cosine * weights[s, k] * oil
                    passed[3] += cosine * weights[s, k]
        for k in range(4):
            out[i, k] = passed[k] / sent[k] if sent[k] > 0.0 else 0.0
