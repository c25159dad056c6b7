"""Starting points of the search for variances: a non-negative fit on a dense grid, merged down to the number wanted."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fit_nodes import FitNodes

GRID_RATIO = 1.4  # between variances of the dense grid


def dense_fit(nodes: FitNodes, wanted: Float, log_range: tuple[float, float]) -> tuple[Float, list[Float]]:
    """Grid of ln v, and two measures of how much a non-negative fit uses each of its Gaussians.

    The problem is convex, so its solution puts neighbours about every Gaussian that the profile contains.

    Parameters
    ----------
    nodes : FitNodes
    wanted : ndarray of shape (M, C)
        Weighted target, each channel of norm 1.
    log_range : tuple of float
        Least and greatest ln v.

    Returns
    -------
    log_v : ndarray of shape (K,)
    importance : list of two ndarrays of shape (K,)
        By light, and by share in the norm.
    """
    from scipy.optimize import nnls

    log_v = np.linspace(*log_range, max(2, int((log_range[1] - log_range[0]) / np.log(GRID_RATIO)) + 1))
    columns = nodes.basis(np.exp(log_v))[0] * nodes.root_weight[:, None]
    norm = np.linalg.norm(columns, axis=0)
    q, r = np.linalg.qr(columns / norm)
    kept = np.stack([nnls(r, q.T @ wanted[:, c], maxiter=40 * len(log_v))[0] for c in range(wanted.shape[1])])
    light = kept / norm
    by_light = light / light.sum(axis=1, keepdims=True).clip(1e-300)
    return log_v, [by_light.sum(axis=0), (kept**2).sum(axis=0)]


def merged(log_v: Float, importance: Float, count: int) -> Float:
    """Centres of `count` clusters of a grid, ascending: neighbours merge, least spread first; gaps are filled if too
    few.

    Parameters
    ----------
    log_v, importance : ndarray of shape (K,)
    count : int
        At least 1.
    """
    some = importance > 1e-9 * importance.sum()
    if not some.any():
        return np.linspace(log_v[0], log_v[-1], count)
    centres, mass = list(log_v[some]), list(importance[some])
    while len(centres) > count:
        a, m = np.array(centres), np.array(mass)
        spread = m[1:] * m[:-1] / (m[1:] + m[:-1]) * np.diff(a) ** 2
        k = int(np.argmin(spread))
        centres[k] = (a[k] * m[k] + a[k + 1] * m[k + 1]) / (m[k] + m[k + 1])
        mass[k] += mass[k + 1]
        del centres[k + 1], mass[k + 1]
    while len(centres) < count:
        ends = [log_v[0], *centres, log_v[-1]]
        k = int(np.argmax(np.diff(ends)))
        centres = sorted([*centres, (ends[k] + ends[k + 1]) / 2])
    return np.array(centres)
