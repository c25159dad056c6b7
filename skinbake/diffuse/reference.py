"""The exact surface integral over all texels: what every method is measured against.

Nothing is clustered, cut short of 6 sigma, or done in texture space; sums are float64. It shares with the surface
method the rule of `separate` and the widening of lobes narrower than a texel (`lattice_gaussian`), because both define
what is being approximated, and the order of the texels in rows, which only finds neighbours.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.diffuse.lattice import lattice_gaussian
from skinbake.diffuse.rows import AMPLITUDE, LIGHT, NORMAL, SourceRows
from skinbake.diffuse.separate import passes
from skinbake.numerics import Float

CUT_SIGMA = 6.0


def reference_integral(
    texels: SourceRows,
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
    texels : SourceRows
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
    variance, gain = (values.astype(np.float64) for values in lattice_gaussian(variance_mm2, at_texel_mm2))
    out = np.zeros((len(position), texels.source.shape[1] - LIGHT))
    _integrate(
        position, normal, variance, gain, CUT_SIGMA, texels.source, texels.row_start,
        texels.origin.astype(np.float64), float(texels.cell), texels.rows_y, texels.rows_z, separate, normalise,
        1 / (2 * np.pi * variance_mm2), out,
    )  # fmt: skip
    return out


@njit(cache=True, parallel=True)
def _integrate(  # type: ignore[no-untyped-def]
    position, normal, variance, gain, cut, source, row_start, origin, cell, rows_y, rows_z, separate, normalise,
    density, out,
):  # fmt: skip
    channels = source.shape[1] - LIGHT
    for p in prange(len(position)):
        x, y, z = np.float64(position[p, 0]), np.float64(position[p, 1]), np.float64(position[p, 2])
        n0, n1, n2 = np.float64(normal[p, 0]), np.float64(normal[p, 1]), np.float64(normal[p, 2])
        r = cut * np.sqrt(variance[p])
        total = 0.0
        for row_z in range(
            max(int(np.floor((z - r - origin[2]) / cell)), 0),
            min(int(np.floor((z + r - origin[2]) / cell)), rows_z - 1) + 1,
        ):
            for row_y in range(
                max(int(np.floor((y - r - origin[1]) / cell)), 0),
                min(int(np.floor((y + r - origin[1]) / cell)), rows_y - 1) + 1,
            ):
                row = row_z * rows_y + row_y
                first, last = row_start[row], row_start[row + 1]
                end = last
                while first < end:  # first source of the row inside the cube around x
                    middle = (first + end) // 2
                    if source[middle, 0] < x - r:
                        first = middle + 1
                    else:
                        end = middle
                for s in range(first, last):
                    dx = source[s, 0] - x
                    if dx > r:
                        break
                    dy, dz = source[s, 1] - y, source[s, 2] - z
                    d2 = dx * dx + dy * dy + dz * dz
                    if d2 > r * r:
                        continue
                    w = source[s, AMPLITUDE] * np.exp(-d2 / (2.0 * variance[p]))
                    if separate and d2 > 0:
                        m0, m1, m2 = source[s, NORMAL], source[s, NORMAL + 1], source[s, NORMAL + 2]
                        w *= passes(
                            n0 * m0 + n1 * m1 + n2 * m2,
                            n0 * dx + n1 * dy + n2 * dz,
                            -(m0 * dx + m1 * dy + m2 * dz),
                            d2,
                        )
                    total += w
                    for c in range(channels):
                        out[p, c] += w * source[s, LIGHT + c]
        for c in range(channels):
            if not normalise:
                out[p, c] *= density * gain[p]
            elif total > 0:
                out[p, c] /= total
