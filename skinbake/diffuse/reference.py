"""The exact surface integral over all texels: what every method is measured against.

Nothing is clustered, cut short of 6 sigma, or done in texture space; sums are float64. It shares with the surface
method the rule of `separate` and the widening of lobes narrower than a texel (`lattice_variance`), because both define
what is being approximated, and the tree of texels, which only finds neighbours.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.diffuse.lanes import LANES, lowest_bit
from skinbake.diffuse.lattice import lattice_gain, lattice_table, lattice_variance
from skinbake.diffuse.separate import passes
from skinbake.diffuse.sources import (
    AMPLITUDE,
    LIGHT,
    NORMAL,
    STACK,
    SourceTree,
    near_boxes,
    opposite_sources,
    tree_node,
)
from skinbake.numerics import Float

CUT_SIGMA = 6.0
_LEAVES = 32  # whose weights are computed side by side
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

    M(x) = sum_j a_j G(v, |x - x_j|) passes(x, j) E_j, over the same sum without E_j if `normalise`
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

    Returns
    -------
    ndarray of shape (P, C), float64
    """
    if not variance_mm2 > 0:
        raise ValueError(f"reference_integral: expected a variance > 0, got {variance_mm2}")
    out = np.zeros((len(position), texels.source.shape[1] - LIGHT))
    _integrate(
        position, normal, at_texel_mm2, float(variance_mm2), lattice_table(), CUT_SIGMA, texels.source,
        texels.leaf_start, texels.leaf, texels.box, texels.first_group, separate, normalise, out,
    )  # fmt: skip
    return out


@njit(cache=True, parallel=True)
def _integrate(  # type: ignore[no-untyped-def]
    position, normal, at_texel_mm2, variance_mm2, table, cut, source, leaf_start, leaf, box, first_group,
    separate, normalise, out,
):  # fmt: skip
    leaves, boxes = leaf.reshape(-1), box.reshape(-1)
    for p in prange(len(position)):
        stack, found = np.empty(STACK, np.int64), np.empty(len(leaf), np.int64)
        weight, at, total = np.empty(_LEAVES * LANES), position[p], 0.0
        variance = lattice_variance(variance_mm2, at_texel_mm2[p], table)
        radius2 = cut * cut * variance
        stack[0] = tree_node(0, len(first_group) - 1)
        count = near_boxes(at, at, np.float32(radius2 * _ROUNDING), boxes, first_group, stack, 1, 0, found)
        for some in range(0, count, _LEAVES):
            near = found[some : min(some + _LEAVES, count)]
            _distances2(near, leaves, np.float64(at[0]), np.float64(at[1]), np.float64(at[2]), weight)
            _gaussians(weight, 1 / (2 * variance), radius2)
            if separate:
                _keep_apart(near, leaves, at, normal[p], weight)
            total += _add(near, leaf_start, source, weight, out[p])
        if not normalise:
            out[p] *= lattice_gain(variance_mm2, at_texel_mm2[p], table) / (2 * np.pi * variance_mm2)
        elif total > 0:
            out[p] /= total


@njit(cache=True)
def _distances2(near, leaves, x, y, z, distance2):  # type: ignore[no-untyped-def]
    for i in range(len(near)):
        base = near[i] * (6 * LANES)
        for lane in range(LANES):
            dx = np.float64(leaves[base + lane]) - x
            dy = np.float64(leaves[base + LANES + lane]) - y
            dz = np.float64(leaves[base + 2 * LANES + lane]) - z
            distance2[i * LANES + lane] = dx * dx + dy * dy + dz * dz
    distance2[len(near) * LANES :] = np.inf


@njit(cache=True)
def _keep_apart(near, leaves, at, normal, weight):  # type: ignore[no-untyped-def]
    nx, ny, nz = np.float64(normal[0]), np.float64(normal[1]), np.float64(normal[2])
    for i in range(len(near)):
        bits = opposite_sources(leaves, near[i], normal[0], normal[1], normal[2], np.float32(0))
        while bits != 0:
            lane = lowest_bit(bits)
            bits &= bits - 1
            base = near[i] * (6 * LANES) + lane
            there = base + NORMAL * LANES
            mx, my, mz = leaves[there], leaves[there + LANES], leaves[there + 2 * LANES]
            dx, dy = np.float64(leaves[base]) - at[0], np.float64(leaves[base + LANES]) - at[1]
            dz = np.float64(leaves[base + 2 * LANES]) - at[2]
            distance2 = dx * dx + dy * dy + dz * dz
            if distance2 > 0 and weight[i * LANES + lane] > 0:
                weight[i * LANES + lane] *= passes(
                    nx * mx + ny * my + nz * mz,
                    nx * dx + ny * dy + nz * dz,
                    -(mx * dx + my * dy + mz * dz),
                    distance2,
                )


@njit(cache=True)
def _add(near, leaf_start, source, weight, sums):  # type: ignore[no-untyped-def]
    """Add the light of leaves' sources to the sums; their weights together."""
    total = 0.0
    for i in range(len(near)):
        first = leaf_start[near[i]]
        for lane in range(leaf_start[near[i] + 1] - first):
            w = weight[i * LANES + lane] * source[first + lane, AMPLITUDE]
            weight[i * LANES + lane] = w
            total += w
    for c in range(LIGHT, LIGHT + len(sums), 3):
        red, green, blue = 0.0, 0.0, 0.0
        for i in range(len(near)):
            first = leaf_start[near[i]]
            for lane in range(leaf_start[near[i] + 1] - first):
                w, s = weight[i * LANES + lane], first + lane
                red, green, blue = red + w * source[s, c], green + w * source[s, c + 1], blue + w * source[s, c + 2]
        sums[c - LIGHT], sums[c + 1 - LIGHT], sums[c + 2 - LIGHT] = (
            sums[c - LIGHT] + red, sums[c + 1 - LIGHT] + green, sums[c + 2 - LIGHT] + blue
        )  # fmt: skip
    return total


@njit(cache=True)
def _gaussians(x, rate, most):  # type: ignore[no-untyped-def]
    """exp(-rate x) in place, 0 for x > `most`; to 1e-12 of itself where rate x <= 18.

    As (Taylor of exp(-y))^64, which the compiler does for several values at once.
    """
    for i in range(len(x)):
        y = min(x[i], most) * (-rate / 64)
        p = 1 + y * (1 / 11)
        p = 1 + y * p * (1 / 10)
        p = 1 + y * p * (1 / 9)
        p = 1 + y * p * (1 / 8)
        p = 1 + y * p * (1 / 7)
        p = 1 + y * p * (1 / 6)
        p = 1 + y * p * (1 / 5)
        p = 1 + y * p * (1 / 4)
        p = 1 + y * p * (1 / 3)
        p = 1 + y * p * (1 / 2)
        p = 1 + y * p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        x[i] = p * p if x[i] <= most else 0.0
