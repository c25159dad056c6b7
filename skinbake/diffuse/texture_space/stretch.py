"""Method `stretch`: texture space with each texel's own metric, so that a millimetre is a millimetre along the chart.

A round Gaussian on the skin is, to first order, the ellipse v (J^T J)^-1 in UV, shear included; theory.md 5.5. The
metric is averaged at UV vertices and interpolated, so that triangle edges do not show. Weights are areas, theory.md
5.4, so light is summed per mm^2 of skin. Charts do not see one another, distance is along the chart: seams and bends
remain wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, first_fundamental_form, interpolate, signed_uv_area
from skinbake.atlas.connected import connected
from skinbake.diffuse.lattice import lattice_table, lattice_variance
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import LANES, broadcast, gaussian, load, mul_add, same, store
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh

CUT_SIGMA = 3.5
MAX_REACH = 48  # texels: a chart region denser than that for its lobe is cut, and says so by its measured error
_EMPTY = -1
_ZERO = np.float32(0)


def uv_vertices(mesh: SkinMesh) -> NDArray[np.int64]:
    """Number of each corner's UV vertex, (F, 3): corners share one if they share vertex and UV."""
    key = np.column_stack([mesh.faces.reshape(-1).astype(np.float64), mesh.corner_uv.reshape(-1, 2)])
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1, 3)


def chart_of_face(corner: NDArray[np.int64]) -> NDArray[np.int32]:
    """Connected component in UV of each face, from `uv_vertices`."""
    first, other = np.repeat(corner[:, 0], 2), corner[:, 1:].reshape(-1)
    count = int(corner.max()) + 1 if corner.size else 0
    return connected(first, other, count)[corner[:, 0]]


def smooth_inverse_metric(mesh: SkinMesh, corner: NDArray[np.int64]) -> Float:
    """(J^T J)^-1 at each corner, uv^2 / mm^2, as uu, uv, vv: (F, 3, 3).

    Around a UV vertex the logarithms of the metric are averaged by UV area: halved and doubled texels cancel, and a
    face squeezed to nothing in UV has nothing to say.
    """
    e, f, h = first_fundamental_form(mesh).T
    weight = np.abs(signed_uv_area(mesh))
    known = (e * h - f * f > 0) & (weight > 0)
    logs = np.zeros((len(e), 3))
    logs[known] = _log_symmetric(np.stack([e, f, h], axis=1)[known])
    weight = np.where(known, weight, 0.0)
    count = int(corner.max()) + 1
    total = np.bincount(corner.reshape(-1), np.repeat(weight, 3), count)
    mean = np.stack(
        [np.bincount(corner.reshape(-1), np.repeat(weight * logs[:, k], 3), count) for k in range(3)], axis=1
    )
    inverse = _exp_symmetric(-safe_div(mean, total[:, None]))
    inverse[total == 0] = 0
    return inverse[corner]


def _log_symmetric(matrix: Float) -> Float:
    return _of_eigenvalues(matrix, np.log)


def _exp_symmetric(matrix: Float) -> Float:
    return _of_eigenvalues(matrix, np.exp)


def _of_eigenvalues(matrix: Float, function: Callable[[Float], Float]) -> Float:
    """A function of symmetric 2 x 2 matrices given as (N, 3): xx, xy, yy."""
    xx, xy, yy = matrix.T
    values, vectors = np.linalg.eigh(np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2))
    values = function(np.maximum(values, np.finfo(float).tiny) if function is np.log else values)
    full = np.einsum("nik,nk,njk->nij", vectors, values, vectors)
    return np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 1, 1]], axis=1)


def texel_covariance(raster: AtlasRaster, inverse_metric: Float) -> NDArray[np.float32]:
    """Covariance of a lobe of 1 mm^2 at each texel, texels^2, as xx, xy, yy (x along columns): (H, W, 3)."""
    height, width = raster.shape
    return interpolate(raster, inverse_metric * np.array([width**2, -width * height, height**2]))


def stretch_blur(
    light: NDArray[np.float32],
    area_mm2: NDArray[np.float32],
    chart: NDArray[np.int32],
    covariance: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Area-weighted, normalised gather with an ellipse of its own at each texel.

    Parameters
    ----------
    light : ndarray of shape (L, H, W, 3), float32
    area_mm2 : ndarray of shape (H, W), float32
        Weight; 0 in the gutter.
    chart : ndarray of shape (H, W), int32
        -1 where empty; light stays inside a chart.
    covariance : ndarray of shape (H, W, 3), float32
        xx, xy, yy of the lobe at each texel, texels^2.

    Returns
    -------
    ndarray of shape (L, H, W, 3), float32
        `light` where nothing is within reach.
    """
    lights, height, width, _ = light.shape
    form, reach = np.empty_like(covariance), np.empty((height, width, 2), np.float32)
    parallel_for(_quadratic_form, height, covariance, lattice_table(), form, reach)
    pad = int(np.ceil(reach.max(initial=0))) + 1
    padded_width = width + 2 * pad + LANES
    planes = np.zeros((3 * lights + 1, height + 2 * pad, padded_width), np.float32)
    inside = slice(pad, pad + height), slice(pad, pad + width)
    planes[(slice(0, 3 * lights), *inside)] = light.transpose(0, 3, 1, 2).reshape(3 * lights, height, width)
    planes[(3 * lights, *inside)] = area_mm2 / max(float(area_mm2.max(initial=0)), 1e-30)
    planes[:-1, planes[-1] == 0] = 0  # infinity times no weight is not nothing
    chart_padded = np.full(planes.shape[1:], _EMPTY, np.float32)  # numbers of charts are far below 2^24
    chart_padded[inside] = chart
    out = light.copy()
    parallel_for(_gather, height, _Padded(planes, chart_padded, pad), _Ellipses(form, reach, chart), out)
    return out


@kernel
def _quadratic_form(first, stop, covariance, table, form, reach):  # type: ignore[no-untyped-def]
    """Inverse / -64 of each ellipse (xx, 2 xy, yy), and how far it reaches (x, y), texels."""
    width = covariance.shape[1]
    floor = 1e-4
    for row in range(first, stop):
        for col in range(width):
            xx, yy = max(np.float64(covariance[row, col, 0]), floor), max(np.float64(covariance[row, col, 2]), floor)
            limit = 0.999 * np.sqrt(xx * yy)
            xy = min(max(np.float64(covariance[row, col, 1]), -limit), limit)
            # As the reference does: by the shorter length of a texel, which is the longer axis of the ellipse
            spread = 0.5 * (xx + yy + np.hypot(xx - yy, 2 * xy))
            wider = lattice_variance(1.0, 1 / max(spread, floor), table)  # t'/t: its unit is t here
            xx, xy, yy = xx * wider, xy * wider, yy * wider
            each = -64 * (xx * yy - xy * xy)
            form[row, col, 0], form[row, col, 1], form[row, col, 2] = yy / each, -2 * xy / each, xx / each
            reach[row, col, 0] = min(CUT_SIGMA * np.sqrt(xx), MAX_REACH)
            reach[row, col, 1] = min(CUT_SIGMA * np.sqrt(yy), MAX_REACH)


class _Padded(NamedTuple):
    """What is gathered, with room around it.

    Attributes
    ----------
    planes : ndarray of shape (3 L + 1, H + 2 pad, W + 2 pad + 16), float32
        Light by channel, then area.
    chart : ndarray of shape (H + 2 pad, W + 2 pad + 16), float32
        Chart of each texel.
    pad : int
    """

    planes: NDArray[np.float32]
    chart: NDArray[np.float32]
    pad: int


class _Ellipses(NamedTuple):
    """Where each texel looks.

    Attributes
    ----------
    form, reach : ndarrays of shape (H, W, 3), (H, W, 2), float32
        As `_quadratic_form` gives them.
    chart : ndarray of shape (H, W), int32
        -1 where empty.
    """

    form: NDArray[np.float32]
    reach: NDArray[np.float32]
    chart: NDArray[np.int32]


@kernel
def _gather(first, stop, padded, ellipses, out):  # type: ignore[no-untyped-def]
    """`stretch_blur` of rows, sixteen texels abreast.

    Parameters
    ----------
    first, stop : int
        Rows.
    padded : _Padded
    ellipses : _Ellipses
    out : ndarray of shape (L, H, W, 3), float32
        Written where something is within reach.
    """
    planes, chart_padded, pad = padded.planes, padded.chart, padded.pad
    form, reach, chart = ellipses.form, ellipses.reach, ellipses.chart
    lights, _, width, _ = out.shape
    channels = 3 * lights
    stride = planes.shape[2]
    plane = planes.shape[1] * stride
    texels, charts = planes.reshape(-1), chart_padded.reshape(-1)
    for row in range(first, stop):
        at = np.empty((4, LANES), np.float32)  # the ellipse's form and the chart
        sums = np.empty((channels + 1, LANES), np.float32)
        ellipse, acc = at.reshape(-1), sums.reshape(-1)
        for left in range(0, width, LANES):
            reach_x, reach_y, some = _ZERO, _ZERO, False
            for t in range(LANES):
                col = left + t
                at[0, t], at[1, t], at[2, t], at[3, t] = -1.0, 0.0, -1.0, _EMPTY - 1
                if col < width and chart[row, col] >= 0:
                    some = True
                    at[3, t] = chart[row, col]
                    at[0, t], at[1, t], at[2, t] = form[row, col, 0], form[row, col, 1], form[row, col, 2]
                    reach_x, reach_y = max(reach_x, reach[row, col, 0]), max(reach_y, reach[row, col, 1])
            if not some:
                continue
            xx, xy, yy = load(ellipse, 0), load(ellipse, LANES), load(ellipse, 2 * LANES)
            mine = load(ellipse, 3 * LANES)
            total, red, green, blue = broadcast(_ZERO), broadcast(_ZERO), broadcast(_ZERO), broadcast(_ZERO)
            sums[:] = _ZERO
            for dy in range(-int(reach_y), int(reach_y) + 1):
                for dx in range(-int(reach_x), int(reach_x) + 1):
                    fx, fy = np.float32(dx), np.float32(dy)
                    here = (row + dy + pad) * stride + left + dx + pad
                    w = gaussian(mul_add(xx, fx * fx, mul_add(xy, fx * fy, yy * (fy * fy))))
                    w = w * load(texels, channels * plane + here) * same(load(charts, here), mine)
                    total += w
                    red = mul_add(w, load(texels, here), red)
                    green = mul_add(w, load(texels, plane + here), green)
                    blue = mul_add(w, load(texels, 2 * plane + here), blue)
                    for k in range(3, channels):
                        store(acc, k * LANES, mul_add(w, load(texels, k * plane + here), load(acc, k * LANES)))
            store(acc, 0, red)
            store(acc, LANES, green)
            store(acc, 2 * LANES, blue)
            store(acc, channels * LANES, total)
            for t in range(min(LANES, width - left)):
                if chart[row, left + t] >= 0 and sums[channels, t] > 0:
                    for k in range(channels):
                        out[k // 3, row, left + t, k % 3] = sums[k, t] / sums[channels, t]


def area_mean(light: NDArray[np.float32], area: NDArray[np.float32], factor: int, out: NDArray[np.float32]) -> None:
    """Area-weighted mean of each block of `factor` x `factor` texels; the plain mean of nothing is 0.

    Parameters
    ----------
    light : ndarray of shape (L, H, W, 3), float32
    area : ndarray of shape (H, W), float32
    factor : int
    out : ndarray of shape (L, H / factor, W / factor, 3), float32
    """
    parallel_for(_area_mean, out.shape[1], light, area, factor, out)


@kernel
def _area_mean(first, stop, light, area, factor, out):  # type: ignore[no-untyped-def]
    """`area_mean` of rows `first` to `stop` of `out`."""
    lights, _, _, _ = light.shape
    for i in range(first, stop):
        for j in range(out.shape[2]):
            total = 0.0
            for k in range(lights):
                sums = np.zeros(3)
                total = 0.0
                for r in range(i * factor, (i + 1) * factor):
                    for q in range(j * factor, (j + 1) * factor):
                        a = area[r, q]
                        if a > 0:
                            total += a
                            for c in range(3):
                                sums[c] += a * light[k, r, q, c]
                for c in range(3):
                    out[k, i, j, c] = sums[c] / total if total > 0 else 0.0
