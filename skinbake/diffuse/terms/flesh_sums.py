"""Sums over the faces of flesh at places of them: of the screened kernel and its slope (`flesh_form`).

Elements far off count by groups, in a tree of eight to a group. What a place finds waits until there is enough to be
summed sixteen at a time, in float32; differences of places are float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import (
    LANES,
    bits_below,
    gaussian,
    load,
    lowest_bit,
    mul_add,
    square_root,
    store,
    sum_of_lanes,
)
from skinbake.numerics import Float

REACH = 5.0  # diffusion lengths that are looked
FAN = 8  # elements, or groups of them, of a group
OPENING = 0.5  # radius of a group over its distance, at most, to be one source
FADED = 3.0  # diffusion lengths up to which elements are cut so that the kernel is even on them
NEAR, MOST_PARTS = 1.5, 8  # sides over distance: a near element is cut into (NEAR times that)^2 parts
EVEN = 1e-5  # slope below which all about is in one plane
TINY = 1e-12
WAITING = 512  # sources that are summed together, at most
_STEEP = np.float32(1e30)  # of what ends where it ends
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)


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
    sought : ndarray of shape (4 (n + 16),), float32
        Rows of x, y, z of the centroids and radii, sixteen further than there are.
    """

    start: NDArray[np.int64]
    middle: Float
    across: Float
    area: Float
    radius: Float
    spread: Float
    sought: NDArray[np.float32]


class _Waiting(NamedTuple):
    """Sources that wait to be summed, and what they have come to.

    Attributes
    ----------
    source : ndarray of shape (4 WAITING,), float32
        Rows of square of the distance, mm^2; area times normal along the way, mm^3; area, mm^2; and spread, mm^2, which
        makes the kernel's mean of its value in the middle, to second order.
    sums : ndarray of shape (2 C 16,), float32
        Of the kernel and of its slope along the source's normal, both times 4 pi, of each channel by lanes.
    """

    source: NDArray[np.float32]
    sums: NDArray[np.float32]


@kernel(inner=True)
def _sum_up(waiting, count, kappa):  # type: ignore[no-untyped-def]
    """Add `count` sources that wait to the sums."""
    source, sums = waiting
    for k in range(count, -(-count // LANES) * LANES):  # to fill the lanes
        source[k], source[WAITING + k], source[2 * WAITING + k], source[3 * WAITING + k] = _ONE, _ZERO, _ZERO, _ZERO
    for k in range(0, count, LANES):
        r2, area = load(source, k), load(source, 2 * WAITING + k)
        r = square_root(r2)
        inverse = _ONE / r
        facing, half_spread = load(source, WAITING + k) * inverse, load(source, 3 * WAITING + k) * _HALF
        for c in range(len(kappa)):
            rate = np.float32(kappa[c])
            reach = np.float32(REACH) / rate
            within = min(max((reach - r) * _STEEP, _ZERO), _ONE)
            screened = gaussian(r * (rate * np.float32(-1 / 32))) * inverse * within
            steep = inverse + rate
            bent = mul_add(steep, inverse, rate * rate)
            to = 2 * c * LANES
            store(sums, to, mul_add(area * screened, mul_add(half_spread, bent, _ONE), load(sums, to)))
            to += LANES
            store(sums, to, load(sums, to) - facing * screened * steep)


@kernel(inline=True)
def _wait(waiting, count, r2, along, area, spread):  # type: ignore[no-untyped-def]
    """Let a source wait, behind `count` others; how many there are then."""
    source = waiting.source
    source[count], source[WAITING + count] = r2, along
    source[2 * WAITING + count], source[3 * WAITING + count] = area, spread
    return count + 1


@kernel(inner=True)
def _wait_near(waiting, count, at, corner, piece, parts):  # type: ignore[no-untyped-def]
    """Let an element wait by the middles of parts^2 pieces of it; how many sources wait then.

    Parameters
    ----------
    waiting : _Waiting
    count : int
        How many wait already.
    at : tuple of three floats
        The receiver.
    corner : ndarray of shape (3, 3)
    piece : tuple of three floats
        Area times normal along the way, which all places of an element have in common, area and spread, of a piece.
    parts : int
    """
    along, area, spread = piece
    for i in range(parts):
        for j in range(parts - i):
            for other in range(2 if i + j < parts - 1 else 1):
                u, v = (i + (1 + other) / 3.0) / parts, (j + (1 + other) / 3.0) / parts
                w = 1.0 - u - v
                dx = w * corner[0, 0] + u * corner[1, 0] + v * corner[2, 0] - at[0]
                dy = w * corner[0, 1] + u * corner[1, 1] + v * corner[2, 1] - at[1]
                dz = w * corner[0, 2] + u * corner[1, 2] + v * corner[2, 2] - at[2]
                count = _wait(waiting, count, max(dx * dx + dy * dy + dz * dz, TINY), along, area, spread)
    return count


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
def decay_at(first, stop, mine, elements, groups, kappa, out):  # type: ignore[no-untyped-def]
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
    start, middle, across, area, radius, spread, sought = groups
    wide = len(sought) // 4
    sums = np.empty((2, len(kappa)))
    later = _Waiting(np.empty(4 * WAITING, np.float32), np.empty(2 * len(kappa) * LANES, np.float32))
    stack = np.empty((128, 2), np.int64)
    furthest = 0.0
    for c in range(len(kappa)):
        furthest = max(furthest, REACH / kappa[c])
    top = len(start) - 2
    for row in range(first, stop):
        own = mine[row]
        at = middle[own, 0], middle[own, 1], middle[own, 2]
        x, y, z = np.float32(at[0]), np.float32(at[1]), np.float32(at[2])
        sums[:] = 0.0
        later.sums[:] = _ZERO
        count = 0
        # Groups that are opened; above the one at the top stands one that has it alone
        stack[0, 0], stack[0, 1], waiting = top + 1, 0, 1
        while waiting > 0:
            waiting -= 1
            level, place = stack[waiting, 0] - 1, FAN * stack[waiting, 1]
            there = min(start[level + 1] - start[level] - place, FAN)
            begin = start[level] + place
            dx, dy, dz = (
                load(sought, begin) - x,
                load(sought, wide + begin) - y,
                load(sought, 2 * wide + begin) - z,
            )
            size = load(sought, 3 * wide + begin)
            distance = square_root(mul_add(dx, dx, mul_add(dy, dy, dz * dz)))
            near = bits_below(distance - size, np.float32(furthest)) & ((1 << there) - 1)
            opened = bits_below(distance * np.float32(OPENING), size) if level > 0 else 0
            while near != 0:
                child = lowest_bit(near)
                near &= near - 1
                if opened >> child & 1:
                    stack[waiting, 0], stack[waiting, 1] = level, place + child
                    waiting += 1
                    continue
                k = begin + child
                if k == own:
                    _add_own(at, elements.corner[k], elements.bend[k], kappa, sums)
                    continue
                dx, dy, dz = middle[k, 0] - at[0], middle[k, 1] - at[1], middle[k, 2] - at[2]
                away = np.sqrt(dx * dx + dy * dy + dz * dz)
                parts = 1
                if level == 0:
                    pieces = NEAR * 2.0 * radius[k] / max(away, TINY)
                    for c in range(len(kappa)):
                        if kappa[c] * (away - radius[k]) < FADED:
                            pieces = max(pieces, kappa[c] * radius[k])
                    parts = min(int(pieces) + 1, MOST_PARTS)
                if count + MOST_PARTS * MOST_PARTS > WAITING:
                    _sum_up(later, count, kappa)
                    count = 0
                along = dx * across[k, 0] + dy * across[k, 1] + dz * across[k, 2]
                if parts == 1:
                    count = _wait(later, count, max(away * away, TINY), along, area[k], spread[k])
                else:
                    share = 1.0 / (parts * parts)
                    piece = along * share, area[k] * share, spread[k] * share
                    count = _wait_near(later, count, at, elements.corner[k], piece, parts)
        _sum_up(later, count, kappa)
        for c in range(len(kappa)):
            sums[0, c] += sum_of_lanes(load(later.sums, 2 * c * LANES))
            sums[1, c] += sum_of_lanes(load(later.sums, (2 * c + 1) * LANES))
        for c in range(len(kappa)):
            beyond = 2.0 * np.pi * np.exp(-REACH) / kappa[c]  # of a plane
            out[row, c] = max(2.0 * np.pi + sums[1, c], 0.0) / max(sums[0, c] + beyond, TINY)
            if abs(sums[1, c]) < EVEN:
                out[row, c] = kappa[c]
