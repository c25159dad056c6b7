"""The shape of the profile of light from everywhere, over that of light along the normal; theory.md 9.9."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fresnel import boundary_factor, reflectance_from_inside
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.layers import Layer

DIRECTIONS, AZIMUTHS = 16, 12  # of quadrature: the ratio to 0.003
FREQUENCIES = 32
LEAST, MOST = 0.5, 2.0  # a lobe of light from everywhere weighs so much of what it does along the normal
STIFFNESS = 0.01  # of a factor that the shape says next to nothing about


def shape_ratio(layer: Layer, s_per_mm: Float) -> Float:
    """R~ of light from everywhere over R~ of light along the normal, each over its total, (M, 3).

    Light that has scattered once is followed exactly, all other by the dipole.

    Parameters
    ----------
    layer : Layer
        Semi-infinite, of an index of at least 1.
    s_per_mm : ndarray of shape (M,)
        Spatial frequencies.

    References
    ----------
    [Jensen2001]
    """
    node, weight = np.polynomial.legendre.leggauss(DIRECTIONS)
    cosine = (node + 1) / 2
    inside = np.sqrt(1 - (1 - cosine**2) / layer.eta**2)
    flux = weight * cosine * (1 - reflectance_from_inside(layer.eta, inside))  # that passes the face, of all directions
    s = np.concatenate([[0.0], np.asarray(s_per_mm, np.float64)])
    everywhere = _reflected(layer, s, inside, flux / flux.sum(), (inside, flux))
    normal = _reflected(layer, s, np.ones(1), np.ones(1), (inside, flux))
    ratio = everywhere / normal
    return np.asarray(ratio[1:] / ratio[0], np.float64)


def _reflected(layer: Layer, s: Float, mu: Float, share: Float, leaving: tuple[Float, Float]) -> Float:
    """R~ by what has scattered once and more often, (M, 3).

    Parameters
    ----------
    layer : Layer
    s : ndarray of shape (M,)
    mu, share : ndarray of shape (n,)
        Cosines inside of the light that entered, and how much of it goes there.
    leaving : two ndarrays of shape (m,)
        Cosines inside at which light leaves, and the flux over them that passes the face, outside.
    """
    path, albedo = layer.medium.free_path_mm, layer.medium.albedo
    out, passing = leaving
    # Once: down along one direction, up along another; z/l of both, and how far aside, by the angle between them
    turn = np.cos((np.arange(AZIMUTHS) + 0.5) / AZIMUTHS * np.pi)
    down, up = (np.sqrt(1 - c**2) / c for c in (mu[:, None, None], out[None, :, None]))
    aside2 = down**2 + up**2 + 2 * down * up * turn
    length = 1 / mu[:, None, None] + 1 / out[None, :, None]
    sl = s[:, None] * path
    met = 1 / np.sqrt(length**2 + (sl**2)[..., None, None, None] * aside2)
    escaping = passing / (2 * layer.eta**2 * out)  # of light that scatters to all sides; mu dmu = c dc / eta^2
    once = albedo / 2 * np.einsum("mcijk,i,j->mc", met, share / mu, escaping) / AZIMUTHS
    # More often: the dipole over the depths of first scattering, of light that goes on from there
    decay = np.sqrt((layer.medium.sigma_tr_per_mm * path) ** 2 + sl**2)
    first = 1 / np.sqrt((1 + decay[..., None] * mu) ** 2 + (sl**2)[..., None] * (1 - mu**2)) @ share
    image = np.exp(-2 * decay * layer.medium.extrapolation_mm(boundary_factor(layer.eta)) / path)
    spread = np.where(sl > 0, np.arctan(sl) / np.where(sl > 0, sl, 1), 1.0)
    again = (albedo - once[0]) * albedo / 2 * first * (1 + image) * spread
    return np.asarray(once + again, np.float64)


def diffuse_factors(gaussians: GaussianSum, layer: Layer) -> Float:
    """What each Gaussian weighs for light from everywhere, over its weight, (N, 3): of the same total, nearest in R~.

    Parameters
    ----------
    gaussians : GaussianSum
        Of light along the normal.
    layer : Layer
        As of `shape_ratio`.
    """
    factor = np.ones_like(gaussians.weight_rgb, np.float64)
    wide = np.flatnonzero(gaussians.variance_mm2 > 0)
    if not len(wide):
        return factor
    sigma = np.sqrt(gaussians.variance_mm2[wide])
    s = np.geomspace(0.1 / sigma.max(), 3 / sigma.min(), FREQUENCIES)
    ratio = shape_ratio(layer, s)
    blurred = np.exp(-0.5 * s[:, None] ** 2 * gaussians.variance_mm2[wide])
    for c in range(3):
        lobes = wide[gaussians.weight_rgb[wide, c] != 0]
        if len(lobes) < 2:
            continue
        weight = gaussians.weight_rgb[lobes, c] / gaussians.weight_rgb[lobes, c].sum()
        columns = blurred[:, np.isin(wide, lobes)] * weight
        # The total is kept by a heavy row, and exactly by what is left of it
        rows = np.concatenate([columns, 1e4 * weight[None], STIFFNESS * np.diag(np.ones(len(lobes)))])
        wanted = np.concatenate([columns.sum(axis=1) * (ratio[:, c] - 1), np.zeros(1 + len(lobes))])
        found = 1 + least_squares_within(rows, wanted, LEAST - 1, MOST - 1)
        factor[lobes, c] = found / (weight @ found)
    return factor


def least_squares_within(rows: Float, wanted: Float, least: float, most: float) -> Float:
    """x, (N,), within bounds, for which rows @ x is nearest to what is wanted; the bounds are seldom met.

    Parameters
    ----------
    rows : ndarray of shape (M, N)
    wanted : ndarray of shape (M,)
    least, most : float
        Bounds of each.
    """
    found = np.asarray(np.linalg.lstsq(rows, wanted, rcond=-1)[0], np.float64)
    if found.min() >= least and found.max() <= most:
        return found
    from scipy.optimize import lsq_linear  # 0.15 s to import, more than all the rest of a decision

    bounded: Float = lsq_linear(rows, wanted, (least, most)).x
    return bounded
