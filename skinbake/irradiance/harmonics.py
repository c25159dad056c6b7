"""Unshadowed irradiance of every normal by spherical harmonics up to order 2, theory.md 10.3 [Ramamoorthi2001].

The clamped cosine's Legendre series up to order 2 is k(c) = 3/32 + c/2 + 15/32 c^2. Summed over the sky it is a
quadratic form of the normal, E(n) = (n, 1)^T M (n, 1), whose matrix holds the sky's moments of order 0, 1 and 2:
nine numbers a channel.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

Image = NDArray[np.float32]
ROWS = 256  # of the map in memory at a time


def harmonic_matrix(radiance: Image, rotate_deg: float = 0.0) -> Float:
    """Matrix M of each channel, shape (3, 4, 4), from moments integrated exactly over each texel of the map (h, w,
    3).
    """
    height, width = radiance.shape[:2]
    polar = np.pi * np.arange(height + 1) / height
    y, s = np.cos(polar), np.sin(polar)
    # Of 1, y, y^2, s, s y, s^2 times s d polar, between the edges of the rows
    rows = np.diff([-y, -(y**2) / 2, -(y**3) / 3, polar / 2 - np.sin(2 * polar) / 4, s**3 / 3, y**3 / 3 - y], axis=1)
    azimuth = 2 * np.pi * (0.5 - np.arange(width + 1) / width) + math.radians(rotate_deg)
    sin, cos, twice = np.sin(azimuth), np.cos(azimuth), np.sin(2 * azimuth) / 4
    # Of 1, sin, cos, sin^2, cos^2, sin cos, between the edges of the columns
    cols = -np.diff([azimuth, -cos, sin, azimuth / 2 - twice, azimuth / 2 + twice, sin**2 / 2], axis=1)
    of_rows = np.zeros((len(rows), width, 3))
    for start in range(0, height, ROWS):  # rather than all of a large map in double precision
        strip = slice(start, start + ROWS)
        of_rows += np.tensordot(rows[:, strip], radiance[strip].astype(np.float64), (1, 0))
    moment = np.einsum("iwc,jw->ijc", of_rows, cols)

    one = moment[0, 0]
    x, y_, z = moment[3, 1], moment[1, 0], moment[3, 2]
    xx, yy, zz, xy, xz, yz = (moment[i] for i in ((5, 3), (2, 0), (5, 4), (4, 1), (5, 5), (4, 2)))
    a, b, c = 15 / 32, 1 / 4, 3 / 32
    rows_of_m = [
        [a * xx, a * xy, a * xz, b * x],
        [a * xy, a * yy, a * yz, b * y_],
        [a * xz, a * yz, a * zz, b * z],
        [b * x, b * y_, b * z, c * one],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows_of_m), 2, 0))


@kernel
def light_by_harmonics(
    first: int, stop: int, matrix: Float, normal: Image, addressed: NDArray[np.bool_], out: Image
) -> None:
    """Irradiance at texels by their normals, theory.md 10.3; 0 where the series rings below 0.

    Parameters
    ----------
    first, stop : int
        Rows.
    matrix : ndarray of shape (3, 4, 4)
    normal : ndarray of shape (H, W, 3)
        Unit.
    addressed : ndarray of shape (H, W)
        Texels to write.
    out : ndarray of shape (H, W, 3)
        Written.
    """
    for row in range(first, stop):
        for col in range(addressed.shape[1]):
            if not addressed[row, col]:
                continue
            x, y, z = np.float64(normal[row, col, 0]), np.float64(normal[row, col, 1]), np.float64(normal[row, col, 2])
            for k in range(3):
                m = matrix[k]
                value = m[0, 0] * x * x + m[1, 1] * y * y + m[2, 2] * z * z + m[3, 3]
                value += 2.0 * (m[0, 1] * x * y + m[0, 2] * x * z + m[1, 2] * y * z)
                value += 2.0 * (m[0, 3] * x + m[1, 3] * y + m[2, 3] * z)
                out[row, col, k] = max(value, 0.0)
