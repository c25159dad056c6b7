"""Rectangle lights: the closed form of their irradiance, and stratified rays for the share that a shadow leaves."""

from __future__ import annotations

import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE
from skinbake.irradiance.bump_terminator import bump_terminator
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import OilLayer, albedo_at
from skinbake.irradiance.refine import refine
from skinbake.irradiance.shadow_origin import SubdividedMesh, SurfaceTexels, point_of
from skinbake.irradiance.surface import TexelSurface
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.lights import RectangleLight

Image = NDArray[np.float32]
CHUNK = 1 << 20


class _Unshadowed(NamedTuple):
    """What a rectangle sends to the texels where nothing is in the way.

    Attributes
    ----------
    arriving : ndarray of shape (H, W), float32
        Irradiance of unit radiance.
    facing : ndarray of shape (H, W), bool
        Texels that face the light.
    central : ndarray of shape (H, W), float32
        Share that bumps and the oil leave of light from the centre.
    """

    arriving: Image
    facing: NDArray[np.bool_]
    central: Image


def light_rectangle(
    surface: TexelSurface,
    occluder: Occluder,
    light: RectangleLight,
    casts: bool,
    table: Float,
    seed: int,
    grid: int,
) -> tuple[Image, Image]:
    """Irradiance of a unit radiance (H, W), without the shadows, and unshadowed share (H, W).

    Unshadowed light is exact (theory.md 10.2 [Lambert1760, Baum1989]); rays through a jittered grid on the rectangle
    find the share that arrives. Full light and full shadow are found on a coarse lattice, every texel of a penumbra has
    its own rays. Maps of normals and of the oil are finer than the lattice: between its texels is interpolated by how
    much more passes than of as much light from the rectangle's centre.

    Parameters
    ----------
    surface : TexelSurface
    occluder : Occluder
    light : RectangleLight
    casts : bool
        Whether anything shadows it.
    table : ndarray
        Albedo of the oil layer; of size 0 where the oil takes nothing off.
    seed : int
    grid : int
        Rays along each edge.
    """
    panel = panel_of(light, occluder, seed, grid)
    raster = surface.raster
    arriving, facing = np.zeros(raster.shape, np.float32), np.zeros(raster.shape, np.bool_)
    central = np.zeros(raster.shape, np.float32)
    out = _Unshadowed(arriving, facing, central)
    layer = OilLayer(surface.roughness, surface.strength, table, surface.f0)
    parallel_for(_contour, len(arriving), panel, surface.texels, surface.subdivided, layer, out)

    normal, smooth = surface.normal.reshape(-1, 3), surface.smooth_normal.reshape(-1, 3)
    roughness = np.broadcast_to(surface.roughness, facing.shape).reshape(-1)
    strength = np.broadcast_to(surface.strength, facing.shape).reshape(-1)
    f0 = np.broadcast_to(surface.f0, facing.shape).reshape(-1)

    def trace(texels: NDArray[np.int64], _: int) -> Image:
        out = np.empty((len(texels), 2), np.float32)
        step = max(1, CHUNK // grid**2)
        for start in range(0, len(texels), step):
            part = texels[start : start + step]
            points = Points(part, surface.origins(part), normal[part], smooth[part])
            oil = OilLayer(roughness[part], strength[part], table, f0[part])
            out[start : start + step] = open_shares(panel, points, oil, occluder if casts else None)[0]
        out[:, 0] -= out[:, 1] * central.reshape(-1)[texels]
        return out

    if casts or table.size or surface.normal is not surface.smooth_normal:
        # Shadows of strands repeat within a few texels: points of a wide lattice may agree on all of them
        tolerance, coarsest = (0.0, 2) if casts and occluder.has_cards else (0.02 if table.size else 0.0, 4)
        share = refine(facing, surface.smooth_normal, 2, trace, tolerance, coarsest)
        return arriving * np.clip(share[..., 0] + share[..., 1] * central, 0, share[..., 1]), share[..., 1]
    return arriving, facing.astype(np.float32)


def panel_of(light: RectangleLight, occluder: Occluder, seed: int, grid: int) -> Panel:
    """A rectangle light about the occluder's centre, with rays to it.

    Parameters
    ----------
    light : RectangleLight
    occluder : Occluder
    seed : int
    grid : int
        Rays along each edge.
    """
    corner = np.asarray(light.position_mm) - occluder.centre_mm
    shape = np.array([corner, light.edge_u_mm, light.edge_v_mm], dtype=np.float64)
    out_normal = np.cross(light.edge_u_mm, light.edge_v_mm)
    key = np.uint64((seed * 0x9E3779B97F4A7C15 + zlib.crc32(light.name.encode())) % 2**64)
    return Panel(shape, out_normal / np.sqrt((out_normal * out_normal).sum()), key, grid)


def open_shares(panel: Panel, points: Points, oil: OilLayer, occluder: Occluder | None) -> tuple[Image, Float]:
    """Share of the light that arrives, with and without the oil, (n, 2), and what the rays stand for without shadows,
    (n,), the light's area left out.

    Parameters
    ----------
    panel : Panel
    points : Points
    oil : OilLayer
        At the points.
    occluder : Occluder, optional
        What is in the way.
    """
    count = len(points.texels), panel.grid**2
    ray, reach = np.zeros((*count, 3), np.float32), np.zeros(count, np.float32)
    sent, passed = np.zeros(count), np.zeros(count)
    parallel_for(_sample, len(points.texels), panel, points, oil, _Rays(ray, reach, sent, passed))
    clear: NDArray[Any] = np.ones(reach.size, np.bool_)
    if occluder is not None:
        starts = np.repeat(points.origin, panel.grid**2, axis=0)
        clear = occluder.unhindered(starts, ray.reshape(-1, 3), reach.ravel())
    clear = clear.reshape(sent.shape)
    total = sent.sum(axis=1)
    none = total <= 0
    total[none] = 1
    out = np.empty((len(total), 2), np.float32)
    out[:, 0] = np.where(none, clear.mean(axis=1), (passed * clear).sum(axis=1) / total)
    out[:, 1] = np.where(none, clear.mean(axis=1), (sent * clear).sum(axis=1) / total)
    return out, np.where(none, 0.0, total / count[1])


@kernel(inner=True)
def _above_horizon(poly: Float, count: int, nx: float, ny: float, nz: float, out: Float) -> int:
    """The part of a polygon above a plane through the origin; the number of corners left.

    Parameters
    ----------
    poly : ndarray of shape (at least count, 3)
    count : int
        Corners of the polygon.
    nx, ny, nz : float
        Normal of the plane.
    out : ndarray of shape (at least count + 1, 3)
        Written.
    """
    m = 0
    for i in range(count):
        j = (i + 1) % count
        a = poly[i, 0] * nx + poly[i, 1] * ny + poly[i, 2] * nz
        b = poly[j, 0] * nx + poly[j, 1] * ny + poly[j, 2] * nz
        if a >= 0.0:
            out[m] = poly[i]
            m += 1
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            t = a / (a - b)
            out[m] = poly[i] + t * (poly[j] - poly[i])
            m += 1
    return m


@kernel(inner=True)
def rectangle_irradiance(
    shape: Float,
    at: tuple[float, float, float],
    normal: tuple[float, float, float],
    poly: Float,
    clipped: Float,
) -> float:
    """Irradiance of unit radiance from a parallelogram, cut off at the horizon; theory.md 10.2.

    Parameters
    ----------
    shape : ndarray of shape (3, 3)
        Centre and both edges, mm.
    at, normal : tuples of three floats
        Point that is lit, mm, and its unit normal.
    poly, clipped : ndarrays of shape (8, 3)
        Work space.
    """
    px, py, pz = at
    nx, ny, nz = normal
    for k in range(4):
        su = -0.5 if k in (0, 3) else 0.5
        sv = -0.5 if k in (0, 1) else 0.5
        poly[k, 0] = shape[0, 0] + su * shape[1, 0] + sv * shape[2, 0] - px
        poly[k, 1] = shape[0, 1] + su * shape[1, 1] + sv * shape[2, 1] - py
        poly[k, 2] = shape[0, 2] + su * shape[1, 2] + sv * shape[2, 2] - pz
    count = _above_horizon(poly, 4, nx, ny, nz, clipped)
    total = 0.0
    for i in range(count):
        j = (i + 1) % count
        ax, ay, az = clipped[i, 0], clipped[i, 1], clipped[i, 2]
        bx, by, bz = clipped[j, 0], clipped[j, 1], clipped[j, 2]
        # Angle of the edge times the cosine of its plane's normal, theory.md 10.2
        gx, gy, gz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = np.sqrt(gx * gx + gy * gy + gz * gz)
        if length > 0.0:
            angle = np.arctan2(length, ax * bx + ay * by + az * bz)
            total += angle * (gx * nx + gy * ny + gz * nz) / length
    return 0.5 * abs(total)


@kernel
def _contour(
    first: int,
    stop: int,
    panel: Panel,
    texels: SurfaceTexels,
    subdivided: SubdividedMesh,
    oil: OilLayer,
    out: _Unshadowed,
) -> None:
    """Unshadowed irradiance at the texels, which of them face the light, and what passes of light from its centre.

    Parameters
    ----------
    first, stop : int
        Rows.
    panel : Panel
    texels : SurfaceTexels
    subdivided : SubdividedMesh
    oil : OilLayer
    out : _Unshadowed
        Written where the atlas is not empty and the light shines.
    """
    face_index, barycentric, normal, smooth = texels.face_index, texels.barycentric, texels.normal, texels.smooth
    shape, out_normal = panel.shape, panel.out_normal
    arriving, facing, central = out.arriving, out.facing, out.central
    roughness, strength, table, f0 = oil.roughness, oil.strength, oil.table, oil.f0
    rough_map, strong_map, f0_map = roughness.shape[0] > 1, strength.shape[0] > 1, f0.shape[0] > 1
    width = face_index.shape[1]
    for row in range(first, stop):
        poly, clipped = np.empty((8, 3)), np.empty((8, 3))
        for col in range(width):
            face = face_index[row, col]
            if face == NO_FACE:
                continue
            px, py, pz = point_of(
                subdivided, face, np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            )
            ahead = (
                (px - shape[0, 0]) * out_normal[0]
                + (py - shape[0, 1]) * out_normal[1]
                + (pz - shape[0, 2]) * out_normal[2]
            )
            if ahead <= 0.0:
                continue
            sx, sy, sz = (
                np.float64(smooth[row, col, 0]),
                np.float64(smooth[row, col, 1]),
                np.float64(smooth[row, col, 2]),
            )
            facing[row, col] = rectangle_irradiance(shape, (px, py, pz), (sx, sy, sz), poly, clipped) > 0.0
            if facing[row, col]:
                nx, ny, nz = (
                    np.float64(normal[row, col, 0]),
                    np.float64(normal[row, col, 1]),
                    np.float64(normal[row, col, 2]),
                )
                arriving[row, col] = rectangle_irradiance(shape, (px, py, pz), (nx, ny, nz), poly, clipped)
                # What bumps and the oil leave of light from the centre
                lx, ly, lz = shape[0, 0] - px, shape[0, 1] - py, shape[0, 2] - pz
                distance = np.sqrt(lx * lx + ly * ly + lz * lz)
                cos_mapped = (nx * lx + ny * ly + nz * lz) / distance
                if cos_mapped > 0.0:
                    share = bump_terminator(cos_mapped, (sx * lx + sy * ly + sz * lz) / distance)
                    if table.size > 0:
                        m = roughness[row, col] if rough_map else roughness[0, 0]
                        rho = strength[row, col] if strong_map else strength[0, 0]
                        normal_f0 = f0[row, col] if f0_map else f0[0, 0]
                        share *= min(max(1.0 - rho * albedo_at(table, cos_mapped, np.float64(m), normal_f0), 0.0), 1.0)
                    central[row, col] = share


@kernel(inner=True)
def _hash(x: np.uint64) -> np.uint64:
    """Random 64 bits for a number [Steele2014]: every texel and sample has its own, whoever asks and when."""
    x ^= x >> np.uint64(30)
    x *= np.uint64(0xBF58476D1CE4E5B9)
    x ^= x >> np.uint64(27)
    x *= np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


class Panel(NamedTuple):
    """A rectangle light and the rays to it.

    Attributes
    ----------
    shape : ndarray of shape (3, 3)
        Centre and both edges, mm.
    out_normal : ndarray of shape (3,)
        On the side that shines, unit.
    key : uint64
        Seed.
    grid : int
        Rays along each edge.
    """

    shape: Float
    out_normal: Float
    key: np.uint64
    grid: int


class Points(NamedTuple):
    """Points of the skin from which rays start.

    Attributes
    ----------
    texels : ndarray of shape (n,), int64
        row * W + col.
    origin, normal, smooth : ndarrays of shape (n, 3)
        Where rays start, mm, and the unit normals with and without the normal map.
    """

    texels: NDArray[np.int64]
    origin: Image
    normal: Image
    smooth: Image


class _Rays(NamedTuple):
    """Rays from n points, and the irradiance that each stands for.

    Attributes
    ----------
    ray, reach : ndarrays of shape (n, grid^2, 3) and (n, grid^2), float32
        Unit directions, and distances in mm.
    sent, passed : ndarrays of shape (n, grid^2)
        cos cos / distance^2 of each ray, its irradiance but for the area that it stands for; and the part that passes
        the oil. 0 where nothing arrives.
    """

    ray: Image
    reach: Image
    sent: Float
    passed: Float


@kernel
def _sample(first: int, stop: int, panel: Panel, points: Points, oil: OilLayer, out: _Rays) -> None:
    """Rays to a jittered grid on the light, and the irradiance that each stands for.

    Parameters
    ----------
    first, stop : int
        Of the points.
    panel : Panel
    points : Points
    oil : OilLayer
        At the points.
    out : _Rays
        Written, where something arrives.
    """
    shape, out_normal, key, grid = panel.shape, panel.out_normal, panel.key, panel.grid
    texels, origin, normal, smooth = points.texels, points.origin, points.normal, points.smooth
    roughness, strength, table, f0 = oil.roughness, oil.strength, oil.table, oil.f0
    ray, reach, sent, passed = out.ray, out.reach, out.sent, out.passed
    count = grid * grid
    for i in range(first, stop):
        nx, ny, nz = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
        sx, sy, sz = np.float64(smooth[i, 0]), np.float64(smooth[i, 1]), np.float64(smooth[i, 2])
        for s in range(count):
            # Jittered place in the ray's own cell of the grid
            number = _hash(key + np.uint64(texels[i]) * np.uint64(count) + np.uint64(s))
            jitter_u = np.float64(number >> np.uint64(40)) / 16777216.0
            jitter_v = np.float64((number >> np.uint64(16)) & np.uint64(0xFFFFFF)) / 16777216.0
            u = (s % grid + jitter_u) / grid - 0.5
            v = (s // grid + jitter_v) / grid - 0.5
            lx = shape[0, 0] + u * shape[1, 0] + v * shape[2, 0] - origin[i, 0]
            ly = shape[0, 1] + u * shape[1, 1] + v * shape[2, 1] - origin[i, 1]
            lz = shape[0, 2] + u * shape[1, 2] + v * shape[2, 2] - origin[i, 2]
            distance = np.sqrt(lx * lx + ly * ly + lz * lz)
            if distance == 0.0:
                continue
            lx, ly, lz = lx / distance, ly / distance, lz / distance
            ray[i, s, 0], ray[i, s, 1], ray[i, s, 2] = lx, ly, lz
            reach[i, s] = distance
            leaving = -(lx * out_normal[0] + ly * out_normal[1] + lz * out_normal[2])
            cos_mapped = nx * lx + ny * ly + nz * lz
            cos_smooth = sx * lx + sy * ly + sz * lz
            if leaving <= 0.0 or cos_mapped <= 0.0:
                continue
            sent[i, s] = cos_mapped * leaving / (distance * distance)
            passed[i, s] = sent[i, s] * bump_terminator(cos_mapped, cos_smooth)
            if table.size > 0:
                share = 1.0 - strength[i] * albedo_at(table, np.float64(cos_mapped), np.float64(roughness[i]), f0[i])
                passed[i, s] *= min(max(share, 0.0), 1.0)
