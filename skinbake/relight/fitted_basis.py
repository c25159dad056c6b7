"""The lights that this head tells apart best: leading singular vectors of its irradiance under light from everywhere.

Irradiance at points of equal area under each harmonic of a high order is a matrix H, (points, J). Its singular vectors
are found from H^T H by iterating a subspace that begins at random [Halko2011]: J is some hundreds, whatever the number
of points. Sums have a fixed order; no linear algebra of several threads is asked.
"""

from __future__ import annotations

import numpy as np

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.relight.basis import LightBasis

FURTHER = 12  # vectors that are iterated beside those that are wanted
ITERATIONS = 12  # the tail of the singular values falls off slowly
SWEEPS = 12  # of Jacobi's method: three beyond those that double precision needs


def gram(irradiance: Float) -> Float:
    """H^T H of irradiance (points, J), summed in the order of the points, (J, J)."""
    out = np.zeros((irradiance.shape[1],) * 2)
    parallel_for(_gram, len(out), np.ascontiguousarray(irradiance.T, np.float64), out)
    return out


@kernel
def _gram(first: int, stop: int, columns: Float, out: Float) -> None:
    """Products of rows of (J, points) with all rows.

    Parameters
    ----------
    first, stop : int
        Rows.
    columns : ndarray of shape (J, points)
    out : ndarray of shape (J, J)
        Written.
    """
    for i in range(first, stop):
        for j in range(len(columns)):
            out[i, j] = _dot(columns, i, columns, j)


@kernel(inner=True)
def _dot(a: Float, i: int, b: Float, j: int) -> float:
    """Product of row i of `a` with row j of `b`, in eight running sums."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    count = a.shape[1] // 4 * 4
    for k in range(0, count, 4):
        s0 += a[i, k] * b[j, k]
        s1 += a[i, k + 1] * b[j, k + 1]
        s2 += a[i, k + 2] * b[j, k + 2]
        s3 += a[i, k + 3] * b[j, k + 3]
    for k in range(count, a.shape[1]):
        s0 += a[i, k] * b[j, k]
    return (s0 + s1) + (s2 + s3)


def fitted_basis(products: Float, count: int, seed: int) -> LightBasis:
    """The `count` lights whose irradiance holds most of that of suns from everywhere.

    Their irradiance is orthonormal over the points that were given, so that the coefficients of a light are the
    products of its irradiance with theirs.

    Parameters
    ----------
    products : ndarray of shape (J, J)
        What `gram` gives of irradiance under harmonics.
    count : int
        At most J.
    seed : int
    """
    size = len(products)
    width = min(size, count + FURTHER)
    start = np.random.default_rng([seed, 20]).standard_normal((width, size))
    vectors, value = np.empty((width, size)), np.empty(width)
    _leading(np.ascontiguousarray(products), start, vectors, value)
    order = np.argsort(-value, kind="stable")[:count]
    vectors, length = vectors[order], np.sqrt(np.maximum(value[order], 0))
    length = np.maximum(length, 1e-6 * max(float(length[0]), 1e-30))  # light that lights nothing
    vectors *= np.where(vectors[np.arange(count), np.abs(vectors).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    return LightBasis("fitted", vectors * length[:, None], (vectors / length[:, None]).T.copy())


@kernel
def _leading(matrix: Float, start: Float, vectors: Float, value: Float) -> None:
    """Leading eigenvectors of a symmetric matrix that has no negative ones, by iterating a subspace.

    Parameters
    ----------
    matrix : ndarray of shape (J, J)
    start : ndarray of shape (w, J)
        Changed.
    vectors : ndarray of shape (w, J)
        Written: unit, by rows.
    value : ndarray of shape (w,)
        Written: eigenvalues, in no order.
    """
    width, size = start.shape
    for turn in range(ITERATIONS):
        _orthonormalise(start)
        if turn < ITERATIONS - 1:
            for i in range(width):
                for j in range(size):
                    vectors[i, j] = _dot(start, i, matrix, j)
            start[:, :] = vectors
    # Rayleigh and Ritz: the matrix within the subspace, turned to its axes by Jacobi's rotations
    for i in range(width):
        for j in range(size):
            vectors[i, j] = _dot(start, i, matrix, j)
    inner = np.empty((width, width))
    for i in range(width):
        for j in range(width):
            inner[i, j] = _dot(vectors, i, start, j)
    turns = np.zeros((width, width))
    for i in range(width):
        turns[i, i] = 1.0
    _jacobi(inner, turns)
    for i in range(width):
        value[i] = inner[i, i]
        for j in range(size):
            total = 0.0
            for k in range(width):
                total += turns[i, k] * start[k, j]
            vectors[i, j] = total


@kernel(inner=True)
def _orthonormalise(rows: Float) -> None:
    """Gram and Schmidt's method, twice, on the rows of (w, J)."""
    width, size = rows.shape
    for i in range(width):
        for _ in range(2):
            for j in range(i):
                along = _dot(rows, i, rows, j)
                for k in range(size):
                    rows[i, k] -= along * rows[j, k]
        length = np.sqrt(_dot(rows, i, rows, i))
        for k in range(size):
            rows[i, k] = rows[i, k] / length if length > 0.0 else 0.0


@kernel(inner=True)
def _jacobi(matrix: Float, turns: Float) -> None:
    """Rotate a symmetric matrix (w, w) until it is diagonal; rows of `turns` become its eigenvectors [Golub2013].

    Parameters
    ----------
    matrix : ndarray of shape (w, w)
        Changed.
    turns : ndarray of shape (w, w)
        One at first.
    """
    size = len(matrix)
    for _ in range(SWEEPS):
        for p in range(size):
            for q in range(p + 1, size):
                if abs(matrix[p, q]) <= 1e-300:
                    continue
                ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(size):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                for k in range(size):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
                    a, b = turns[p, k], turns[q, k]
                    turns[p, k], turns[q, k] = c * a - s * b, s * a + c * b
