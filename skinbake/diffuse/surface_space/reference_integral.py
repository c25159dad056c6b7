"""The exact surface integral over all texels: what every method is measured against.

Nothing is clustered, cut short of 6 sigma, or done in texture space. Weights are float32, right to two millionths of
themselves within 4 sigma, and sums of more than a few leaves float64. It shares with the surface method the rule of
`separate` and the widening of lobes narrower than a texel (`lattice_variance`), because both define what is being
approximated, and the tree of texels, which only finds neighbours.
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
from skinbake.kernels.simd import LANES, load, load_scalar, lowest_bit, mul_add, prefetch, store
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, even_stride

CUT_SIGMA = 6.0
_PIECE = 16  # points
_AHEAD = 8  # of them are on their way from memory
_LEAVES = 32  # that are summed in float32
_ONE = np.int64(1)
_F32 = np.float32
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
    leaves, rows, channels = tree.leaves, tree.leaf.shape[1], out.shape[1]
    for n in range(first, stop):
        p = order[n]
        search = Search(np.empty(STACK, np.int64), np.empty(len(tree.leaf), np.int64))
        weight, few, total = np.empty(LANES, np.float32), np.empty((1 + channels) * LANES, np.float32), 0.0
        sums, at = np.zeros(channels), position[p]
        variance = lattice_variance(variance_mm2, at_texel_mm2[p], table)
        radius2 = np.float32(cut * cut * variance)
        lobe = _Lobe(at[0], at[1], at[2], np.float32(-1 / (32 * variance)), radius2)
        search.stack[0] = tree_node(0, len(tree.first_group) - 1)
        count = near_boxes(at, at, radius2 * np.float32(_ROUNDING), tree, search, _ONE, LEAVES)
        for some in range(0, count, _LEAVES):
            few[:] = 0
            for i in range(some, min(some + _LEAVES, count)):
                ahead = search.found[min(i + _AHEAD, count - 1)] * (rows * LANES)
                for row in range(rows):
                    prefetch(leaves, ahead + row * LANES)
                base = search.found[i] * (rows * LANES)
                _weigh(leaves, base, lobe, weight)
                if rule.separate:
                    _keep_apart(leaves, base, at, normal[p], weight)
                w = load(weight, 0) * load(leaves, base + AMPLITUDE * LANES)
                store(few, 0, load(few, 0) + w)
                for c in range(channels):
                    to = (1 + c) * LANES
                    store(few, to, mul_add(w, load(leaves, base + (LIGHT + c) * LANES), load(few, to)))
            for lane in range(LANES):
                total += few[lane]
            for c in range(channels):
                for lane in range(LANES):
                    sums[c] += few[(1 + c) * LANES + lane]
        scale = 1.0
        if not rule.normalise:
            scale = lattice_gain(variance_mm2, at_texel_mm2[p], table) / (2 * np.pi * variance_mm2)
        elif total > 0:
            scale = 1 / total
        for c in range(channels):
            out[p, c] = sums[c] * scale


class _Lobe(NamedTuple):
    """A Gaussian about a point, all float32.

    Attributes
    ----------
    x, y, z : float32
        The point, mm.
    rate : float32
        -1 / 16 of 1 / 2v, mm^-2.
    radius2 : float32
        Square of where it is cut, mm^2.
    """

    x: np.float32
    y: np.float32
    z: np.float32
    rate: np.float32
    radius2: np.float32


@kernel(inline=True)
def _weigh(leaves, base, lobe, weight):  # type: ignore[no-untyped-def]
    """exp(-d^2 / 2v) of a leaf's sources, 0 beyond the cut: as (Taylor of exp(-d^2 / 32v))^16.

    Off by at most 2e-6 of itself within 4 sigma, and by 8e-6 within 6.

    Parameters
    ----------
    leaves : ndarray, float32
        `SourceTree.leaf`, flat.
    base : int
        Where the leaf begins in it.
    lobe : _Lobe
    weight : ndarray of shape (16,), float32
        Written.
    """
    dx, dy, dz = (
        load(leaves, base) - lobe.x,
        load(leaves, base + LANES) - lobe.y,
        load(leaves, base + 2 * LANES) - lobe.z,
    )
    distance2 = mul_add(dx, dx, mul_add(dy, dy, dz * dz))
    y = min(distance2, lobe.radius2) * lobe.rate
    p = mul_add(y, _F32(1 / 3628800), _F32(1 / 362880))
    p = mul_add(y, p, _F32(1 / 40320))
    p = mul_add(y, p, _F32(1 / 5040))
    p = mul_add(y, p, _F32(1 / 720))
    p = mul_add(y, p, _F32(1 / 120))
    p = mul_add(y, p, _F32(1 / 24))
    p = mul_add(y, p, _F32(1 / 6))
    p = mul_add(y, p, _F32(1 / 2))
    p = mul_add(y, p, _F32(1))
    p = mul_add(y, p, _F32(1))
    p = p * p
    p = p * p
    p = p * p
    p = p * p
    # 1 within the cut, 0 beyond it
    within = min(max((lobe.radius2 - distance2) * _F32(1e30), _F32(0)), _F32(1))
    store(weight, 0, p * within)


@kernel(inline=True)
def _keep_apart(leaves, base, at, normal, weight):  # type: ignore[no-untyped-def]
    """Multiply the weights of a leaf's sources by `pair_weight`.

    Parameters
    ----------
    leaves, base
        As in `_weigh`.
    at, normal : ndarrays of shape (3,), float32
        The point and its unit normal.
    weight : ndarray of shape (16,), float32
        Changed in place.
    """
    bits = opposite_sources(leaves, base, normal[0], normal[1], normal[2], _F32(0))
    nx, ny, nz = np.float64(normal[0]), np.float64(normal[1]), np.float64(normal[2])
    while bits != 0:
        lane = lowest_bit(bits)
        bits &= bits - 1
        if weight[lane] > 0:
            to = base + lane
            dx, dy, dz = (
                np.float64(load_scalar(leaves, to)) - at[0],
                np.float64(load_scalar(leaves, to + LANES)) - at[1],
                np.float64(load_scalar(leaves, to + 2 * LANES)) - at[2],
            )
            to += NORMAL * LANES
            mx, my, mz = (
                np.float64(load_scalar(leaves, to)),
                np.float64(load_scalar(leaves, to + LANES)),
                np.float64(load_scalar(leaves, to + 2 * LANES)),
            )
            distance2 = dx * dx + dy * dy + dz * dz
            if distance2 > 0:
                weight[lane] *= pair_weight(
                    nx * mx + ny * my + nz * mz,
                    nx * dx + ny * dy + nz * dz,
                    -(mx * dx + my * dy + mz * dz),
                    distance2,
                )
