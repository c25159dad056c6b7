"""Points of the skin at which a bake is compared with transport: by area, and more where the two part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.embree import ray_buffer
from skinbake.irradiance.punctual_light import emitter, towards
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.scene.lights import LightSpec, RectangleLight
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.light_leaving import points_of
from skinbake.transport.surface_rays import SurfaceRays, first_hit

EDGE_MM = 3.0  # from where a light's shadow or terminator lies
THIN_MM = 8.0  # of skin below
CREASE = 0.25  # of the cosine-weighted hemisphere that other skin fills
CANDIDATES = 20  # for each point that is drawn
SHARES = {"thin": 0.15, "creases": 0.2, "edges": 0.25}  # of the points; the rest is by area among what is left
OF_CHANGES = 0.5  # of the points, where skin varies
CHANGES, EVEN = "skin changes", "skin even"  # names of groups
AROUND = 32  # places looked at within EDGE_MM
HEMISPHERE = 64  # rays that look for other skin
GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class TruthPoints:
    """P points.

    Attributes
    ----------
    face : ndarray of shape (P,), int32
    barycentric : ndarray of shape (P, 2)
        Barycentrics 1 and 2 in the face of the mesh.
    weight : ndarray of shape (P,)
        Skin that each stands for, of mean 1: means with it are means over the skin.
    groups : dict of str to ndarray of shape (P,), bool
        "lit" (by a light, no shadow's edge near), "edges" (within `EDGE_MM` of a shadow's edge or a terminator),
        "cast edges" (those where other skin casts the shadow), "thin" and "creases"; of skin that varies "skin changes"
        and "skin even", both lit.
    """

    face: NDArray[np.int32]
    barycentric: Float
    weight: Float
    groups: dict[str, NDArray[np.bool_]]


def draw_points(
    mesh: SkinMesh,
    skin: SurfaceRays,
    lights: Sequence[LightSpec],
    count: int,
    seed: int = 0,
    changes: Callable[[Float], NDArray[np.bool_]] | None = None,
) -> TruthPoints:
    """Draw points: shares of them in thin parts, creases and at shadow edges, the others anywhere else by area.

    Parameters
    ----------
    mesh : SkinMesh
    skin : SurfaceRays
        Of the mesh's smooth surface.
    lights : sequence of LightSpec
        Skies have no edges; of a rectangle its centre counts.
    count : int
    seed : int
    changes : callable, optional
        Of skin that varies: which places (N, 3), mm about the rays' centre, are near a change. Half of the points are
        drawn there, and there are two groups more, of lit skin far from shadow edges.

    Raises
    ------
    ValueError
        If `count` is below 1.
    """
    if count < 1:
        raise ValueError(f"count: expected at least 1, got {count}")
    rng = np.random.default_rng([seed, 0x7274])
    pool = CANDIDATES * count
    area = np.cumsum(mesh.face_area_mm2)
    face = np.searchsorted(area, (np.arange(pool) + rng.random(pool)) / pool * area[-1])
    face = np.minimum(face, len(area) - 1).astype(np.int32)
    root, along = np.sqrt(rng.random(pool)), rng.random(pool)
    place = np.stack([root * (1 - along), root * along], axis=1)

    position, normal = points_of(skin, face, place)
    sources = _sources(lights, skin.rays.centre_mm)
    found = np.zeros((pool, 6), np.bool_)
    _classify(skin.rays, position, normal, sources, found)
    hidden, lit, edge, cast, thin, crease = found.T
    groups = {"lit": lit & ~edge, "edges": edge, "cast edges": cast, "thin": thin, "creases": crease}

    stratum, shares = np.select([hidden, thin, crease, edge], [-1, 0, 1, 2], 3), list(SHARES.values())
    near = changes(position) if changes is not None else np.zeros(pool, np.bool_)
    if near.any():
        groups |= {CHANGES: groups["lit"] & near, EVEN: groups["lit"] & ~near}
        stratum = np.where((stratum == 3) & near, 4, stratum)
        shares = [share * (1 - OF_CHANGES) for share in shares]
    members = [rng.permutation(np.flatnonzero(stratum == k)) for k in range(5 if near.any() else 4)]
    wanted = [min(len(mine), round(share * count)) for mine, share in zip(members, shares, strict=False)]
    of_changes = [min(len(mine), round(OF_CHANGES * count)) for mine in members[4:]]
    wanted.append(min(len(members[3]), count - sum(wanted) - sum(of_changes)))
    # Where hardly anything is even, changes get the rest
    wanted += [min(len(mine), count - sum(wanted)) for mine in members[4:]]
    chosen = np.concatenate([mine[:n] for mine, n in zip(members, wanted, strict=True)])
    stands_for = np.concatenate([np.full(n, len(mine) / max(n, 1)) for mine, n in zip(members, wanted, strict=True)])
    order = np.argsort(chosen)  # along the mesh: neighbours share what the processor has in its caches
    chosen, stands_for = chosen[order], stands_for[order]
    return TruthPoints(
        face[chosen],
        place[chosen],
        stands_for / stands_for.mean(),
        {name: mine[chosen] for name, mine in groups.items()},
    )


def _sources(lights: Sequence[LightSpec], centre_mm: Float) -> Float:
    """Lights that have shadow edges, as `emitter` gives them; a rectangle as a point at its centre."""
    found = []
    for light in lights:
        if light.everywhere:
            continue
        if isinstance(light, RectangleLight):
            position = np.asarray(light.position_mm) - centre_mm
            found.append(np.array([1, *position, 0, 0, 0, -2, -3, 0], np.float64))
        else:
            found.append(emitter(light, centre_mm))
    return np.array(found).reshape(-1, 10)


@kernel(inner=True)
def _frame(nx, ny, nz):  # type: ignore[no-untyped-def]
    """Two unit vectors across a normal."""
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel(inner=True)
def _sees(rays, buffer, source, at, normal):  # type: ignore[no-untyped-def]
    """0: faces away from the light, 1: faces it and other skin hides it, 2: lit."""
    x, y, z = at
    nx, ny, nz = normal
    lx, ly, lz, distance, reach = towards(source, x, y, z)
    if reach <= 0.0 or lx * nx + ly * ny + lz * nz <= 0.0:
        return 0
    step = 4.0 * rays.step_mm
    _, f, _, _ = first_hit(rays, buffer, (x + step * nx, y + step * ny, z + step * nz), (lx, ly, lz), distance)
    return 1 if f >= 0 else 2


@kernel
def _classify(rays, position, normal, sources, out):  # type: ignore[no-untyped-def]
    """Write for each point: inside other skin, lit, near an edge, near a cast one, thin, in a crease."""
    buffer = ray_buffer()
    near = np.empty((AROUND, 6))
    for p in range(len(position)):
        x, y, z = position[p]
        nx, ny, nz = normal[p]
        sx, sy, sz, tx, ty, tz = _frame(nx, ny, nz)
        step = 4.0 * rays.step_mm
        ox, oy, oz = x + step * nx, y + step * ny, z + step * nz
        _, f, _, _ = first_hit(rays, buffer, (ox, oy, oz), (nx, ny, nz), np.inf)
        if f >= 0 and rays.normal[f, 0] * nx + rays.normal[f, 1] * ny + rays.normal[f, 2] * nz > 0.0:
            out[p, 0] = True
            continue
        _, f, _, _ = first_hit(rays, buffer, (x - step * nx, y - step * ny, z - step * nz), (-nx, -ny, -nz), THIN_MM)
        out[p, 4] = f >= 0
        met = 0
        for i in range(HEMISPHERE):
            r, angle = np.sqrt((i + 0.5) / HEMISPHERE), i * GOLDEN_ANGLE
            a, b, up = r * np.cos(angle), r * np.sin(angle), np.sqrt(1.0 - r * r)
            dx, dy, dz = a * sx + b * tx + up * nx, a * sy + b * ty + up * ny, a * sz + b * tz + up * nz
            _, f, _, _ = first_hit(rays, buffer, (ox, oy, oz), (dx, dy, dz), np.inf)
            if f >= 0:
                met += 1
        out[p, 5] = met >= CREASE * HEMISPHERE

        # Places around, found by looking down at the skin from above its tangent plane
        count = 0
        for i in range(AROUND):
            r, angle = EDGE_MM * np.sqrt((i + 0.5) / AROUND), i * GOLDEN_ANGLE
            a, b = r * np.cos(angle), r * np.sin(angle)
            qx = x + a * sx + b * tx + EDGE_MM * nx
            qy = y + a * sy + b * ty + EDGE_MM * ny
            qz = z + a * sz + b * tz + EDGE_MM * nz
            way, f, _, _ = first_hit(rays, buffer, (qx, qy, qz), (-nx, -ny, -nz), 2.0 * EDGE_MM)
            if f >= 0 and rays.normal[f, 0] * nx + rays.normal[f, 1] * ny + rays.normal[f, 2] * nz > 0.0:
                near[count, 0], near[count, 1], near[count, 2] = qx - way * nx, qy - way * ny, qz - way * nz
                near[count, 3:6] = rays.normal[f]
                count += 1
        for light in range(len(sources)):
            here = _sees(rays, buffer, sources[light], (x, y, z), (nx, ny, nz))
            is_lit, is_dark, is_hidden = here == 2, here != 2, here == 1
            out[p, 1] = out[p, 1] or here == 2
            for i in range(count):
                place, up = (near[i, 0], near[i, 1], near[i, 2]), (near[i, 3], near[i, 4], near[i, 5])
                there = _sees(rays, buffer, sources[light], place, up)
                is_lit, is_dark, is_hidden = is_lit or there == 2, is_dark or there != 2, is_hidden or there == 1
            if is_lit and is_dark:
                out[p, 2] = True
                if is_hidden:
                    out[p, 3] = True
