"""How deep places inside the skin lie below its surface: the distance to the nearest triangle, exact where it is small.

Triangles that may be nearest are listed for each small cube about the surface; cubes stand in blocks, which are there
only where a triangle is near. Elsewhere a lower bound is known.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.embree import ray_buffer
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import thread_count
from skinbake.numerics import Float
from skinbake.transport.surface_rays import RayScene, SurfaceRays, first_hit

CUBES = 6_000_000  # about as many at most
SIDE = 4  # cubes along an edge of a block
HALF_DIAGONAL = math.sqrt(3.0) / 2.0
SLABS = 16  # of blocks, worked on by themselves
MARK, COUNT, LIST = 0, 1, 2


class DepthGrid(NamedTuple):
    """Cubes and the triangles near them.

    Attributes
    ----------
    low_mm : ndarray of shape (3,)
        Lowest corner, about the rays' centre.
    cube_mm : float
        Side of a cube.
    reach_mm : float
        Distances up to it are exact.
    block : ndarray of shape (X, Y, Z), int32
        Number of each block of `SIDE`^3 cubes; -1 where no triangle is within reach.
    bound_mm : ndarray of shape (X, Y, Z), float32
        Distance that no place of such a block is nearer than.
    start : ndarray of shape (B SIDE^3 + 1,), int32
        Where the list of each cube begins.
    triangle : ndarray of shape (N,), int32
    ball : ndarray of shape (F, 4), float32
        Middle and radius of a ball about each triangle.
    outside : ndarray of shape (F,), bool
        Whether a triangle is skin's surface; one inside another closed part is not.
    """

    low_mm: Float
    cube_mm: float
    reach_mm: float
    block: NDArray[np.int32]
    bound_mm: NDArray[np.float32]
    start: NDArray[np.int32]
    triangle: NDArray[np.int32]
    ball: NDArray[np.float32]
    outside: NDArray[np.bool_]


def no_depth() -> DepthGrid:
    """What stands for depths where nobody asks for them."""
    none = np.zeros(0, np.int32)
    flat, ball = np.zeros((0, 0, 0), np.int32), np.zeros((0, 4), np.float32)
    return DepthGrid(
        np.zeros(3), 1.0, 0.0, flat, flat.astype(np.float32), none, none, ball, np.zeros(0, np.bool_)
    )  # fmt: skip


def depth_grid(skin: SurfaceRays, outer_mm: float) -> DepthGrid:
    """Depths below a closed surface, exact to beyond `outer_mm`.

    Parameters
    ----------
    skin : SurfaceRays
    outer_mm : float
        Depth of the lowest layer.
    """
    from scipy.ndimage import distance_transform_edt

    corner = skin.rays.corner_mm.astype(np.float64)
    edge = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
    area = float(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum()) / 2
    cube = max(float(np.median(edge)), outer_mm) / 2
    while 2 * (outer_mm + 2 * cube) * area / cube**3 > CUBES:
        cube *= 1.2
    reach = outer_mm + cube
    low = corner.min(axis=(0, 1)) - reach - SIDE * cube
    size = np.ceil((corner.max(axis=(0, 1)) + reach - low) / (SIDE * cube)).astype(int) + 1

    middle = corner.mean(axis=1)
    radius = np.linalg.norm(corner - middle[:, None], axis=2).max(axis=1)
    ball = np.concatenate([middle, radius[:, None]], axis=1).astype(np.float32)
    outside = np.ones(len(corner), np.bool_)
    _find_hidden(skin.rays, outside)

    block = np.full(tuple(size), -1, np.int32)
    start, none = np.zeros(1, np.int32), np.zeros(0, np.int32)
    grid = DepthGrid(low, cube, reach, block, np.zeros(tuple(size), np.float32), start, none, ball, outside)
    _visit_all(skin.rays, grid, MARK)
    there = block >= 0
    block[there] = np.arange(there.sum())
    count = np.zeros(int(there.sum()) * SIDE**3 + 1, np.int32)
    _visit_all(skin.rays, grid._replace(start=count), COUNT)
    start = np.cumsum(count, dtype=np.int64)
    triangle = np.empty(int(start[-1]), np.int32)
    # Listing moves each cube's beginning to its end, which is where the next one begins
    begin = np.concatenate([np.zeros(1, np.int32), start[:-1].astype(np.int32)])
    _visit_all(skin.rays, grid._replace(start=begin, triangle=triangle), LIST)
    away = distance_transform_edt(~there, SIDE * cube) - 2 * HALF_DIAGONAL * SIDE * cube
    bound = np.maximum(away, reach).astype(np.float32)
    return grid._replace(bound_mm=bound, start=start.astype(np.int32), triangle=triangle)


def _visit_all(rays: RayScene, grid: DepthGrid, task: int) -> None:
    """Visit all cubes near triangles, slab by slab of blocks on every thread; see `_visit`."""
    edge = np.linspace(0, grid.block.shape[0], SLABS + 1).astype(int).tolist()
    with ThreadPoolExecutor(thread_count()) as pool:
        list(pool.map(lambda n: _visit(rays.corner_mm, grid, task, edge[n], edge[n + 1]), range(SLABS)))


@kernel
def _find_hidden(rays, outside):  # type: ignore[no-untyped-def]
    """Write which triangles are inside another closed part: straight above them another face is met from inside."""
    buffer = ray_buffer()
    for f in range(len(outside)):
        nx, ny, nz = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
        step = 4.0 * rays.step_mm
        x = (rays.corner_mm[f, 0, 0] + rays.corner_mm[f, 1, 0] + rays.corner_mm[f, 2, 0]) / 3.0 + step * nx
        y = (rays.corner_mm[f, 0, 1] + rays.corner_mm[f, 1, 1] + rays.corner_mm[f, 2, 1]) / 3.0 + step * ny
        z = (rays.corner_mm[f, 0, 2] + rays.corner_mm[f, 1, 2] + rays.corner_mm[f, 2, 2]) / 3.0 + step * nz
        _, hit, _, _ = first_hit(rays, buffer, (x, y, z), (nx, ny, nz), np.inf)
        if hit >= 0 and rays.normal[hit, 0] * nx + rays.normal[hit, 1] * ny + rays.normal[hit, 2] * nz > 0.0:
            outside[f] = False


@kernel
def _visit(corner, grid, task, first, last):  # type: ignore[no-untyped-def]
    """Mark the blocks near triangles, count the triangles near their cubes, or list them.

    Parameters
    ----------
    corner : ndarray of shape (F, 3, 3)
    grid : DepthGrid
        `MARK` writes `block`, 0 where a triangle is near; `COUNT` writes `start`, one place further on; `LIST` writes
        `triangle` and moves `start`.
    task : int
    first, last : int
        Blocks along x, from and up to.
    """
    side = grid.cube_mm * SIDE
    near_block = grid.reach_mm + HALF_DIAGONAL * side
    near_cube = grid.reach_mm + HALF_DIAGONAL * grid.cube_mm
    for f in range(len(corner)):
        low, high = np.empty(3, np.int64), np.empty(3, np.int64)
        for axis in range(3):
            a, b, c = corner[f, 0, axis], corner[f, 1, axis], corner[f, 2, axis]
            low[axis] = max(0, int((min(a, b, c) - grid.reach_mm - grid.low_mm[axis]) / side))
            top = int((max(a, b, c) + grid.reach_mm - grid.low_mm[axis]) / side)
            high[axis] = min(grid.block.shape[axis] - 1, top)
        for i in range(max(low[0], first), min(high[0], last - 1) + 1):
            for j in range(low[1], high[1] + 1):
                for k in range(low[2], high[2] + 1):
                    if task == MARK and grid.block[i, j, k] == 0:
                        continue
                    x = grid.low_mm[0] + (i + 0.5) * side
                    y = grid.low_mm[1] + (j + 0.5) * side
                    z = grid.low_mm[2] + (k + 0.5) * side
                    if squared_distance(corner, f, x, y, z) > near_block * near_block:
                        continue
                    if task == MARK:
                        grid.block[i, j, k] = 0
                        continue
                    for cube in range(SIDE * SIDE * SIDE):
                        x = grid.low_mm[0] + i * side + (cube // (SIDE * SIDE) + 0.5) * grid.cube_mm
                        y = grid.low_mm[1] + j * side + (cube // SIDE % SIDE + 0.5) * grid.cube_mm
                        z = grid.low_mm[2] + k * side + (cube % SIDE + 0.5) * grid.cube_mm
                        bx, by, bz = x - grid.ball[f, 0], y - grid.ball[f, 1], z - grid.ball[f, 2]
                        reach = near_cube + grid.ball[f, 3]
                        if bx * bx + by * by + bz * bz > reach * reach:
                            continue
                        if squared_distance(corner, f, x, y, z) > near_cube * near_cube:
                            continue
                        at = grid.block[i, j, k] * SIDE * SIDE * SIDE + cube + 1
                        if task == LIST:
                            grid.triangle[grid.start[at]] = f
                        grid.start[at] += 1


@kernel(inner=True)
def squared_distance(corner, f, x, y, z):  # type: ignore[no-untyped-def]
    """Squared distance of a place from a triangle [Ericson2005].

    Parameters
    ----------
    corner : ndarray of shape (F, 3, 3)
    f : int
    x, y, z : float
    """
    ax, ay, az = x - corner[f, 0, 0], y - corner[f, 0, 1], z - corner[f, 0, 2]
    ux, uy, uz = (
        np.float64(corner[f, 1, 0]) - corner[f, 0, 0],
        np.float64(corner[f, 1, 1]) - corner[f, 0, 1],
        np.float64(corner[f, 1, 2]) - corner[f, 0, 2],
    )
    vx, vy, vz = (
        np.float64(corner[f, 2, 0]) - corner[f, 0, 0],
        np.float64(corner[f, 2, 1]) - corner[f, 0, 1],
        np.float64(corner[f, 2, 2]) - corner[f, 0, 2],
    )
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au, av = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
    # Barycentrics of the foot on the plane, times the determinant
    whole = uu * vv - uv * uv
    b, c = vv * au - uv * av, uu * av - uv * au
    if whole > 0.0 and b >= 0.0 and c >= 0.0 and b + c <= whole:
        b, c = b / whole, c / whole
        dx, dy, dz = ax - b * ux - c * vx, ay - b * uy - c * vy, az - b * uz - c * vz
        return dx * dx + dy * dy + dz * dz
    # Outside: the nearest of the three edges
    aa = ax * ax + ay * ay + az * az
    t = min(max(au / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    best = aa - 2.0 * t * au + t * t * uu
    t = min(max(av / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    best = min(best, aa - 2.0 * t * av + t * t * vv)
    ex, ey, ez = vx - ux, vy - uy, vz - uz
    px, py, pz = ax - ux, ay - uy, az - uz
    ee, pe = ex * ex + ey * ey + ez * ez, px * ex + py * ey + pz * ez
    t = min(max(pe / ee, 0.0), 1.0) if ee > 0.0 else 0.0
    return max(0.0, min(best, px * px + py * py + pz * pz - 2.0 * t * pe + t * t * ee))


@kernel(inner=True)
def depth_at(grid, rays, x, y, z):  # type: ignore[no-untyped-def]
    """Depth below the surface, and distance from any face, both mm; beyond `reach_mm` a lower bound of them.

    Parameters
    ----------
    grid : DepthGrid
    rays : RayScene
    x, y, z : float
        mm about the rays' centre.
    """
    a, b, c = (
        (x - grid.low_mm[0]) / grid.cube_mm,
        (y - grid.low_mm[1]) / grid.cube_mm,
        (z - grid.low_mm[2]) / grid.cube_mm,
    )
    i, j, k = int(a), int(b), int(c)
    bi, bj, bk = i // SIDE, j // SIDE, k // SIDE
    size = grid.block.shape
    if a < 0.0 or b < 0.0 or c < 0.0 or bi >= size[0] or bj >= size[1] or bk >= size[2]:
        return grid.reach_mm, grid.reach_mm  # outside of everything
    block = grid.block[bi, bj, bk]
    if block < 0:
        bound = np.float64(grid.bound_mm[bi, bj, bk])
        return bound, bound
    cube = ((i - bi * SIDE) * SIDE + j - bj * SIDE) * SIDE + k - bk * SIDE
    at = block * SIDE * SIDE * SIDE + cube
    depth = grid.reach_mm * grid.reach_mm
    clear = depth
    for n in range(grid.start[at], grid.start[at + 1]):
        f = grid.triangle[n]
        bx, by, bz = x - grid.ball[f, 0], y - grid.ball[f, 1], z - grid.ball[f, 2]
        away = math.sqrt(bx * bx + by * by + bz * bz) - grid.ball[f, 3]
        if away > 0.0 and away * away >= depth:
            continue
        found = squared_distance(rays.corner_mm, f, x, y, z)
        clear = min(clear, found)
        if grid.outside[f]:
            depth = min(depth, found)
    return math.sqrt(depth), math.sqrt(clear)
