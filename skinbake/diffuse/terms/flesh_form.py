"""How fast light dies away below the face of flesh of any form: balls, hollows, edges, slabs, fins (theory.md 9.8).

In a medium that is lit evenly from everywhere, the fluence f solves the equation of diffusion. Green's identity gives
it at the face by two integrals over the faces about, of the screened kernel and of its slope, as if f were the same on
all of them: exact for planes, slabs, balls and round rods. Faces across air take their own share off again, so that
nothing has to be known of what lies between two points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh

REACH = 5.0  # diffusion lengths that are looked
SIDE = 0.6  # of the longest diffusion length: longer sides are cut
MOST_CUTS = 16  # of a side
FAN = 8  # elements, or groups of them, of a group
OPENING = 0.7  # radius of a group over its distance, at most, to be one source
FADED = 3.0  # diffusion lengths up to which elements are cut so that the kernel is even on them
NEAR, MOST_PARTS = 1.0, 6  # sides over distance: a near element is cut into (NEAR times that)^2 parts
RECEIVERS = 150_000  # where more elements differ from a plane, some have the value of their group
FLAT = 0.05  # part of the rate by which an element differs from a plane, at most, to stand for its group
EVEN = 1e-5  # slope below which all about is in one plane
TINY = 1e-12


class Elements(NamedTuple):
    """Pieces of the face.

    Attributes
    ----------
    corner : ndarray of shape (E, 3, 3)
    bend : ndarray of shape (E,)
        Mean curvature, 1/mm, from the corners' normals.
    face : ndarray of shape (E,), int64
        Face of the mesh, -1: none, a piece that goes on beyond an open border.
    """

    corner: Float
    bend: Float
    face: NDArray[np.int64]


class Groups(NamedTuple):
    """Elements in an order that runs through space, and groups of them, level after level.

    Attributes
    ----------
    start : ndarray of shape (levels + 1,), int64
        First group of each level; of level 0 each is an element.
    middle, across : ndarrays of shape (n, 3)
        Centroid, and sum of area times outward normal.
    area, radius : ndarrays of shape (n,)
    spread : ndarray of shape (n,)
        Variance of the places along each direction of the face, mm^2.
    """

    start: NDArray[np.int64]
    middle: Float
    across: Float
    area: Float
    radius: Float
    spread: Float


def decay_below(mesh: SkinMesh, kappa_per_mm: Float) -> Float:
    """Rate at which light from everywhere dies away below the vertices' skin, 1/mm, (V, C): kappa below a plane.

    Parameters
    ----------
    mesh : SkinMesh
    kappa_per_mm : ndarray of shape (C,)
        Of each channel's medium, above 0.
    """
    kappa = np.ascontiguousarray(kappa_per_mm, np.float64)
    elements = _elements(mesh, SIDE / float(kappa.min()), 4 / float(kappa.min()))
    order = _in_order(elements.corner)
    elements = Elements(elements.corner[order], elements.bend[order], elements.face[order])
    groups = _groups(elements.corner)
    mine = np.flatnonzero(elements.face >= 0)
    # One element in `FAN`, and all where its value differs from a plane's; of larger meshes not each
    few = mine[FAN // 2 :: FAN] if len(mine) > FAN // 2 else mine[:1]
    coarse = np.empty((len(few), len(kappa)))
    parallel_for(_decay, len(few), few, elements, groups, kappa, coarse)
    group = np.minimum(np.arange(len(mine)) // FAN, len(few) - 1)
    each = coarse[group]
    differs = np.abs(coarse / kappa - 1).max(axis=1) > FLAT
    fine = np.flatnonzero(differs[group])
    fine = fine[:: -(-len(fine) // RECEIVERS) or 1]
    found = np.empty((len(fine), len(kappa)))
    parallel_for(_decay, len(fine), mine[fine], elements, groups, kappa, found)
    each[fine] = found

    area, count = groups.area[mine], len(mesh.positions_mm)
    corners = mesh.faces[elements.face[mine]].astype(np.int64)
    total, weight = np.zeros((count, len(kappa))), np.zeros(count)
    for k in range(3):
        weight += np.bincount(corners[:, k], area, count)
        for c in range(len(kappa)):
            total[:, c] += np.bincount(corners[:, k], area * each[:, c], count)
    rate: Float = np.where(weight[:, None] > 0, safe_div(total, weight[:, None]), kappa)
    return rate


def _elements(mesh: SkinMesh, side_mm: float, beyond_mm: float) -> Elements:
    """The mesh's faces, long ones in parts, and what continues the skin beyond its open borders."""
    corner = mesh.corner_position_mm.astype(np.float64)
    normal = mesh.corner_normal.astype(np.float64)
    bend, whole = _mean_curvature(corner, normal), np.arange(len(corner))
    skirt = _skirt(mesh, corner, beyond_mm)
    corner = np.concatenate([corner, skirt])
    bend = np.concatenate([bend, np.zeros(len(skirt))])
    whole = np.concatenate([whole, np.full(len(skirt), -1)])
    cuts = np.clip(np.ceil(_longest_side(corner) / side_mm), 1, MOST_CUTS).astype(np.int64)
    parts = [
        Elements(_cut(corner[cuts == n], n), np.repeat(bend[cuts == n], n * n), np.repeat(whole[cuts == n], n * n))
        for n in np.unique(cuts).tolist()
    ]
    return Elements(
        np.concatenate([part.corner for part in parts]),
        np.concatenate([part.bend for part in parts]),
        np.concatenate([part.face for part in parts]),
    )


def _longest_side(corner: Float) -> Float:
    return np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)


def _cut(corner: Float, cuts: int) -> Float:
    """Triangles with each side in `cuts` parts: (F, 3, 3) to (F cuts^2, 3, 3)."""
    if cuts == 1:
        return corner
    pieces = []
    for i in range(cuts):
        for j in range(cuts - i):
            pieces.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < cuts - 1:
                pieces.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    at = np.array(pieces, np.float64) / cuts
    weight = np.concatenate([1 - at.sum(axis=2, keepdims=True), at], axis=2)
    return np.einsum("pqk,fki->fpqi", weight, corner).reshape(-1, 3, 3)


def _mean_curvature(corner: Float, normal: Float) -> Float:
    """Half the divergence of the normals over each triangle, 1/mm."""
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    across = np.cross(one, two)
    square = (across**2).sum(axis=1)
    slopes = np.cross(two, across), np.cross(across, one)  # of barycentrics 1 and 2, times the square
    change = normal[:, 1:] - normal[:, :1]
    return safe_div((slopes[0] * change[:, 0] + slopes[1] * change[:, 1]).sum(axis=1), square) / 2


def _skirt(mesh: SkinMesh, corner: Float, beyond_mm: float) -> Float:
    """Triangles that continue the skin straight on beyond its open borders, (n, 3, 3): as a neck that was cut goes on.

    No further than as many millimetres as the hole has of area a millimetre of border.
    """
    _, same = np.unique(mesh.positions_mm, axis=0, return_inverse=True)
    at = same.ravel()[mesh.faces].astype(np.int64)
    begin, end = at.ravel(), np.roll(at, -1, axis=1).ravel()
    count = int(at.max()) + 1
    key, back = begin * count + end, end * count + begin
    open_ = np.flatnonzero((begin != end) & ~np.isin(key, back))
    if not len(open_):
        return np.empty((0, 3, 3))
    face, side = open_ // 3, open_ % 3
    a, b, c = (corner[face, (side + k) % 3] for k in range(3))
    along = b - a
    outwards = -(c - a) + safe_div(((c - a) * along).sum(axis=1), (along**2).sum(axis=1))[:, None] * along
    outwards = safe_div(outwards, np.linalg.norm(outwards, axis=1, keepdims=True))
    loop = _loops(begin[open_], end[open_], count)
    length = np.linalg.norm(along, axis=1)
    border = np.bincount(loop, length)
    area = np.stack([np.bincount(loop, part) for part in (np.cross(a, b) / 2).T], axis=1)
    reach = np.minimum(beyond_mm, safe_div(np.linalg.norm(area, axis=1), border))[loop, None]
    return np.concatenate(
        [
            np.stack([b, a, a + reach * outwards], axis=1),
            np.stack([b, a + reach * outwards, b + reach * outwards], axis=1),
        ]
    )


def _loops(begin: NDArray[np.int64], end: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Number of the connected piece that each edge belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(begin)), (begin, end)), (count, count))
    _, label = connected_components(graph, directed=False)
    _, found = np.unique(label[begin], return_inverse=True)
    return found.ravel().astype(np.int64)


def _in_order(corner: Float) -> NDArray[np.int64]:
    """Order of triangles in which neighbours that look one way come together: two sides of a fin are no one source."""
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    axis = np.abs(across).argmax(axis=1)
    looks = 2 * axis + (np.take_along_axis(across, axis[:, None], axis=1)[:, 0] < 0)
    middle = corner.mean(axis=1)
    alike = [np.flatnonzero(looks == way) for way in range(6)]
    return np.concatenate([mine[_neighbours_together(middle[mine])] for mine in alike if len(mine)])


def _neighbours_together(middle: Float) -> NDArray[np.int64]:
    """Order of points in which every aligned run of 2, 4, 8, ... is compact: halved across its longest extent."""
    order = np.arange(len(middle))
    run = 1 << max(len(middle) - 1, 1).bit_length()
    while run > 2:
        place = np.arange(len(middle)) // run
        first = np.arange(0, len(middle), run)
        at = middle[order]
        extent = np.maximum.reduceat(at, first) - np.minimum.reduceat(at, first)
        along = at[np.arange(len(at)), extent.argmax(axis=1)[place]]
        order = order[np.lexsort((along, place))]
        run //= 2
    return order


def _groups(corner: Float) -> Groups:
    """Groups of `FAN` elements in their order, of as many groups, and so on up to one."""
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    area, middle = np.linalg.norm(across, axis=1), corner.mean(axis=1)
    away = np.linalg.norm(corner - middle[:, None], axis=2)
    levels = [(middle, across, area, away.max(axis=1), (away**2).sum(axis=1) / 24)]
    while len(levels[-1][0]) > 1:
        middle, across, area, radius, spread = levels[-1]
        first = np.arange(0, len(area), FAN)
        weight = np.maximum(area, TINY)
        total = np.add.reduceat(weight, first)
        centre = np.add.reduceat(weight[:, None] * middle, first) / total[:, None]
        away = np.linalg.norm(middle - np.repeat(centre, FAN, axis=0)[: len(area)], axis=1)
        variance = np.add.reduceat(weight * (spread + away**2 / 2), first) / total
        far = np.maximum.reduceat(away + radius, first)
        levels.append((centre, np.add.reduceat(across, first), np.add.reduceat(area, first), far, variance))
    start = np.cumsum([0, *(len(level[2]) for level in levels)])
    return Groups(start, *(np.concatenate(part) for part in zip(*levels, strict=True)))


@kernel(inner=True)
def _add(way, source, kappa, sums):  # type: ignore[no-untyped-def]
    """Add a source's kernel and its slope along the source's normal, times 4 pi.

    Parameters
    ----------
    way : tuple of three floats
        From the receiver to the source.
    source : tuple of five floats
        Area times normal, area, and spread, which makes the kernel's mean of its value in the middle, to second order.
    kappa : ndarray of shape (C,)
    sums : ndarray of shape (2, C), added to
    """
    dx, dy, dz = way
    ax, ay, az, area, spread = source
    r = max(np.sqrt(dx * dx + dy * dy + dz * dz), TINY)
    inverse = 1.0 / r
    facing = (dx * ax + dy * ay + dz * az) * inverse
    for c in range(len(kappa)):
        if kappa[c] * r > REACH:
            continue
        screened = np.exp(-kappa[c] * r) * inverse
        bent = kappa[c] * kappa[c] + (kappa[c] + inverse) * inverse
        sums[0, c] += area * screened * (1.0 + 0.5 * spread * bent)
        sums[1, c] -= facing * screened * (kappa[c] + inverse)


@kernel(inner=True)
def _add_near(at, corner, source, parts, kappa, sums):  # type: ignore[no-untyped-def]
    """Add an element by the middles of parts^2 pieces of it."""
    share = 1.0 / (parts * parts)
    piece = source[0] * share, source[1] * share, source[2] * share, source[3] * share, source[4] * share
    for i in range(parts):
        for j in range(parts - i):
            for other in range(2 if i + j < parts - 1 else 1):
                u, v = (i + (1 + other) / 3.0) / parts, (j + (1 + other) / 3.0) / parts
                w = 1.0 - u - v
                dx = w * corner[0, 0] + u * corner[1, 0] + v * corner[2, 0] - at[0]
                dy = w * corner[0, 1] + u * corner[1, 1] + v * corner[2, 1] - at[1]
                dz = w * corner[0, 2] + u * corner[1, 2] + v * corner[2, 2] - at[2]
                _add((dx, dy, dz), piece, kappa, sums)


@kernel(inner=True)
def _add_own(at, corner, bend, kappa, sums):  # type: ignore[no-untyped-def]
    """Add the element that the receiver is in the middle of: of 1/r exactly, bent as its normals say.

    Parameters
    ----------
    at : tuple of three floats
    corner : ndarray of shape (3, 3)
    bend : float
    kappa : ndarray of shape (C,)
    sums : ndarray of shape (2, C), added to
    """
    of_plane = 0.0  # integral of 1/r
    for k in range(3):
        m = (k + 1) % 3
        length2, along, away2 = 0.0, 0.0, 0.0
        for axis in range(3):
            side, to = corner[m, axis] - corner[k, axis], corner[k, axis] - at[axis]
            length2 += side * side
            along += to * side
            away2 += to * to
        length = np.sqrt(max(length2, TINY))
        first = along / length
        height = np.sqrt(max(away2 - first * first, TINY))
        of_plane += height * (np.arcsinh((first + length) / height) - np.arcsinh(first / height))
    radius = of_plane / (2.0 * np.pi)  # of the disc with the same integral
    for c in range(len(kappa)):
        x = kappa[c] * radius
        faded = -np.expm1(-x) / max(x, TINY)
        sums[0, c] += of_plane * faded
        # A disc of a bent face: -pi bend times the integral of (kappa r + 1) exp(-kappa r)
        sums[1, c] -= np.pi * bend * radius * (2.0 * faded - np.exp(-x))


@kernel
def _decay(first, stop, mine, elements, groups, kappa, out):  # type: ignore[no-untyped-def]
    """Rates at the middles of elements.

    Parameters
    ----------
    first, stop : int
        Rows of `out`.
    mine : ndarray of shape (n,), int64
        Element of each.
    elements : Elements
    groups : Groups
    kappa : ndarray of shape (C,)
    out : ndarray of shape (n, C), written
    """
    start, middle, across, area, radius, spread = groups
    sums = np.empty((2, len(kappa)))
    stack = np.empty((128, 2), np.int64)
    furthest = 0.0
    for c in range(len(kappa)):
        furthest = max(furthest, REACH / kappa[c])
    top = len(start) - 2
    for row in range(first, stop):
        own = mine[row]
        at = middle[own, 0], middle[own, 1], middle[own, 2]
        sums[:] = 0.0
        stack[0, 0], stack[0, 1], waiting = top, 0, 1
        while waiting > 0:
            waiting -= 1
            level, place = stack[waiting, 0], stack[waiting, 1]
            k = start[level] + place
            dx, dy, dz = middle[k, 0] - at[0], middle[k, 1] - at[1], middle[k, 2] - at[2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            if distance - radius[k] > furthest:
                continue
            if level > 0 and radius[k] > OPENING * distance:
                below = start[level] - start[level - 1]
                for child in range(FAN * place, min(FAN * place + FAN, below)):
                    stack[waiting, 0], stack[waiting, 1] = level - 1, child
                    waiting += 1
                continue
            source = across[k, 0], across[k, 1], across[k, 2], area[k], spread[k]
            if level > 0:
                _add((dx, dy, dz), source, kappa, sums)
            elif k == own:
                _add_own(at, elements.corner[k], elements.bend[k], kappa, sums)
            else:
                parts = NEAR * 2.0 * radius[k] / max(distance, TINY)
                for c in range(len(kappa)):
                    if kappa[c] * (distance - radius[k]) < FADED:
                        parts = max(parts, kappa[c] * radius[k])
                parts = min(int(parts) + 1, MOST_PARTS)
                if parts == 1:
                    _add((dx, dy, dz), source, kappa, sums)
                else:
                    _add_near(at, elements.corner[k], source, parts, kappa, sums)
        for c in range(len(kappa)):
            beyond = 2.0 * np.pi * np.exp(-REACH) / kappa[c]  # of a plane
            out[row, c] = max(2.0 * np.pi + sums[1, c], 0.0) / max(sums[0, c] + beyond, TINY)
            if abs(sums[1, c]) < EVEN:
                out[row, c] = kappa[c]
