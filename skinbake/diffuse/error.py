"""How wrong lobes are, at probes: against the exact integral, split into method and storage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbake.diffuse.diffuse_map import MeasuredError
from skinbake.numerics import Float, norm_of_all

LEAST_SEEN = 20  # probes that a light falls on, as if evenly: by fewer its own error is not known


def relative_rms(got: Float, want: Float, scale: Float | None = None) -> float:
    """||got - want|| / ||scale or want||; 0 where both are nothing.

    Parameters
    ----------
    got, want : ndarrays of one shape
    scale : ndarray, optional
        What the difference is measured against, if not `want`.
    """
    norm = norm_of_all(want if scale is None else scale)
    difference = norm_of_all(got - want)
    return difference / norm if norm > 0 else (0.0 if difference == 0 else float("inf"))


def by_light(values: Float) -> Float:
    """Squares summed over the channels of each light, (P, L).

    Parameters
    ----------
    values : ndarray of shape (P, 3 L)
    """
    lights = max(1, values.shape[1] // 3)
    return np.square(values).reshape(len(values), lights, values.shape[1] // lights).sum(axis=2)


def seen_by(square: Float, weight: Float | float = 1.0) -> Float:
    """How many probes see each light, (L,), as if it fell on them evenly.

    Parameters
    ----------
    square : ndarray of shape (P, L)
        Of the light, as `by_light` gives it.
    weight : ndarray of shape (P, 1), optional
        Of the probes.
    """
    second, fourth = (weight * square).sum(axis=0), (weight * square * square).sum(axis=0)
    return np.divide(second**2, fourth, out=np.zeros_like(second), where=fourth > 0)


def worst_rms(got: Float, want: Float, scale: Float) -> float:
    """`relative_rms` of all lights together, or of the one of them that it is worst for.

    Each light may be the only one that shines: what is next to nothing of a bright sky may be much of a dim lamp.

    Parameters
    ----------
    got, want, scale : ndarrays of shape (P, 3 L)
        As of `relative_rms`.
    """
    square, wrong = by_light(scale), by_light(got - want)
    seen = seen_by(square) >= LEAST_SEEN
    own = wrong.sum(axis=0)[seen] / square.sum(axis=0)[seen]
    return max(relative_rms(got, want, scale), float(np.sqrt(own.max(initial=0.0))))


def measure_error(read: Float, unreduced: Float, exact: Float) -> MeasuredError:
    """Error of what a reader of the files sees, and its two parts, each of the light that it is worst for.

    Parameters
    ----------
    read : ndarray of shape (P, C)
        From the stored texture: its size, its precision, bilinear.
    unreduced : ndarray of shape (P, C)
        The method's own result at the same points.
    exact : ndarray of shape (P, C)
        The surface integral.

    Raises
    ------
    ValueError
        The shapes differ, or there is no probe.
    """
    if not read.shape == unreduced.shape == exact.shape:
        raise ValueError(f"measure_error: shapes differ: {read.shape}, {unreduced.shape}, {exact.shape}")
    if exact.size == 0:
        raise ValueError("measure_error: expected at least one probe")
    mean = float(exact.mean())
    relative = np.abs(read - exact) / mean if mean > 0 else np.abs(read - exact)
    return MeasuredError(
        rms=worst_rms(read, exact, exact),
        p95=float(np.percentile(relative, 95)),
        max=float(relative.max()),
        probes=len(exact),
        method=worst_rms(unreduced, exact, exact),
        storage=worst_rms(read, unreduced, exact),
    )


def weighted_sum(lobes: Sequence[Float], weight_rgb: Float) -> Float:
    """M = sum_i w_i lobe_i for (P, 3 L) values and weights (N, 3), or (N, P, 3) where they differ over the skin."""
    lights = lobes[0].shape[1] // 3
    total = np.zeros_like(lobes[0])
    for values, weight in zip(lobes, weight_rgb, strict=True):
        total += values * np.tile(weight, lights)
    return total
