"""Lights that come from one direction at a time: directional, point and spot."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE
from skinbake.errors import InputError
from skinbake.irradiance.bump_terminator import bump_terminator
from skinbake.irradiance.oil_albedo import OilLayer, albedo_at
from skinbake.irradiance.shadow_origin import SubdividedMesh, SurfaceTexels, point_of
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float, normalized
from skinbake.scene.lights import DirectionalLight, LightSpec, PointLight, SpotLight

Image = NDArray[np.float32]
DIRECTIONAL, POINT = 0.0, 1.0
NEAREST_MM = 1e-3  # a point light in the skin itself would be infinitely bright


def emitter(light: LightSpec, centre_mm: Float) -> Float:
    """A light as ten numbers for the kernels: kind, direction to it or position, axis, cosines of the cone.

    Positions are relative to `centre_mm`.

    Raises
    ------
    InputError
        The light is not directional, point or spot.
    """
    if isinstance(light, DirectionalLight):
        return np.array([DIRECTIONAL, *(-normalized(light.direction)), 0, 0, 0, -2, -3, 0], dtype=np.float64)
    if isinstance(light, SpotLight):
        cone = math.cos(math.radians(light.inner_deg)), math.cos(math.radians(light.outer_deg))
        return np.array([POINT, *(light.position_mm - centre_mm), *normalized(light.axis), *cone, 0])
    if isinstance(light, PointLight):
        return np.array([POINT, *(light.position_mm - centre_mm), 0, 0, 0, -2, -3, 0], dtype=np.float64)
    raise InputError(f"light {light.name}: expected a directional, point or spot light here, got {light.type}")


def colour(light: Any) -> Float:
    """RGB by which the kernels' unit response is multiplied: irradiance of a directional light, intensity of others."""
    return np.asarray(light.irradiance if isinstance(light, DirectionalLight) else light.intensity, dtype=np.float64)


@kernel(inline=True)
def towards(source: Float, px: float, py: float, pz: float) -> tuple[float, float, float, float, float]:
    """Unit direction to the light, distance in mm (inf for a directional one), and cone times 1 / distance^2.

    Theory.md 10.1.

    Parameters
    ----------
    source : ndarray of shape (10,)
        As `emitter` makes it.
    px, py, pz : float
        Point of the skin, mm, about the occluder's centre.
    """
    if source[0] == DIRECTIONAL:
        return source[1], source[2], source[3], np.inf, 1.0
    dx, dy, dz = source[1] - px, source[2] - py, source[3] - pz
    distance = max(np.sqrt(dx * dx + dy * dy + dz * dz), NEAREST_MM)
    dx, dy, dz = dx / distance, dy / distance, dz / distance
    # Smoothstep between the cosines of the cone
    t = (-(dx * source[4] + dy * source[5] + dz * source[6]) - source[8]) / (source[7] - source[8])
    t = min(max(t, 0.0), 1.0)
    return dx, dy, dz, distance, t * t * (3.0 - 2.0 * t) / (distance * distance)


class Unshadowed(NamedTuple):
    """What a light sends to the texels where nothing is in the way.

    Attributes
    ----------
    arriving : ndarray of shape (H, W), float32
        Irradiance of a unit light.
    facing : ndarray of shape (H, W), bool
        Texels that face the light.
    """

    arriving: Image
    facing: NDArray[np.bool_]


@kernel
def unshadowed(
    first: int,
    stop: int,
    source: Float,
    texels: SurfaceTexels,
    subdivided: SubdividedMesh,
    oil: OilLayer,
    out: Unshadowed,
) -> None:
    """Irradiance of a unit light without shadows, and the texels that face it; theory.md 10.1.

    Parameters
    ----------
    first, stop : int
        Rows.
    source : ndarray of shape (10,)
        As `emitter` makes it.
    texels : SurfaceTexels
    subdivided : SubdividedMesh
    oil : OilLayer
    out : Unshadowed
        Written.
    """
    face_index, barycentric, normal, smooth = texels.face_index, texels.barycentric, texels.normal, texels.smooth
    roughness, strength, table, arriving, facing = oil.roughness, oil.strength, oil.table, out.arriving, out.facing
    width = face_index.shape[1]
    rows, cols = roughness.shape[0] > 1, strength.shape[0] > 1
    for row in range(first, stop):
        for col in range(width):
            arriving[row, col] = 0.0
            facing[row, col] = False
            face = face_index[row, col]
            if face == NO_FACE:
                continue
            px, py, pz = 0.0, 0.0, 0.0
            if source[0] != DIRECTIONAL:
                px, py, pz = point_of(
                    subdivided, face, np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
                )
            lx, ly, lz, _, reach = towards(source, px, py, pz)
            nx, ny, nz = normal[row, col, 0], normal[row, col, 1], normal[row, col, 2]
            sx, sy, sz = smooth[row, col, 0], smooth[row, col, 1], smooth[row, col, 2]
            # Cosines at the bump and at the skin under it
            cos_mapped = nx * lx + ny * ly + nz * lz
            cos_smooth = sx * lx + sy * ly + sz * lz
            facing[row, col] = reach > 0.0 and cos_smooth > 0.0
            if not facing[row, col] or cos_mapped <= 0.0:
                continue
            value = min(cos_mapped, 1.0) * reach * bump_terminator(cos_mapped, cos_smooth)
            if table.size > 0:
                # What the oil layer lets through, theory.md 7.1
                m = roughness[row, col] if rows else roughness[0, 0]
                rho = strength[row, col] if cols else strength[0, 0]
                f0 = oil.f0[row, col] if oil.f0.shape[0] > 1 else oil.f0[0, 0]
                value *= min(max(1.0 - rho * albedo_at(table, cos_mapped, np.float64(m), f0), 0.0), 1.0)
            arriving[row, col] = value


@kernel
def aim(first: int, stop: int, source: Float, origin: Image, direction: Image, reach: NDArray[np.float32]) -> None:
    """Directions from origins to the light, and its distance.

    Parameters
    ----------
    first, stop : int
        Origins.
    source : ndarray of shape (10,)
        As `emitter` makes it.
    origin : ndarray of shape (n, 3)
        Mm, about the occluder's centre.
    direction, reach : ndarrays of shape (n, 3) and (n,)
        Written: unit vectors, mm.
    """
    for i in range(first, stop):
        lx, ly, lz, distance, _ = towards(
            source, np.float64(origin[i, 0]), np.float64(origin[i, 1]), np.float64(origin[i, 2])
        )
        direction[i, 0], direction[i, 1], direction[i, 2] = lx, ly, lz
        reach[i] = distance
