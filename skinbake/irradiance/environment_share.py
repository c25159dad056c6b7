"""Which share of an environment's light reaches points of the skin: the same directions asked from every point."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import albedo_at
from skinbake.numerics import Float

Image = NDArray[np.float32]
CHUNK = 1 << 20  # rays in memory at a time
NO_OIL = np.zeros((0, 0, 2))  # in place of the table of the oil's albedo


def open_shares(
    origin: Image,
    normal: Image,
    directions: Image,
    weights: Image,
    occluder: Occluder | None,
    oil: tuple[Image, Image, Float, float] | None = None,
) -> Image:
    """Share of each channel that arrives and passes the oil, and of the mean of the channels that arrives, (n, 4).

    Parameters
    ----------
    origin, normal : ndarrays of shape (n, 3)
        Where rays start, and the smooth normals.
    directions, weights : ndarrays of shape (s, 3)
        Of `SkySamples.draw`.
    occluder : Occluder, optional
        None: nothing is in the way.
    oil : roughness (n,), strength (n,), table and f0, optional
    """
    zero = np.zeros(len(origin), np.float32)
    roughness, strength, table, f0 = oil or (zero, zero, NO_OIL, 0.0)
    out = np.empty((len(origin), 4), np.float32)
    step = max(1, CHUNK // len(directions))
    for start in range(0, len(origin), step):
        part = slice(start, start + step)
        bounds, sample = _above(normal[part], directions)
        clear = np.ones(len(sample), np.bool_)
        if occluder is not None:
            starts, rays = np.empty((len(sample), 3), np.float32), np.empty((len(sample), 3), np.float32)
            _aim(bounds, sample, origin[part], directions, starts, rays)
            clear = ~occluder.occluded(starts, rays, np.full(len(sample), np.inf, np.float32))
        _shares(
            bounds, sample, clear, normal[part], directions, weights, roughness[part], strength[part], table, f0,
            out[part],
        )  # fmt: skip
    return out


@njit(cache=True, parallel=True)
def _above(normal: Image, directions: Image) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Directions above each texel's horizon, as compressed lists."""
    count = np.zeros(len(normal) + 1, dtype=np.int64)
    for i in prange(len(normal)):
        for s in range(len(directions)):
            c = normal[i, 0] * directions[s, 0] + normal[i, 1] * directions[s, 1] + normal[i, 2] * directions[s, 2]
            if c > 0.0:
                count[i + 1] += 1
    bounds = np.cumsum(count)
    sample = np.empty(bounds[-1], dtype=np.int32)
    for i in prange(len(normal)):
        k = bounds[i]
        for s in range(len(directions)):
            c = normal[i, 0] * directions[s, 0] + normal[i, 1] * directions[s, 1] + normal[i, 2] * directions[s, 2]
            if c > 0.0:
                sample[k] = s
                k += 1
    return bounds, sample


@njit(cache=True, parallel=True)
def _aim(
    bounds: NDArray[np.int64], sample: NDArray[np.int32], origin: Image, directions: Image, starts: Image, rays: Image
) -> None:
    for i in prange(len(origin)):
        for k in range(bounds[i], bounds[i + 1]):
            for axis in range(3):
                starts[k, axis] = origin[i, axis]
                rays[k, axis] = directions[sample[k], axis]


@njit(cache=True, parallel=True)
def _shares(
    bounds: NDArray[np.int64],
    sample: NDArray[np.int32],
    clear: NDArray[np.bool_],
    normal: Image,
    directions: Image,
    weights: Image,
    roughness: Image,
    strength: Image,
    table: Float,
    f0: float,
    out: Image,
) -> None:
    """As `open_shares`, from the rays' answers."""
    for i in prange(len(normal)):
        sent, passed = np.zeros(4), np.zeros(4)
        for j in range(bounds[i], bounds[i + 1]):
            s = sample[j]
            cosine = np.float64(normal[i, 0]) * directions[s, 0]
            cosine += np.float64(normal[i, 1]) * directions[s, 1] + np.float64(normal[i, 2]) * directions[s, 2]
            oil = 1.0
            if table.size > 0:
                oil = min(max(1.0 - strength[i] * albedo_at(table, cosine, roughness[i], f0), 0.0), 1.0)
            for k in range(3):
                sent[k] += cosine * weights[s, k]
                sent[3] += cosine * weights[s, k]
                if clear[j]:
                    passed[k] += cosine * weights[s, k] * oil
                    passed[3] += cosine * weights[s, k]
        for k in range(4):
            out[i, k] = passed[k] / sent[k] if sent[k] > 0.0 else 0.0
