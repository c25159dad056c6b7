"""Albedo A(c, m) of the oil layer, and the share of light that passes it; theory.md 6.4, 6.5."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from skinbake.irradiance.oil_layer import ENERGY_TRUE_STRENGTH, ROUGHNESS_MIN
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float, sqr
from skinbake.scene.spec import SpecularSpec

TABLE_SIZE = (512, 128)  # cosines by roughnesses
TABLE_ERROR = 5e-4  # largest |table / integral - 1| for m >= 0.05; 2e-3 from 0.01, 0.1 below (only where c is about m)
TABLE_NODES = 16  # off by 7e-5 at most, a seventh of what the table may be
_POINTS = 64  # each way; the polynomial is off by 2.4e-4 from m = 0.01 on, by 6e-3 below
_TAIL = 6.5  # exp(-6.5^2) = 4e-19


class OilLayer(NamedTuple):
    """The oil layer as the kernels take it.

    Attributes
    ----------
    roughness, strength : ndarrays of shape (H, W), (1, 1) or (n,), float32
        Beckmann m, and rho_s.
    table : ndarray of shape (C, M, 2)
        `specular_albedo_table`; of size 0 where the oil takes nothing off.
    f0 : ndarray of shape (H, W), (1, 1) or (n,), float64
        Reflectance at normal incidence.
    """

    roughness: NDArray[np.float32]
    strength: NDArray[np.float32]
    table: Float
    f0: Float


def integrate_specular_albedo(cos_theta: ArrayLike, roughness: ArrayLike, nodes: int = 32) -> Float:
    """Albedo A(c, m) of theory.md 6.5 for rho_s = 1, split by Fresnel.

    Schlick's F = f0 (1 - q) + q with q = (1 - V.H)^5 is linear in f0, so two numbers serve every f0:
    A = f0 * result[..., 0] + result[..., 1], and A for F = 1 is their sum.

    Parameters
    ----------
    cos_theta, roughness : array_like of shape (...)
    nodes : int
        Nodes of Gauss-Legendre quadrature, in slope and in azimuth each.

    Returns
    -------
    ndarray of shape (..., 2)

    References
    ----------
    [Kelemen2001], [dEon2007]
    """
    c, m = np.broadcast_arrays(np.asarray(cos_theta, np.float64), np.asarray(roughness, np.float64))
    x, weight = np.polynomial.legendre.leggauss(nodes)
    quarter, weight = np.pi / 4 * (x + 1), weight * np.pi / 4
    # Substituted: the azimuth's limit has square-root ends, and near it little light goes up at grazing
    slope_rule = np.stack([np.sin(quarter) ** 2, weight * np.sin(2 * quarter)])
    azimuth_rule = np.stack([np.sin(quarter), weight * np.cos(quarter)])
    out = np.empty((c.size, 2))
    _integrate_each(c.ravel(), m.ravel(), slope_rule, azimuth_rule, out)
    return out.reshape(*c.shape, 2)


@kernel
def _integrate_each(cos_theta: Float, roughness: Float, slope_rule: Float, azimuth_rule: Float, out: Float) -> None:
    """A split by Fresnel, for each pair of cosine and roughness; theory.md 6.5.

    Parameters
    ----------
    cos_theta, roughness : ndarrays of shape (n,)
    slope_rule, azimuth_rule : ndarrays of shape (2, nodes)
        Places in 0 ... 1, and weights.
    out : ndarray of shape (n, 2)
        Written.
    """
    for i in range(len(cos_theta)):
        c, m = min(max(cos_theta[i], 1e-6), 1.0), max(roughness[i], ROUGHNESS_MIN)
        # In slope = tan(alpha)/m: below the first bound every azimuth of H sends light up, above the second none does
        half_turn, theta = np.pi / 2, np.arccos(c)
        first = min(np.tan((half_turn - theta) / 2) / m, _TAIL)
        second = min(np.tan(min((half_turn + theta) / 2, half_turn - 1e-9)) / m, _TAIL)
        below = _slope_integral(c, m, 0.0, first, slope_rule, azimuth_rule)
        above = _slope_integral(c, m, first, second, slope_rule, azimuth_rule)
        out[i, 0], out[i, 1] = below[0] + above[0], below[1] + above[1]


@kernel(inner=True)
def _slope_integral(
    c: float, m: float, start: float, stop: float, slope_rule: Float, azimuth_rule: Float
) -> tuple[float, float]:
    """The part of theory.md 6.5 between two slopes, without and with Schlick's (1 - V.H)^5.

    Parameters
    ----------
    c, m : float
        Cosine N.V or N.L, and Beckmann's roughness.
    start, stop : float
        Bounds of slope = tan(alpha) / m.
    slope_rule, azimuth_rule : ndarrays of shape (2, nodes)
        Places in 0 ... 1, and weights.
    """
    total, schlick_total = 0.0, 0.0
    sin_view = np.sqrt(1 - c * c)
    for j in range(slope_rule.shape[1]):
        slope = start + (stop - start) * slope_rule[0, j]
        radial = (stop - start) * slope_rule[1, j] * slope * np.exp(-slope * slope)  # exp(-t) dt / 2
        tan_a = slope * m
        cos_a = 1 / np.sqrt(1 + tan_a * tan_a)
        side = tan_a * cos_a * sin_view  # sin_a sin_view

        # N.L > 0 bounds the azimuth, so the integrand is smooth: V.H > c / (2 N.H)
        if side == 0:
            limit = np.pi if cos_a > np.sqrt(0.5) else 0.0
        else:
            limit = np.arccos(min(max((c / (2 * cos_a) - c * cos_a) / side, -1.0), 1.0))
        for k in range(azimuth_rule.shape[1]):
            # V.H, N.L and F by the half vector, theory.md 6.5
            v_dot_h = side * np.cos(limit * azimuth_rule[0, k]) + c * cos_a
            azimuth = 2 * limit * azimuth_rule[1, k] * max(2 * v_dot_h * cos_a - c, 0.0) / (v_dot_h * cos_a)
            away = min(max(1 - v_dot_h, 0.0), 1.0)
            away2 = away * away
            schlick = away * (away2 * away2)
            total += radial * azimuth * (1 - schlick)
            schlick_total += radial * azimuth * schlick
    return total, schlick_total


@lru_cache(maxsize=1)
def specular_albedo_table() -> Float:
    """Table of `integrate_specular_albedo`, shape (*TABLE_SIZE, 2), read-only.

    Node (i, j) is c = (i / (C - 1))^2, m = (j / (M - 1))^2: both are squared for A bends most near 0. Read bilinearly.
    A polynomial through integrals at Chebyshev's points fills it, which costs a tenth of integrating each node.
    """
    place = (chebyshev.chebpts1(_POINTS) + 1) / 2
    integral = integrate_specular_albedo(sqr(place)[:, None], sqr(place)[None, :], TABLE_NODES)
    by_cosine, by_roughness = (_through_chebyshev_points(np.linspace(0, 1, n)) for n in TABLE_SIZE)
    table = np.stack([by_cosine @ integral[..., k] @ by_roughness.T for k in range(2)], -1)
    table.flags.writeable = False
    return table


def _through_chebyshev_points(place: Float) -> Float:
    """Matrix (n, _POINTS) from values at Chebyshev's points of 0 ... 1 to those of the polynomial at n places."""
    node = chebyshev.chebpts1(_POINTS)
    # Its coefficients are sums over the points, where Chebyshev's polynomials are orthogonal
    coefficients = chebyshev.chebvander(node, _POINTS - 1).T * (2 / _POINTS)
    coefficients[0] /= 2
    return chebyshev.chebvander(2 * place - 1, _POINTS - 1) @ coefficients


def oil_table(specular: SpecularSpec) -> Float:
    """The table of a look's oil, a copy of shape (*TABLE_SIZE, 2): with a second lobe, that of both mixed.

    A(c, m) of the sum is linear in the lobes, and the second one's roughness is the same everywhere, so that mixing its
    column into every other makes a table that is read like any.
    """
    table = np.array(specular_albedo_table())  # a writeable copy: numba compiles again for a read-only array
    if specular.second is None:
        return table
    place = np.sqrt(specular.second.roughness) * (TABLE_SIZE[1] - 1)
    low = min(int(place), TABLE_SIZE[1] - 2)
    column = (1 - (place - low)) * table[:, low] + (place - low) * table[:, low + 1]
    return (1 - specular.second.mix) * table + specular.second.mix * column[:, None]


@kernel(inner=True)
def albedo_at(table: Float, cos_theta: float, roughness: float, f0: float) -> float:
    """Albedo A(c, m) for rho_s = 1, read bilinearly from the table; for use inside numba kernels.

    Parameters
    ----------
    table : ndarray of shape (C, M, 2)
        As `specular_albedo_table`.
    cos_theta, roughness : float
        Clamped to 0 ... 1.
    f0 : float
        Reflectance at normal incidence.
    """
    x = np.sqrt(min(max(cos_theta, 0.0), 1.0)) * (table.shape[0] - 1)
    y = np.sqrt(min(max(roughness, 0.0), 1.0)) * (table.shape[1] - 1)
    i = min(int(x), table.shape[0] - 2)
    j = min(int(y), table.shape[1] - 2)
    x -= i
    y -= j
    a = (1 - y) * (f0 * table[i, j, 0] + table[i, j, 1]) + y * (f0 * table[i, j + 1, 0] + table[i, j + 1, 1])
    b = (1 - y) * (f0 * table[i + 1, j, 0] + table[i + 1, j, 1]) + y * (
        f0 * table[i + 1, j + 1, 0] + table[i + 1, j + 1, 1]
    )
    return (1 - x) * a + x * b


@kernel
def _albedo_each(table: Float, cos_theta: Float, roughness: Float, f0: float) -> Float:
    """Albedo A(c, m) for each pair of cosine and roughness, shape (n,).

    Parameters
    ----------
    table : ndarray of shape (C, M, 2)
    cos_theta, roughness : ndarrays of shape (n,)
    f0 : float
    """
    out = np.empty(cos_theta.size)
    for k in range(cos_theta.size):
        out[k] = albedo_at(table, cos_theta[k], roughness[k], f0)
    return out


def specular_albedo(
    cos_theta: ArrayLike, roughness: ArrayLike, f0: float = 1 / 36, table: Float | None = None
) -> Float:
    """Directional albedo A(c, m) of the oil layer for rho_s = 1, from the table (relative error `TABLE_ERROR`).

    Parameters
    ----------
    cos_theta : array_like of shape (...)
        N.V or N.L; clamped to 0 ... 1.
    roughness : array_like, a scalar or of the shape of `cos_theta`
    f0 : float
        Reflectance at normal incidence.
    table : ndarray, optional
        `oil_table`, where there may be a second lobe.

    Returns
    -------
    ndarray of shape (...)
        Divide by pi for the energy-true albedo.
    """
    cos_theta, roughness = np.broadcast_arrays(np.asarray(cos_theta, np.float64), np.asarray(roughness, np.float64))
    table = np.array(specular_albedo_table()) if table is None else table
    flat = _albedo_each(table, cos_theta.ravel(), roughness.ravel(), float(f0))
    return flat.reshape(cos_theta.shape)


def transmitted_share(
    cos_theta: ArrayLike,
    roughness: ArrayLike,
    f0: float = 1 / 36,
    strength: ArrayLike = ENERGY_TRUE_STRENGTH,
    table: Float | None = None,
) -> Float:
    """Share rho_dt = 1 - rho_s A(c, m) of the light that passes the oil, clamped to 0 ... 1; theory.md 6.4.

    Only for `strength` above `ENERGY_TRUE_STRENGTH` can the clamp bite: near grazing the layer then reflects more than
    it gets.

    Parameters
    ----------
    cos_theta : array_like of shape (...)
    roughness : array_like, a scalar or of the shape of `cos_theta`
    f0 : float
        Reflectance at normal incidence.
    strength : array_like
        rho_s.
    table : ndarray, optional
        As of `specular_albedo`.
    """
    albedo = specular_albedo(cos_theta, roughness, f0, table)
    return np.clip(1 - np.asarray(strength, np.float64) * albedo, 0.0, 1.0)


def mean_specular_albedo(roughness: ArrayLike, f0: float = 1 / 36, table: Float | None = None) -> Float:
    """Albedo of the layer in a constant environment for rho_s = 1, 2 int A(c, m) c dc over 0 ... 1; theory.md 6.4.

    Parameters
    ----------
    roughness : array_like
    f0 : float
    table : ndarray, optional
        As of `specular_albedo`.
    """
    x, weight = np.polynomial.legendre.leggauss(48)
    c = sqr((x + 1) / 2)  # dc = 2 sqrt(c) dx
    albedo = specular_albedo(c, np.asarray(roughness, np.float64)[..., None], f0, table)
    return (albedo * 2 * c * 2 * np.sqrt(c) * weight / 2).sum(-1)


class MeanPassing:
    """Share of a constant environment's light that passes the oil, by roughness, strength and reflectance.

    Parameters
    ----------
    table : ndarray of shape (C, M, 2)
        As `oil_table`.
    """

    def __init__(self, table: Float) -> None:
        nodes = np.arange(table.shape[1])
        self._last = table.shape[1] - 1
        self._albedo = [mean_specular_albedo(sqr(nodes / self._last), f0, table) for f0 in (0.0, 1.0)]

    def of(self, roughness: NDArray[np.float32], strength: NDArray[np.float32], f0: Float) -> Float:
        """The share, of the shape that the three have together.

        Parameters
        ----------
        roughness, strength, f0 : ndarrays
        """
        place, nodes = np.sqrt(np.clip(roughness, 0.0, 1.0)) * self._last, np.arange(self._last + 1)
        none, all_of_it = (np.interp(place, nodes, albedo) for albedo in self._albedo)
        return np.clip(1 - strength * ((1 - f0) * none + f0 * all_of_it), 0.0, 1.0)
