"""The hot loop of the surface method: Gaussian sums over a tree of sources at a batch of sixteen targets.

The lanes of the inner loops are neighbouring targets, not sources: each lane adds its sources in one fixed order, so
the result depends neither on the number of threads nor on the width of the machine's vectors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.lattice import lattice_gain, lattice_variance
from skinbake.diffuse.surface_space.pair_rule import pair_weight
from skinbake.diffuse.surface_space.source_search import (
    LEAVES,
    Search,
    near_boxes,
    near_sources,
    opposite_sources,
    sources_around,
)
from skinbake.diffuse.surface_space.sources import AMPLITUDE, LIGHT, NARROWING, NORMAL
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import (
    LANES,
    broadcast,
    gaussian,
    greatest_lane,
    least_lane,
    load,
    load_scalar,
    lowest_bit,
    mul_add,
    prefetch,
    store,
    sum_of_lanes,
)
from skinbake.numerics import Float

BLOCK = 4  # x 4 texels are a batch, where all are targets and near one another
_AHEAD = 2  # leaves that are on their way from memory while one is summed
_NORMAL, _RATE, SUMS = 3, 6, 7  # rows of sixteen in the scratch memory: x y z, normal, -1 / 64 v, sums
_ZERO, _HALF = np.float32(0), np.float32(0.5)
TINY = np.float32(1e-20)


class Sums(NamedTuple):
    """The sums of one lobe.

    Attributes
    ----------
    variance_mm2 : float
    table : tuple of two ndarrays
        `lattice_table()`.
    cut : float32
        Sigmas.
    separate : bool
        Whether `pair_weight` keeps pairs apart.
    faint : float32
        A sum of weights that counts as nothing.
    density : float32
        1 / (2 pi v) where sums are not normalised, else 0.
    first_light : int
        First of the tree's lights that is summed.
    read : float32
        Texels of a target by which reading what is stored spreads light, which its sum leaves to the reader.
    """

    variance_mm2: float
    table: tuple[Float, Float]
    cut: np.float32
    separate: bool
    faint: np.float32
    density: np.float32
    first_light: int
    read: np.float32


class Target(NamedTuple):
    """What is written, and how much it counts there; as in `gather`, `share` of size 0 for all of it."""

    share: NDArray[np.uint8]
    out: NDArray[np.float32]


class Room(NamedTuple):
    """Work space of one thread.

    Attributes
    ----------
    lanes : ndarray, float32
        Rows of sixteen: see `_NORMAL`, `_RATE`, `SUMS`.
    low, high : ndarrays of shape (3,), float32
        Corners of a box.
    search : Search
    begin : ndarray, int64
        Groups at which the searches of a tile begin.
    members, batch : ndarrays, int64
        Targets of a square, and of a batch.
    """

    lanes: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    search: Search
    begin: NDArray[np.int64]
    members: NDArray[np.int64]
    batch: NDArray[np.int64]


@kernel(inline=True)
def _held_variance(variance, read, texel):  # type: ignore[no-untyped-def]
    """What of a lobe's variance is left to a sum that is read between texels of an area; half of it at least."""
    return max(variance - read * texel, _HALF * variance)


@kernel(inline=True)
def take_near(room, first, count, points, sums):  # type: ignore[no-untyped-def]
    """Move what lies near the first member left into the batch, which repeats its last; the first member left then.

    Parameters
    ----------
    room : Room
    first, count : int
        First member left, and members in all.
    points : TexelPoints
    sums : Sums
    """
    members, batch, position = room.members, room.batch, points.position
    seed = members[first]
    texel_mm2 = max(points.texel_mm2[seed], _ZERO)
    reach = sums.cut * np.float32(np.sqrt(sums.variance_mm2)) + np.float32(2 * BLOCK) * np.sqrt(texel_mm2)
    taken, here = 0, first
    while here < count and taken < LANES:
        k = members[here]
        near = True
        for axis in range(3):
            near = near and abs(position[k, axis] - position[seed, axis]) <= reach
        if near:
            # What is far moves up behind what is taken
            for i in range(here, first + taken, -1):
                members[i] = members[i - 1]
            batch[taken] = k
            taken += 1
        here += 1
    for lane in range(taken, LANES):
        batch[lane] = batch[taken - 1]
    return first + taken


@kernel(inline=True)
def gather_batch(points, tree, sums, room, begins, target):  # type: ignore[no-untyped-def]
    """Sum up the light at the targets of a batch, and write it.

    Parameters
    ----------
    points : TexelPoints
    tree : TreeArrays
    sums : Sums
    room : Room
        With the batch, and the groups to begin from on the stack.
    begins : int
        How many groups.
    target : Target
    """
    batch, lanes, low, high, found = room.batch, room.lanes, room.low, room.high, room.search.found
    position, normal, texel_mm2 = points.position, points.normal, points.texel_mm2
    leaves, size = tree.leaves, tree.leaf.shape[1] * LANES
    variance_mm2, table, density, first_light = sums.variance_mm2, sums.table, sums.density, sums.first_light
    share, out = target.share, target.out
    further = 3 * len(out) - 3  # channels beyond the first light's
    first_row = LIGHT + 3 * first_light
    widest = 0.0
    for t in range(LANES):
        k = batch[t]
        held = _held_variance(variance_mm2, sums.read, texel_mm2[k])
        variance = lattice_variance(held, texel_mm2[k], table)
        widest = max(widest, variance)
        for axis in range(3):
            lanes[axis * LANES + t], lanes[(_NORMAL + axis) * LANES + t] = position[k, axis], normal[k, axis]
        lanes[_RATE * LANES + t] = -1 / (64 * variance)
    radius = sums.cut * np.float32(np.sqrt(widest))
    x, y, z, rate = load(lanes, 0), load(lanes, LANES), load(lanes, 2 * LANES), load(lanes, _RATE * LANES)
    nx, ny, nz = load(lanes, _NORMAL * LANES), load(lanes, (_NORMAL + 1) * LANES), load(lanes, (_NORMAL + 2) * LANES)

    # Box, ball and cone around the batch: sources inside the opposite cone need the pair rule
    low[0], low[1], low[2] = least_lane(x), least_lane(y), least_lane(z)
    high[0], high[1], high[2] = greatest_lane(x), greatest_lane(y), greatest_lane(z)
    cx, cy, cz = _HALF * (low[0] + high[0]), _HALF * (low[1] + high[1]), _HALF * (low[2] + high[2])
    dx, dy, dz = x - cx, y - cy, z - cz
    far2 = greatest_lane(mul_add(dx, dx, mul_add(dy, dy, dz * dz)))
    ax, ay, az = sum_of_lanes(nx), sum_of_lanes(ny), sum_of_lanes(nz)
    length = np.sqrt(ax * ax + ay * ay + az * az) + TINY
    ax, ay, az = ax / length, ay / length, az / length
    closest = least_lane(mul_add(nx, ax, mul_add(ny, ay, nz * az)))
    sine = np.sqrt(max(np.float32(1) - closest * closest, _ZERO)) if closest > 0 else np.float32(2)
    within = radius + np.sqrt(far2)

    # The first light's three sums stay in registers, those of further lights in `lanes`
    total = broadcast(_ZERO)
    red, green, blue = broadcast(_ZERO), broadcast(_ZERO), broadcast(_ZERO)
    for c in range(further):
        store(lanes, (SUMS + 4 + c) * LANES, total)
    count = near_boxes(low, high, radius * radius, tree, room.search, begins, LEAVES)
    for i in range(count):
        ahead = found[min(i + _AHEAD, count - 1)] * size
        for row in range(first_row + 3):
            prefetch(leaves, ahead + row * LANES)
        base = found[i] * size
        bits = near_sources(leaves, base, low, high, radius * radius) & sources_around(
            leaves, base, cx, cy, cz, within * within
        )
        opposite = opposite_sources(leaves, base, ax, ay, az, sine) if sums.separate else 0
        while bits != 0:
            bit = lowest_bit(bits)
            bits &= bits - 1
            at = base + bit
            dx, dy, dz = (
                load_scalar(leaves, at) - x,
                load_scalar(leaves, at + LANES) - y,
                load_scalar(leaves, at + 2 * LANES) - z,
            )
            distance2 = mul_add(dx, dx, mul_add(dy, dy, dz * dz))
            w = gaussian(distance2 * (rate * load_scalar(leaves, at + NARROWING * LANES)))
            w *= load_scalar(leaves, at + AMPLITUDE * LANES)
            if opposite >> bit & 1:
                to = at + NORMAL * LANES
                mx, my, mz = (
                    load_scalar(leaves, to),
                    load_scalar(leaves, to + LANES),
                    load_scalar(leaves, to + 2 * LANES),
                )
                w *= pair_weight(
                    mul_add(nx, mx, mul_add(ny, my, nz * mz)),
                    mul_add(nx, dx, mul_add(ny, dy, nz * dz)),
                    _ZERO - mul_add(dx, mx, mul_add(dy, my, dz * mz)),
                    distance2 + TINY,
                )
            total += w
            at += first_row * LANES
            red = mul_add(w, load_scalar(leaves, at), red)
            green = mul_add(w, load_scalar(leaves, at + LANES), green)
            blue = mul_add(w, load_scalar(leaves, at + 2 * LANES), blue)
            for c in range(further):
                to = (SUMS + 4 + c) * LANES
                store(lanes, to, mul_add(w, load_scalar(leaves, at + (3 + c) * LANES), load(lanes, to)))

    store(lanes, SUMS * LANES, total)
    store(lanes, (SUMS + 1) * LANES, red)
    store(lanes, (SUMS + 2) * LANES, green)
    store(lanes, (SUMS + 3) * LANES, blue)
    for t in range(LANES):
        if t > 0 and batch[t] == batch[t - 1]:
            break  # only repetitions are left
        weight = lanes[SUMS * LANES + t]
        if density > 0:
            held = _held_variance(variance_mm2, sums.read, texel_mm2[batch[t]])
            factor = density * np.float32(variance_mm2 / held * lattice_gain(held, texel_mm2[batch[t]], table))
        elif weight > sums.faint:
            factor = np.float32(1) / weight
        else:
            continue
        texel = points.flat_index[batch[t]]
        counts = np.float32(1)
        if len(share):
            counts = np.float32(share[texel // share.shape[1], texel % share.shape[1]]) / np.float32(255)
        for light in range(len(out)):
            at = (SUMS + 1 + 3 * light) * LANES + t
            for c in range(3):
                value = lanes[at + c * LANES] * factor
                if len(share):
                    before = out[light, texel, c]
                    value = before + counts * (value - before)
                out[light, texel, c] = value
