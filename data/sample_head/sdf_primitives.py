"""Signed-distance clay: the few shapes and blends that every anatomical part is made of.

Points are given as three arrays x, y, z in millimetres; every function returns an array of the same length.
Negative is inside. Distances are exact for tubes and close enough elsewhere for blends of a few millimetres.
"""

import itertools
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d


def smooth_min(a, b, k):
    """Union of two fields with a fillet about k mm wide."""
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - 0.25 * k * h * h


def smooth_max(a, b, k):
    """Intersection of two fields with an edge rounded over k mm."""
    return -smooth_min(-a, -b, k)


def smoothstep(low, high, t):
    """0 below `low`, 1 above `high` (either order), smooth between."""
    s = np.clip((t - low) / (high - low), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def along(knots, values):
    """Monotone spline through (knots, values): a measure as a function of height."""
    return PchipInterpolator(knots, values, extrapolate=True)


@cache
def _column(table, column, soften_mm):
    rows = np.asarray(sorted(table), float)
    low, high = rows[0, 0], rows[-1, 0]
    curve = PchipInterpolator(rows[:, 0], rows[:, column])
    if soften_mm:
        knots = np.linspace(low, high, int(high - low) + 1)
        curve = CubicSpline(
            knots, gaussian_filter1d(curve(knots), soften_mm * (len(knots) - 1) / (high - low), mode="nearest")
        )
    return low, high, curve


def table_column(table, column, soften_mm=0.0):
    """Curve through one column of a table whose first column is the height, its bends softened over `soften_mm`."""
    low, high, curve = _column(tuple(table), column, soften_mm)
    return lambda y: curve(np.clip(y, low, high))


def ellipsoid(x, y, z, centre, radii):
    """Distance to an ellipsoid, first order: exact on the surface, right to a few per cent near it."""
    px, py, pz = x - centre[0], y - centre[1], z - centre[2]
    a, b, c = radii
    k0 = np.sqrt((px / a) ** 2 + (py / b) ** 2 + (pz / c) ** 2)
    k1 = np.sqrt((px / a**2) ** 2 + (py / b**2) ** 2 + (pz / c**2) ** 2)
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def spline_points(points, steps=6, closed=False):
    """Rows of `points` (any number of columns) joined by a smooth curve, `steps` samples a span."""
    points = np.asarray(points, float)
    if closed:
        points = np.vstack([points, points[:1]])
    chord = np.linalg.norm(np.diff(points[:, : min(3, points.shape[1])], axis=0), axis=1)
    t = np.concatenate([[0.0], np.cumsum(np.sqrt(chord))])
    curve = CubicSpline(t, points, bc_type="periodic" if closed else "natural")
    fine = np.concatenate([np.linspace(a, b, steps, endpoint=False) for a, b in itertools.pairwise(t)])
    fine = fine if closed else np.append(fine, t[-1])
    return curve(fine)


def near_curve(x, y, z, path, reach):
    """Points within `reach` of a curve: their indices, distance to it, and interpolated extra columns.

    `path` is an (M, 3 + K) array of samples joined by straight segments.
    """
    low, high = path[:, :3].min(0) - reach, path[:, :3].max(0) + reach
    index = np.flatnonzero((x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]) & (z > low[2]) & (z < high[2]))
    p = np.stack([x[index], y[index], z[index]], axis=1)
    best = np.full(len(index), np.inf)
    extra = np.zeros((len(index), path.shape[1] - 3))
    for a, b in itertools.pairwise(path):
        ab = b[:3] - a[:3]
        t = np.clip((p - a[:3]) @ ab / max(ab @ ab, 1e-12), 0.0, 1.0)
        d = np.linalg.norm(p - a[:3] - t[:, None] * ab, axis=1)
        closer = d < best
        best[closer] = d[closer]
        extra[closer] = a[3:] + t[closer, None] * (b[3:] - a[3:])
    return index, best, extra


def add_tube(f, x, y, z, points, k, steps=6):
    """Blend a tube into the field in place; rows of `points` are x, y, z, radius."""
    path = spline_points(points, steps)
    index, distance, extra = near_curve(x, y, z, path, path[:, 3].max() + k + 2.0)
    f[index] = smooth_min(f[index], distance - extra[:, 0], k)


def add_ellipsoid(f, x, y, z, centre, radii, k):
    """Blend an ellipsoid into the field in place."""
    index = box(x, y, z, centre, np.asarray(radii) + k + 1.0)
    f[index] = smooth_min(f[index], ellipsoid(x[index], y[index], z[index], centre, radii), k)


def carve_ellipsoid(f, x, y, z, centre, radii, k):
    """Cut an ellipsoid out of the field in place."""
    index = box(x, y, z, centre, np.asarray(radii) + k + 1.0)
    f[index] = smooth_max(f[index], -ellipsoid(x[index], y[index], z[index], centre, radii), k)


def box(x, y, z, centre, half):
    """Indices of the points in a box."""
    return np.flatnonzero(
        (np.abs(x - centre[0]) < half[0]) & (np.abs(y - centre[1]) < half[1]) & (np.abs(z - centre[2]) < half[2])
    )


def press_ball(f, x, y, z, centre, sigma, amount):
    """Raise (amount > 0) or press in the surface by a Gaussian thumb of width `sigma` (3 numbers), in place."""
    index = box(x, y, z, centre, 3.6 * np.asarray(sigma))
    d2 = sum(((c[index] - m) / s) ** 2 for c, m, s in zip((x, y, z), centre, sigma, strict=True))
    f[index] -= amount * np.exp(-0.5 * d2)


def press_curve(f, x, y, z, points, steps=6):
    """Raise or press in the surface along a curve, in place; rows of `points` are x, y, z, sigma, amount."""
    path = spline_points(points, steps)
    index, distance, extra = near_curve(x, y, z, path, 3.6 * path[:, 3].max())
    f[index] -= extra[:, 1] * np.exp(-0.5 * (distance / np.maximum(extra[:, 0], 1e-3)) ** 2)
