"""The hot loop of the surface method: Gaussian sums over sorted sources, sixteen targets abreast.

The lanes of the inner loops are neighbouring targets, not sources: each lane adds its sources in one fixed order, so
the result depends neither on the number of threads nor on the width of the machine's vectors.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from skinbake.diffuse.lanes import LANES, gaussian, load, mul_add, splat, store
from skinbake.diffuse.rows import AMPLITUDE, LIGHT, NARROWING, NORMAL
from skinbake.diffuse.separate import passes

_CHUNK = 64  # batches that share their scratch memory
_HALF = np.float32(0.5)
_ZERO = np.float32(0)
_TINY = np.float32(1e-20)


@njit(cache=True, parallel=True)
def gather(  # type: ignore[no-untyped-def]
    batches, position, normal, variance, gain, flat_index,  # targets: (B, 16), then (T, ...)
    source, row_start, origin, cell, rows_y, rows_z,  # see SourceRows
    cut, separate, scale, density,  # amplitudes are scaled; density > 0: out = density gain sum (not normalised)
    out, weight,  # (H*W, C), (H*W,)
):  # fmt: skip
    """out[t] = sum_s w_ts radiosity_s / sum_s w_ts, w_ts = amplitude_s exp(-d_ts^2 narrowing_s / 2 variance_t) p_ts.

    A target looks at least `cut` sqrt(variance_t) mm far. `weight` receives the sum of weights; where it
    is not positive `out` is left as it was. p_ts is the share that `passes`.
    """
    for chunk in prange((batches.shape[0] + _CHUNK - 1) // _CHUNK):
        scratch = np.empty((source.shape[1], LANES), np.float32)
        for b in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, batches.shape[0])):
            _gather_batch(
                batches[b], position, normal, variance, gain, flat_index, source, row_start, origin, cell,
                rows_y, rows_z, cut, separate, scale, density, scratch, out, weight,
            )  # fmt: skip


@njit(cache=True)
def _gather_batch(  # type: ignore[no-untyped-def]
    batch, position, normal, variance, gain, flat_index, source, row_start, origin, cell,
    rows_y, rows_z, cut, separate, scale, density, scratch, out, weight,
):  # fmt: skip
    channels = source.shape[1] - LIGHT
    at = scratch[:7]  # x y z, normal x y z, 1 / (64 variance)
    radius = _ZERO
    for t in range(LANES):
        k = batch[t]
        radius = max(radius, cut * np.sqrt(variance[k]))
        for axis in range(3):
            at[axis, t], at[3 + axis, t] = position[k, axis], normal[k, axis]
        at[6, t] = _HALF / (np.float32(32) * variance[k])
    flat = at.reshape(-1)
    x, y, z, rate = load(flat, 0), load(flat, LANES), load(flat, 2 * LANES), load(flat, 6 * LANES)
    nx, ny, nz = load(flat, 3 * LANES), load(flat, 4 * LANES), load(flat, 5 * LANES)

    # Cone of the batch's normals: sources inside the opposite one need the pair rule
    ax, ay, az = at[3].sum(), at[4].sum(), at[5].sum()
    length = np.sqrt(ax * ax + ay * ay + az * az) + _TINY
    ax, ay, az = ax / length, ay / length, az / length
    closest = np.float32(1)
    for t in range(LANES):
        closest = min(closest, at[3, t] * ax + at[4, t] * ay + at[5, t] * az)
    sine = np.sqrt(max(np.float32(1) - closest * closest, _ZERO)) if closest > 0 else np.float32(2)

    x0, x1 = at[0].min() - radius, at[0].max() + radius
    y0, y1, z0, z1 = at[1].min(), at[1].max(), at[2].min(), at[2].max()
    row_y0 = max(int(np.floor((y0 - radius - origin[1]) / cell)), 0)
    row_y1 = min(int(np.floor((y1 + radius - origin[1]) / cell)), rows_y - 1)
    row_z0 = max(int(np.floor((z0 - radius - origin[2]) / cell)), 0)
    row_z1 = min(int(np.floor((z1 + radius - origin[2]) / cell)), rows_z - 1)

    # The first light's three sums stay in registers, those of further lights in `more`
    total = splat(_ZERO)
    red, green, blue = splat(_ZERO), splat(_ZERO), splat(_ZERO)
    more = scratch[7 : 4 + channels].reshape(-1)
    more[:] = _ZERO
    for row_z in range(row_z0, row_z1 + 1):
        gap_z = max(origin[2] + row_z * cell - z1, z0 - origin[2] - (row_z + 1) * cell, _ZERO)
        for row_y in range(row_y0, row_y1 + 1):
            row = row_z * rows_y + row_y
            first, last = row_start[row], row_start[row + 1]
            if first == last:
                continue
            gap_y = max(origin[1] + row_y * cell - y1, y0 - origin[1] - (row_y + 1) * cell, _ZERO)
            rest = radius * radius - gap_y * gap_y - gap_z * gap_z
            if rest <= 0:
                continue
            less = radius - np.sqrt(rest)  # the ball is narrower here than at its middle
            first = _lower_bound(source, first, last, x0 + less)
            for s in range(first, last):
                if source[s, 0] > x1 - less:
                    break
                dx, dy, dz = source[s, 0] - x, source[s, 1] - y, source[s, 2] - z
                distance2 = mul_add(dx, dx, mul_add(dy, dy, dz * dz))
                w = gaussian(distance2 * (rate * source[s, NARROWING])) * (source[s, AMPLITUDE] * scale)
                if separate:
                    mx, my, mz = source[s, NORMAL], source[s, NORMAL + 1], source[s, NORMAL + 2]
                    if ax * mx + ay * my + az * mz < sine:
                        w *= passes(
                            mul_add(nx, mx, mul_add(ny, my, nz * mz)),
                            mul_add(nx, dx, mul_add(ny, dy, nz * dz)),
                            _ZERO - mul_add(dx, mx, mul_add(dy, my, dz * mz)),
                            distance2 + _TINY,
                        )
                total += w
                red = mul_add(w, source[s, LIGHT], red)
                green = mul_add(w, source[s, LIGHT + 1], green)
                blue = mul_add(w, source[s, LIGHT + 2], blue)
                for c in range(channels - 3):
                    store(more, c * LANES, mul_add(w, source[s, LIGHT + 3 + c], load(more, c * LANES)))

    sums = scratch[4 + channels :]
    store(sums.reshape(-1), 0, red)
    store(sums.reshape(-1), LANES, green)
    store(sums.reshape(-1), 2 * LANES, blue)
    store(sums.reshape(-1), 3 * LANES, total)
    for t in range(LANES):
        k = flat_index[batch[t]]
        weight[k] = sums[3, t]
        factor = density * gain[batch[t]]
        if density == 0:
            if not sums[3, t] > _TINY:
                continue
            factor = np.float32(1) / sums[3, t]
        for c in range(3):
            out[k, c] = sums[c, t] * factor
        for c in range(channels - 3):
            out[k, 3 + c] = more[c * LANES + t] * factor


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
