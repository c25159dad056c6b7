"""The skin on the other side of thin flesh, and how light from lamps enters there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.terms.skin_hits import ascend
from skinbake.diffuse.terms.slab_weights import SlabWeights
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.punctual_light import towards
from skinbake.irradiance.slant import sources_of
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.lights import LightSpec
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
STRAIGHT_IN = np.array([[0.0, 0.0, 1.0]])
RAYS_AT_ONCE = 1 << 18  # of which what they bring of each light is in memory
FULL_COSINE = 0.3  # what light there is where a lamp grazes has come from around, or from other skin


def inwards(occluder: Occluder, point: Image, normal: Image) -> tuple[Image, Image]:
    """Rays into the flesh: in by a hundredth of a millimetre and the coordinates' own spacing, off the own facet.

    Parameters
    ----------
    occluder : Occluder
    point, normal : ndarrays of shape (n, 3)

    Returns
    -------
    Origins and directions.
    """
    inward = np.ascontiguousarray(-normal)
    return point + inward * np.float32(0.01 + 32 * occluder.spacing_mm), inward


class FarSide(NamedTuple):
    """Where n rays into the flesh leave it.

    Attributes
    ----------
    face : ndarray of shape (n,)
        -1 where it never does.
    uv : ndarray of shape (n, 2)
    thickness_mm : ndarray of shape (n,)
    opposed : ndarray of shape (n,)
        Cosine between the way and the outward normal there: 1 through a slab, 0 where it only grazes.
    point, normal : ndarrays of shape (n, 3)
        The place, mm about the occluder's centre, and its unit normal.
    depth_mm : ndarray of shape (n,)
        Of the place below the tangent plane.
    held : ndarray of shape (n, 3), optional
        Light inside there over that below a plane, for the form of the skin.
    """

    face: NDArray[np.int64]
    uv: Float
    thickness_mm: Float
    opposed: Float
    point: Float
    normal: Float
    depth_mm: Float
    held: Image | None = None


def in_parts(count: int, far: FarSide) -> Iterator[tuple[slice, FarSide]]:
    """Some of `count` points at a time, and where the rays of these leave the flesh.

    Parameters
    ----------
    count : int
    far : FarSide
        Of as many rays from each point.
    """
    rays = len(far.face) // max(count, 1)
    at_once = max(RAYS_AT_ONCE // max(rays, 1), 1)
    for begin in range(0, count, at_once):
        end = min(begin + at_once, count)
        of_rays = slice(begin * rays, end * rays)
        some: dict[str, Any] = {name: None if of is None else of[of_rays] for name, of in far._asdict().items()}
        yield slice(begin, end), FarSide(**some)


def far_side(occluder: Occluder, mesh: SkinMesh, point: Image, normal: Image, ways: Float = STRAIGHT_IN) -> FarSide:
    """Follow rays into the flesh until they leave it: those of each point one after the other.

    Parameters
    ----------
    occluder : Occluder
    mesh : SkinMesh
    point, normal : ndarrays of shape (n, 3)
        On the surface that rays meet, mm about the occluder's centre, and unit.
    ways : ndarray of shape (R, 3)
        Unit directions of the rays about the inward normal.
    """
    start, inward = inwards(occluder, point, normal)
    start, inward = np.repeat(start, len(ways), axis=0), _turned(inward, ways)
    *hits, distance = occluder.first_hit(start, inward)
    count = len(inward)
    far = FarSide(
        np.empty(count, np.int64),
        np.empty((count, 2)),
        np.empty(count),
        np.empty(count),
        np.empty((count, 3)),
        np.empty((count, 3)),
        np.empty(count),
    )
    along = np.ascontiguousarray(ways[:, 2])
    rays, of_mesh = (
        (np.asarray(point, np.float32), start, inward, distance, along),
        (mesh.corner_uv, mesh.corner_normal),
    )
    parallel_for(_leave, count, tuple(hits), rays, of_mesh, occluder.subdivided.levels, tuple(far[:-1]))
    return far


@kernel
def _leave(first, stop, hits, rays, of_mesh, levels, far):  # type: ignore[no-untyped-def]
    """Write where rays leave the flesh.

    Parameters
    ----------
    first, stop : int
        Rays.
    hits : tuple of three ndarrays of shape (n R,)
        Triangles of the smooth surface, -1 for none, and barycentrics 1 and 2.
    rays : tuple of ndarrays of shapes (n, 3), (n R, 3), (n R, 3), (n R,) and (R,)
        Points that they begin at, where they start beneath those, directions, ways to where they leave, and the
        cosines between the rays of a point and its inward normal.
    of_mesh : tuple of ndarrays of shapes (F, 3, 2) and (F, 3, 3)
        UVs and normals of corners.
    levels : int
        Of the smooth surface.
    far : tuple of ndarrays, written
        Fields of `FarSide`.
    """
    children, in_1, in_2 = hits
    point, start, inward, distance, along = rays
    corner_uv, corner_normal = of_mesh
    face, uv, thickness_mm, opposed, place, normal, depth_mm = far
    for k in range(first, stop):
        missed = children[k] < 0
        of, b1, b2 = ascend(max(np.int64(children[k]), 0), np.float64(in_1[k]), np.float64(in_2[k]), levels)
        b0 = 1 - b1 - b2
        for axis in range(2):
            uv[k, axis] = b0 * corner_uv[of, 0, axis] + b1 * corner_uv[of, 1, axis] + b2 * corner_uv[of, 2, axis]
        length2 = 0.0
        for axis in range(3):
            n = b0 * corner_normal[of, 0, axis] + b1 * corner_normal[of, 1, axis] + b2 * corner_normal[of, 2, axis]
            normal[k, axis] = n
            length2 += n * n
        length, cosine, through2 = np.sqrt(length2), 0.0, 0.0
        for axis in range(3):
            normal[k, axis] = normal[k, axis] / length if length > 0 else 0.0
            cosine += normal[k, axis] * inward[k, axis]
            place[k, axis] = start[k, axis] + (0.0 if missed else np.float64(distance[k])) * inward[k, axis]
            through2 += (place[k, axis] - point[k // len(along), axis]) ** 2
        face[k] = -1 if missed else of
        opposed[k] = 0.0 if missed else min(max(cosine, 0.0), 1.0)
        thickness_mm[k] = np.inf if missed else np.sqrt(through2)
        depth_mm[k] = thickness_mm[k] * along[k % len(along)]


def _turned(inward: Image, ways: Float) -> Image:
    """Unit directions at angles to unit vectors, (n W, 3)."""
    x, y, z = inward.T.astype(np.float64)
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    one = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    two = np.stack([b, sign + y * y * a, -y], axis=1)
    frame = np.stack([one, two, inward], axis=1)
    return np.ascontiguousarray(np.einsum("wk,nki->nwi", ways, frame).reshape(-1, 3), np.float32)


def factors_of_lights(
    weights: SlabWeights, far: FarSide, lights: Sequence[tuple[LightSpec | None, bool]], centre_mm: Float
) -> list[Image]:
    """`slant_factors` of each light, (n, 3); lights from everywhere share theirs.

    Parameters
    ----------
    weights, far, centre_mm
        As of `slant_factors`.
    lights : sequence of (LightSpec or None, bool)
        Its `light` and `counted`.
    """
    found: dict[tuple[int, bool], Image] = {}
    kinds = [(0 if light is None or light.everywhere else id(light), counted) for light, counted in lights]
    for kind, light in zip(kinds, lights, strict=True):
        if kind not in found:
            found[kind] = slant_factors(weights, far, *light, centre_mm)
    return [found[kind] for kind in kinds]


def slant_factors(
    weights: SlabWeights, far: FarSide, light: LightSpec | None, counted: bool, centre_mm: Float
) -> Image:
    """What of a light's weights is let through because of the slant at which it entered on the far side, (n, 3).

    Parameters
    ----------
    weights : SlabWeights
    far : FarSide
    light : LightSpec, optional
        None: several lights in one, as if from everywhere.
    counted : bool
        Whether its light counts by its incidence already.
    centre_mm : ndarray of shape (3,)
        Of the occluder.
    """
    table = weights.counted_rgb if counted else weights.plain_rgb
    step = np.log(weights.thickness_mm[1] / weights.thickness_mm[0])
    cosine = np.empty(0)
    if light is not None and not light.everywhere:
        cosine = np.empty(len(far.face))
        parallel_for(_cosines, len(cosine), sources_of(light, centre_mm), far.point, far.normal, cosine)
    out = np.empty((len(far.face), 3), np.float32)
    parallel_for(_let_through, len(out), far.depth_mm, cosine, table, (weights.thickness_mm[0], step), out)
    return out


@kernel
def _let_through(first, stop, depth_mm, cosine, table, rows, out):  # type: ignore[no-untyped-def]
    """Weights of a table read between its rows, by thickness, and between its columns, by the cosine on the far side.

    Parameters
    ----------
    first, stop : int
        Places.
    depth_mm : ndarray of shape (n,)
    cosine : ndarray of shape (n,), or empty
        Empty for light from everywhere.
    table : ndarray of shape (t, m + 1, 3)
        The last column is of light from everywhere, the others of cosines from 0 to 1.
    rows : tuple of 2 floats
        Thickness of the first row, mm, and the logarithm of the next one's over it.
    out : ndarray of shape (n, 3), written
    """
    nodes, (thinnest_mm, step) = table.shape[1] - 1, rows
    for place in range(first, stop):
        k = np.log(max(depth_mm[place], 1e-6) / thinnest_mm) / step
        k = min(max(k, 0.0), len(table) - 1.001) if np.isfinite(k) else 0.0
        low = int(k)
        part = k - low
        direct = 0.0
        if len(cosine):
            m = min(max(cosine[place], 0.0), 1.0) * (nodes - 1)
            left = min(int(m), nodes - 2)
            across = m - left
            direct = min(max(cosine[place] / FULL_COSINE, 0.0), 1.0)
            direct = direct * direct * (3 - 2 * direct)
        for c in range(3):
            value = (1 - direct) * ((1 - part) * table[low, nodes, c] + part * table[low + 1, nodes, c])
            if direct > 0:
                near = (1 - across) * table[low, left, c] + across * table[low, left + 1, c]
                far = (1 - across) * table[low + 1, left, c] + across * table[low + 1, left + 1, c]
                value += direct * ((1 - part) * near + part * far)
            out[place, c] = value


@kernel
def _cosines(first, stop, sources, point, normal, out):  # type: ignore[no-untyped-def]
    """Mean cosine between the normals of places and the directions to a light's sources, below 0 away from them.

    Parameters
    ----------
    first, stop : int
        Places.
    sources : ndarray of shape (n, 10)
        Each as `emitter` makes it.
    point, normal : ndarrays of shape (n, 3)
    out : ndarray of shape (n,), written
    """
    for k in range(first, stop):
        total = 0.0
        for source in sources:
            lx, ly, lz, _, _ = towards(source, point[k, 0], point[k, 1], point[k, 2])
            total += lx * normal[k, 0] + ly * normal[k, 1] + lz * normal[k, 2]
        out[k] = total / len(sources)
