"""The exact surface integral over all texels: what every method is measured against.

Nothing is clustered, cut short of 6 sigma, or done in texture space; sums are float64. It shares with the surface
method the rule of `separate` and the widening of lobes narrower than a texel (`lattice_variance`), because both define
what is being approximated, and the tree of texels, which only finds neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.lattice import lattice_gain, lattice_table, lattice_variance
from skinbake.diffuse.surface_space.pair_rule import pair_weight
from skinbake.diffuse.surface_space.source_search import (
    LEAVES,
    STACK,
    Search,
    near_boxes,
    opposite_sources,
    tree_node,
)
from skinbake.diffuse.surface_space.sources import (
    AMPLITUDE,
    LIGHT,
    NORMAL,
    SourceTree,
)
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, lowest_bit, prefetch
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, even_stride

CUT_SIGMA = 6.0
_PIECE = 16  # points
_AHEAD = 8  # of them are on their way from memory
_LEAVES = 32  # whose weights are computed side by side
_ONE = np.int64(1)
_ROUNDING = 1 + 1e-4  # of the search's float32: what lies just within the cut is never missed


def reference_integral(
    texels: SourceTree,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    at_texel_mm2: NDArray[np.float32],
    variance_mm2: float,
    separate: bool = True,
    normalise: bool = True,
) -> Float:
    """M at points of the skin, by the integral of one Gaussian over every texel within 6 sigma.

    M(x) = sum_j a_j G(v, |x - x_j|) pair_weight(x, j) E_j, over the same sum without E_j if `normalise`
    [Jensen2002].

    Parameters
    ----------
    texels : SourceTree
        Every texel that has area, which is its amplitude.
    position, normal : ndarray of shape (P, 3), float32
    at_texel_mm2 : ndarray of shape (P,), float32
        Area of a texel at each point.
    variance_mm2 : float
        Greater than 0.
    separate : bool
        Whether `pair_weight` keeps pairs apart; else it is 1.
    normalise : bool
        Whether to divide by the sum of the weights; else by that of a plane.

    Returns
    -------
    ndarray of shape (P, C), float64

    Raises
    ------
    ValueError
        If the variance is not above 0.
    """
    if not variance_mm2 > 0:
        raise ValueError(f"reference_integral: expected a variance > 0, got {variance_mm2}")
    out = np.zeros((len(position), texels.leaf.shape[1] - LIGHT))
    order = _spatial_order(position)
    probes = _Probes(order, position, normal, at_texel_mm2)
    rule = _Rule(float(variance_mm2), lattice_table(), CUT_SIGMA, separate, normalise)
    parallel_for(_integrate, len(order), probes, texels.arrays, rule, out)
    return out


def _spatial_order(position: NDArray[np.float32]) -> NDArray[np.int64]:
    """Rows of points along a Z-curve: what one point has loaded, the next one finds in the processor's caches.

    Pieces of the curve are dealt out, or one thread would get the half of the skin that lies close together.
    """
    low, high = position.min(axis=0, initial=np.inf), position.max(axis=0, initial=-np.inf)
    cell = ((position - low) * (1023 / max(float((high - low).max(initial=0)), 1e-9))).astype(np.int64)
    place = np.zeros(len(position), np.int64)
    for bit in range(10):
        place |= ((cell >> bit & 1) << (3 * bit + np.arange(3))).sum(axis=1)
    order = np.argsort(place, kind="stable")
    pieces = -(-len(order) // _PIECE)
    turns = np.arange(pieces) * even_stride(pieces) % max(pieces, 1) * _PIECE
    return np.concatenate([order[start : start + _PIECE] for start in turns]) if pieces else order


class _Probes(NamedTuple):
    """Points at which the integral is taken.

    Attributes
    ----------
    order : ndarray of shape (P,), int64
        In which they are taken.
    position, normal : ndarrays of shape (P, 3), float32
    texel_mm2 : ndarray of shape (P,), float32
    """

    order: NDArray[np.int64]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    texel_mm2: NDArray[np.float32]


class _Rule(NamedTuple):
    """The integral of one Gaussian.

    Attributes
    ----------
    variance_mm2 : float
    table : tuple of two ndarrays
        `lattice_table()`.
    cut : float
        Sigmas.
    separate, normalise : bool
        As in `reference_integral`.
    """

    variance_mm2: float
    table: tuple[Float, Float]
    cut: float
    separate: bool
    normalise: bool


@kernel
def _integrate(first, stop, probes, tree, rule, out):  # type: ignore[no-untyped-def]
    """`reference_integral` at some points.

    Parameters
    ----------
    first, stop : int
        Places in `probes.order`.
    probes : _Probes
    tree : TreeArrays
    rule : _Rule
    out : ndarray of shape (P, C)
        Written.
    """
    order, position, normal, at_texel_mm2 = probes.order, probes.position, probes.normal, probes.texel_mm2
    variance_mm2, table, cut = rule.variance_mm2, rule.table, rule.cut
    separate, normalise, leaf = rule.separate, rule.normalise, tree.leaf
    for n in range(first, stop):
        p = order[n]
        search = Search(np.empty(STACK, np.int64), np.empty(len(leaf), np.int64))
        weight, sums, at = np.empty((_LEAVES, LANES)), np.zeros((1 + out.shape[1], LANES)), position[p]
        variance = lattice_variance(variance_mm2, at_texel_mm2[p], table)
        radius2 = cut * cut * variance
        search.stack[0] = tree_node(0, len(tree.first_group) - 1)
        within2 = np.float32(radius2 * _ROUNDING)
        count = near_boxes(at, at, within2, tree, search, _ONE, LEAVES)
        for some in range(0, count, _LEAVES):
            near = search.found[some : min(some + _LEAVES, count)]
            # Squared distances, then weights in their place
            _distances2(near, leaf, np.float64(at[0]), np.float64(at[1]), np.float64(at[2]), weight)
            _gaussians(weight.reshape(-1), 1 / (2 * variance), radius2)
            if separate:
                _keep_apart(near, leaf, at, normal[p], weight)
            _add(near, leaf, weight, sums)
        total = _sum(sums, 0)
        if not normalise:
            scale = lattice_gain(variance_mm2, at_texel_mm2[p], table) / (2 * np.pi * variance_mm2)
        for c in range(out.shape[1]):
            value = _sum(sums, 1 + c)
            if not normalise:
                value *= scale
            elif total > 0:
                value /= total
            out[p, c] = value


@kernel(inner=True)
def _distances2(near, leaf, x, y, z, distance2):  # type: ignore[no-untyped-def]
    """Squared distances of leaves' sources from a point, mm^2; infinite in the rows of `distance2` beyond them.

    Parameters
    ----------
    near : ndarray of shape (n,), int64
        Leaves.
    leaf : ndarray of shape (N, 8 + C, 16), float32
    x, y, z : float
        The point, mm.
    distance2 : ndarray of shape (at least n, 16)
        Written.
    """
    leaves, rows = leaf.reshape(-1), leaf.shape[1]
    for i in range(len(near)):
        at = leaf[near[i]]
        ahead = near[min(i + _AHEAD, len(near) - 1)] * (rows * LANES)
        for row in range(rows):
            prefetch(leaves, ahead + row * LANES)
        for lane in range(leaf.shape[2]):
            dx, dy, dz = np.float64(at[0, lane]) - x, np.float64(at[1, lane]) - y, np.float64(at[2, lane]) - z
            distance2[i, lane] = dx * dx + dy * dy + dz * dz
    for i in range(len(near), len(distance2)):
        for lane in range(distance2.shape[1]):
            distance2[i, lane] = np.inf


@kernel(inline=True)
def _sum(sums, row):  # type: ignore[no-untyped-def]
    """All lanes of a row of sums as one, in their order."""
    total = 0.0
    for lane in range(sums.shape[1]):
        total += sums[row, lane]
    return total


@kernel(inline=True)
def _keep_apart(near, leaf, at, normal, weight):  # type: ignore[no-untyped-def]
    """Multiply the weights of leaves' sources by `pair_weight`.

    Parameters
    ----------
    near : ndarray of shape (n,), int64
        Leaves.
    leaf : ndarray of shape (N, 8 + C, 16), float32
    at, normal : ndarrays of shape (3,), float32
        The point and its unit normal.
    weight : ndarray of shape (at least n, 16)
        Changed in place.
    """
    nx, ny, nz = np.float64(normal[0]), np.float64(normal[1]), np.float64(normal[2])
    leaves, size = leaf.reshape(-1), leaf.shape[1] * LANES
    for i in range(len(near)):
        bits = opposite_sources(leaves, near[i] * size, normal[0], normal[1], normal[2], np.float32(0))
        there = leaf[near[i]]
        while bits != 0:
            lane = lowest_bit(bits)
            bits &= bits - 1
            if weight[i, lane] > 0:
                mx, my, mz = there[NORMAL, lane], there[NORMAL + 1, lane], there[NORMAL + 2, lane]
                dx, dy = np.float64(there[0, lane]) - at[0], np.float64(there[1, lane]) - at[1]
                dz = np.float64(there[2, lane]) - at[2]
                distance2 = dx * dx + dy * dy + dz * dz
                if distance2 > 0:
                    weight[i, lane] *= pair_weight(
                        nx * mx + ny * my + nz * mz,
                        nx * dx + ny * dy + nz * dz,
                        -(mx * dx + my * dy + mz * dz),
                        distance2,
                    )


@kernel(inner=True)
def _add(near, leaf, weight, sums):  # type: ignore[no-untyped-def]
    """Add the weights of leaves' sources, and their light, lane by lane."""
    for i in range(len(near)):
        at, w = leaf[near[i]], weight[i]
        for lane in range(leaf.shape[2]):
            w[lane] *= at[AMPLITUDE, lane]
            sums[0, lane] += w[lane]
        for c in range(len(sums) - 1):
            for lane in range(leaf.shape[2]):
                sums[1 + c, lane] += w[lane] * at[LIGHT + c, lane]


@kernel(inner=True)
def _gaussians(x, rate, most):  # type: ignore[no-untyped-def]
    """exp(-rate x) in place, 0 for x > `most`; to 1e-10 of itself where rate x <= 18.

    As (Taylor of exp(-y))^64, which the compiler does for several values at once.
    """
    for i in range(len(x)):
        y = min(x[i], most) * (-rate / 64)
        p = 1 / 40320 + y * (1 / 362880)
        p = 1 / 5040 + y * p
        p = 1 / 720 + y * p
        p = 1 / 120 + y * p
        p = 1 / 24 + y * p
        p = 1 / 6 + y * p
        p = 1 / 2 + y * p
        p = 1 + y * p
        p = 1 + y * p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        x[i] = p * p if x[i] <= most else 0.0
