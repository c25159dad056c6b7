"""The hot loop of the surface method: Gaussian sums over sorted sources, sixteen targets abreast.

The lanes of the inner loops are neighbouring targets, not sources: each lane adds its sources in one fixed order, so
the result depends neither on the number of threads nor on the width of the machine's vectors.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from skinbake.diffuse.separate import passes

LANES = 16

_ONE = np.float32(1)
_HALF = np.float32(0.5)
_SIXTH = np.float32(1 / 6)
_TWENTYFOURTH = np.float32(1 / 24)
_HUNDRED_TWENTIETH = np.float32(1 / 120)
_TINY = np.float32(1e-20)
# exp(-x) = (Taylor of exp(-x/32))^32, x clamped to 32: relative error 2e-6 at 4 sigma, 2e-3 of e^-18 at 6 sigma
_STEPS = np.float32(32)


@njit(cache=True, parallel=True)
def gather(  # type: ignore[no-untyped-def]
    batches, position, normal, variance, gain, flat_index,  # targets: (B, 16), then (T, ...)
    source, narrowing, amplitude, source_normal, radiosity,  # (S, 3), (S,), (S,), (S, 3), (S, C)
    row_start, origin, cell, rows_y, rows_z,  # rows of sources along x, sorted by x inside each
    cut, separate, scale,  # scale > 0: out = scale gain sum (not normalised)
    out, weight,  # (H*W, C), (H*W,)
):  # fmt: skip
    """out[t] = sum_s w_ts radiosity_s / sum_s w_ts, w_ts = amplitude_s exp(-d_ts^2 narrowing_s / 2 variance_t) p_ts.

    A target looks at least `cut` sqrt(variance_t) mm far. `weight` receives the sum of weights; where it
    is not positive `out` is left as it was. p_ts is the share that `passes`.
    """
    channels = radiosity.shape[1]
    for b in prange(batches.shape[0]):
        x = np.empty(LANES, np.float32)
        y = np.empty(LANES, np.float32)
        z = np.empty(LANES, np.float32)
        nx = np.empty(LANES, np.float32)
        ny = np.empty(LANES, np.float32)
        nz = np.empty(LANES, np.float32)
        w = np.empty(LANES, np.float32)
        rate = np.empty(LANES, np.float32)
        total = np.zeros(LANES, np.float32)
        acc = np.zeros((channels, LANES), np.float32)
        radius = np.float32(0)
        for t in range(LANES):
            k = batches[b, t]
            radius = max(radius, cut * np.sqrt(variance[k]))
            rate[t] = _HALF / (_STEPS * variance[k])
            x[t], y[t], z[t] = position[k, 0], position[k, 1], position[k, 2]
            nx[t], ny[t], nz[t] = normal[k, 0], normal[k, 1], normal[k, 2]

        # Cone of the batch's normals: sources inside the opposite one need the pair rule
        ax, ay, az = nx.sum(), ny.sum(), nz.sum()
        length = np.sqrt(ax * ax + ay * ay + az * az) + _TINY
        ax, ay, az = ax / length, ay / length, az / length
        closest = (nx * ax + ny * ay + nz * az).min()
        sine = np.sqrt(max(_ONE - closest * closest, np.float32(0))) if closest > 0 else np.float32(2)

        x0, x1 = x.min() - radius, x.max() + radius
        y0, y1, z0, z1 = y.min(), y.max(), z.min(), z.max()
        row_y0 = max(int(np.floor((y0 - radius - origin[1]) / cell)), 0)
        row_y1 = min(int(np.floor((y1 + radius - origin[1]) / cell)), rows_y - 1)
        row_z0 = max(int(np.floor((z0 - radius - origin[2]) / cell)), 0)
        row_z1 = min(int(np.floor((z1 + radius - origin[2]) / cell)), rows_z - 1)
        for row_z in range(row_z0, row_z1 + 1):
            gap_z = max(origin[2] + row_z * cell - z1, z0 - origin[2] - (row_z + 1) * cell, np.float32(0))
            for row_y in range(row_y0, row_y1 + 1):
                row = row_z * rows_y + row_y
                first, last = row_start[row], row_start[row + 1]
                if first == last:
                    continue
                gap_y = max(origin[1] + row_y * cell - y1, y0 - origin[1] - (row_y + 1) * cell, np.float32(0))
                rest = radius * radius - gap_y * gap_y - gap_z * gap_z
                if rest <= 0:
                    continue
                less = radius - np.sqrt(rest)  # the ball is narrower here than at its middle
                first = _lower_bound(source, first, last, x0 + less)
                for s in range(first, last):
                    xs, ys, zs = source[s, 0], source[s, 1], source[s, 2]
                    if xs > x1 - less:
                        break
                    narrowing_s, amplitude_s = narrowing[s], amplitude[s]
                    for t in range(LANES):
                        dx, dy, dz = xs - x[t], ys - y[t], zs - z[t]
                        e = min((dx * dx + dy * dy + dz * dz) * (rate[t] * narrowing_s), _ONE)
                        p = _ONE + e * (
                            -_ONE + e * (_HALF - e * (_SIXTH - e * (_TWENTYFOURTH - e * _HUNDRED_TWENTIETH)))
                        )
                        p = p * p
                        p = p * p
                        p = p * p
                        p = p * p
                        w[t] = p * p * amplitude_s
                    if separate:
                        mx, my, mz = source_normal[s, 0], source_normal[s, 1], source_normal[s, 2]
                        if ax * mx + ay * my + az * mz < sine:
                            for t in range(LANES):
                                dx, dy, dz = xs - x[t], ys - y[t], zs - z[t]
                                w[t] *= passes(
                                    nx[t] * mx + ny[t] * my + nz[t] * mz,
                                    nx[t] * dx + ny[t] * dy + nz[t] * dz,
                                    -(mx * dx + my * dy + mz * dz),
                                    dx * dx + dy * dy + dz * dz + _TINY,
                                )
                    for t in range(LANES):
                        total[t] += w[t]
                    for c in range(channels):
                        r = radiosity[s, c]
                        for t in range(LANES):
                            acc[c, t] += w[t] * r
        for t in range(LANES):
            k = flat_index[batches[b, t]]
            weight[k] = total[t]
            if scale > 0:
                for c in range(channels):
                    out[k, c] = acc[c, t] * (scale * gain[batches[b, t]])
            elif total[t] > _TINY:
                for c in range(channels):
                    out[k, c] = acc[c, t] / total[t]


@njit(cache=True, inline="always")
def _lower_bound(source, first, last, x):  # type: ignore[no-untyped-def]
    """First source of the row whose x is not below x."""
    while first < last:
        middle = (first + last) // 2
        if source[middle, 0] < x:
            first = middle + 1
        else:
            last = middle
    return first


@njit(cache=True)
def make_batches(texel, block, position, reach):  # type: ignore[no-untyped-def]
    """Group targets of each 4 x 4 block of texels that lie within `reach` mm of the group's first, (B, 16).

    Parameters
    ----------
    texel : ndarray of shape (H, W), int32
        Row of `position` of each texel, or -1.
    block : int
        Width and height of a block in texels.
    position : ndarray of shape (T, 3), float32
    reach : float

    Returns
    -------
    ndarray of shape (B, 16), int32
        Short groups repeat their last target.
    """
    height, width = texel.shape
    count = 0
    out = np.empty((position.shape[0] // 4 + 1024, LANES), np.int32)
    members = np.empty(block * block, np.int32)
    for top in range(0, height, block):
        for left in range(0, width, block):
            n = 0
            for row in range(top, min(top + block, height)):
                for col in range(left, min(left + block, width)):
                    if texel[row, col] >= 0:
                        members[n] = texel[row, col]
                        n += 1
            while n > 0:
                if count == out.shape[0]:
                    larger = np.empty((2 * count, LANES), np.int32)
                    larger[:count] = out
                    out = larger
                seed = members[0]
                taken, left_over = 0, 0
                for i in range(n):
                    k = members[i]
                    near = True
                    for axis in range(3):
                        near = near and abs(position[k, axis] - position[seed, axis]) <= reach
                    if near and taken < LANES:
                        out[count, taken] = k
                        taken += 1
                    else:
                        members[left_over] = k
                        left_over += 1
                for i in range(taken, LANES):
                    out[count, i] = out[count, taken - 1]
                n = left_over
                count += 1
    return out[:count].copy()
