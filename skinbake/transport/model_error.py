"""How far a bake is from light transport at the points where both are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float, safe_div


class GroupError(TypedDict):
    """A bake's distance from transport over a group of points, by channel.

    Attributes
    ----------
    points : int
    rms_rgb : list of float
        ||M_bake - M|| / ||M|| over the group's skin, without what the walks' own noise adds to it.
    stderr_rgb : list of float
        Standard error of that, from the walks' noise.
    bias_rgb : list of float
        (mean M_bake - mean M) / mean M.
    noise_rgb : list of float
        ||standard error of M|| / ||M||.
    """

    points: int
    rms_rgb: list[float]
    stderr_rgb: list[float]
    bias_rgb: list[float]
    noise_rgb: list[float]


def model_error(
    baked: Float, truth: Float, stderr: Float, weight: Float, groups: Mapping[str, NDArray[np.bool_]]
) -> dict[str, GroupError]:
    """Relative errors of a bake against transport, of all skin ("all") and of each group.

    Parameters
    ----------
    baked, truth, stderr : ndarrays of shape (P, 3)
        M of the bake; M of transport and its standard errors.
    weight : ndarray of shape (P,)
        Skin that each point stands for.
    groups : mapping of str to ndarray of shape (P,), bool

    Returns
    -------
    dict of str to GroupError
        Groups without points are left out.

    Raises
    ------
    ValueError
        If shapes differ, or there is no point.
    """
    if not baked.shape == truth.shape == stderr.shape or len(weight) != len(truth) or not len(truth):
        raise ValueError(f"model_error: shapes differ or are empty: {baked.shape}, {truth.shape}, {stderr.shape}")
    everywhere = {"all": np.ones(len(weight), np.bool_)} | dict(groups)
    return {
        name: _of_group(baked[mine], truth[mine], stderr[mine], weight[mine, None])
        for name, mine in everywhere.items()
        if mine.any()
    }


def _of_group(baked: Float, truth: Float, stderr: Float, weight: Float) -> GroupError:
    difference, noise = (baked - truth) ** 2, stderr**2
    norm = np.sqrt((weight * truth**2).sum(axis=0))
    square = (weight * (difference - noise)).sum(axis=0)
    # Of a sum of squares of normal deviates about d: variance 4 d^2 s^2 + 2 s^4
    spread = np.sqrt((weight**2 * (4 * np.maximum(difference - noise, 0) * noise + 2 * noise**2)).sum(axis=0))
    rms = np.sqrt(np.maximum(square, 0))
    return {
        "points": len(truth),
        "rms_rgb": safe_div(rms, norm).tolist(),
        "stderr_rgb": safe_div(spread / np.maximum(2 * rms, np.sqrt(spread) + 1e-300), norm).tolist(),
        "bias_rgb": safe_div((weight * (baked - truth)).sum(axis=0), (weight * truth).sum(axis=0)).tolist(),
        "noise_rgb": safe_div(np.sqrt((weight * noise).sum(axis=0)), norm).tolist(),
    }


def rms_words(rms: float, stderr: float) -> str:
    """A distance from transport as it is printed, without its unit: "4.1 % +- 0.3 %", or that it is lost in the noise.

    Parameters
    ----------
    rms, stderr : float
        As in `GroupError`, of a channel or of all.
    """
    if rms < stderr:
        return f"below {stderr:.1%}, the noise of its walks"
    return f"{rms:.1%} +- {stderr:.1%}"


class TermShare(TypedDict):
    """What a term takes off a group's distance from transport, by channel.

    Attributes
    ----------
    rms_rgb : list of float
        Distance without the term, less that with it; negative where it does harm.
    stderr_rgb : list of float
        Standard error of that, from the walks' noise.
    """

    rms_rgb: list[float]
    stderr_rgb: list[float]


def term_share(
    baked: Float, without: Float, truth: Float, stderr: Float, weight: Float, groups: Mapping[str, NDArray[np.bool_]]
) -> dict[str, TermShare]:
    """Relative rms that a term takes off, of all skin ("all") and of each group.

    Parameters
    ----------
    baked, without : ndarrays of shape (P, 3)
        M of the bake, and of one without the term.
    truth, stderr, weight, groups
        As in `model_error`.

    Returns
    -------
    dict of str to TermShare
        Groups without points are left out.
    """
    with_it, without_it = (model_error(each, truth, stderr, weight, groups) for each in (baked, without))
    everywhere = {"all": np.ones(len(weight), np.bool_)} | dict(groups)
    found: dict[str, TermShare] = {}
    for name, before in without_it.items():
        mine = everywhere[name]
        w, noise = weight[mine, None], stderr[mine]
        norm = np.sqrt((w * truth[mine] ** 2).sum(axis=0))
        first, second = np.array(before["rms_rgb"]), np.array(with_it[name]["rms_rgb"])
        # The difference of the squares knows the walks only through 2 (without - baked) truth
        spread = np.sqrt((w**2 * (2 * (without[mine] - baked[mine])) ** 2 * noise**2).sum(axis=0))
        found[name] = {
            "rms_rgb": (first - second).tolist(),
            "stderr_rgb": safe_div(safe_div(spread, norm**2), first + second).tolist(),
        }
    return found
