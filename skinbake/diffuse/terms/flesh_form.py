"""How fast light dies away below the face of flesh of any form: balls, hollows, edges, slabs, fins (theory.md 9.8).

In a medium that is lit evenly from everywhere, the fluence f solves the equation of diffusion. Green's identity gives
it at the face by two integrals over the faces about, of the screened kernel and of its slope, as if f were the same on
all of them: exact for planes, slabs, balls and round rods. Faces across air take their own share off again, so that
nothing has to be known of what lies between two points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.connected import connected
from skinbake.diffuse.terms.flesh_sums import FAN, TINY, Elements, Groups, decay_at
from skinbake.kernels.simd import LANES
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh

SIDE = 0.6  # of the longest diffusion length: longer sides are cut
MOST_CUTS = 16  # of a side
RECEIVERS = 130_000  # elements at which the rate is found, at most
MOST_OF_FACE = 4  # of them in a face of the mesh, however large: rates within .5 % (rms) of those by all


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
    receiving, order = _receiving(elements.face, len(mesh.faces)), _in_order(elements.corner)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    elements = Elements(elements.corner[order], elements.bend[order], elements.face[order])
    mine = np.sort(place[receiving])  # neighbours together
    run = -(-len(mine) // RECEIVERS)  # of meshes of more faces one stands for several
    few = mine[run // 2 :: run]
    found = np.empty((len(few), len(kappa)))
    parallel_for(decay_at, len(few), few, elements, _groups(elements.corner), kappa, found)
    each = found[np.minimum(np.arange(len(mine)) // run, len(few) - 1)]

    face, area, count = elements.face[mine], mesh.face_area_mm2, len(mesh.positions_mm)
    parts = np.bincount(face, minlength=len(area))
    weight = np.bincount(mesh.faces.ravel(), np.repeat(area, 3), count)
    rate = np.empty((count, len(kappa)))
    for c in range(len(kappa)):
        of_face = area * safe_div(np.bincount(face, each[:, c], len(area)), parts)
        total = np.bincount(mesh.faces.ravel(), np.repeat(of_face, 3), count)
        rate[:, c] = np.where(weight > 0, safe_div(total, weight), kappa[c])
    return rate


def _receiving(face: NDArray[np.int64], faces: int) -> NDArray[np.int64]:
    """Elements at which the rate is found: a few of each face of the mesh, evenly among its own.

    Parameters
    ----------
    face : ndarray of shape (E,)
        Of each element; those of a face come one after the other.
    faces : int
    """
    mine = np.flatnonzero(face >= 0)
    _, first, count = np.unique(face[mine], return_index=True, return_counts=True)
    most = min(max(RECEIVERS // max(faces, 1), 1), MOST_OF_FACE)
    taken = np.minimum(count, most)
    chosen = [(first + count * (2 * k + 1) // (2 * taken))[taken > k] for k in range(int(taken.max()))]
    return mine[np.concatenate(chosen)]


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
    _, found = np.unique(connected(begin, end, count)[begin], return_inverse=True)
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
    count = len(middle)
    order = np.arange(count)
    run = 1 << max(count - 1, 1).bit_length()
    while run > 2:
        first = np.arange(0, count, run)
        at = middle[order]
        extent = np.maximum.reduceat(at, first) - np.minimum.reduceat(at, first)
        along = np.full(len(first) * run, np.inf)  # the last run may lack some, which come last in it
        along[:count] = at[np.arange(count), np.repeat(extent.argmax(axis=1), run)[:count]]
        place = along.reshape(-1, run).argsort(axis=1, kind="stable") + first[:, None]
        order = order[place.ravel()[:count]]
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
    middle, across, area, radius, spread = (np.concatenate(part) for part in zip(*levels, strict=True))
    sought = np.zeros((4, len(area) + LANES), np.float32)
    sought[:3, : len(area)], sought[3, : len(area)] = middle.T, radius
    return Groups(start, middle, across, area, radius, spread, sought.ravel())
