"""Media inside the skin as walks meet them: by depth below the surface, by what maps say, by wavelength."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.transport.depth import DepthGrid, depth_at, no_depth
from skinbake.transport.medium import SkinLayers
from skinbake.transport.skin_grid import SkinGrid, no_grid, value_at

DENSITY = "density"  # the quantity of a grid that is a factor on every coefficient
FAINT = 16.0  # optical depths, beyond which no light is looked for: exp(-16) = 1e-7
BANDS = 3  # channels of one walk
OF_LAYER = 0.5  # of the thinnest layer: steps in which its faces are looked for
GOLDEN_RATIO = 0.6180339887498949
EVERYWHERE, BELOW = 0, 1  # rows of `Coefficients.most`: in all layers, in the last one


class Coefficients(NamedTuple):
    """Coefficients of K layers in n channels, 1/mm.

    Attributes
    ----------
    sigma_t, sigma_s : ndarrays of shape (K, n)
        Extinction without pigment, and scattering, where the density is 1.
    pigment : ndarray of shape (K, n)
        Absorption per unit of the layer's map.
    most : ndarray of shape (2, n)
        Largest extinction that there is, anywhere and in the last layer.
    """

    sigma_t: Float
    sigma_s: Float
    pigment: Float
    most: Float


class Spectrum(NamedTuple):
    """Wavelengths that walks draw.

    Attributes
    ----------
    to_rgb : ndarray of shape (3, C)
    below : ndarray of shape (C + 1,)
        Probability of a wavelength before each.
    """

    to_rgb: Float
    below: Float


class WalkMedium(NamedTuple):
    """Media as the kernels take them.

    Attributes
    ----------
    of : Coefficients
        Of all C channels.
    g : ndarray of shape (K,)
        Henyey-Greenstein mean cosine of each layer.
    below_mm : ndarray of shape (K,)
        Depth at which each layer ends where the density is 1; the last is infinite.
    quantity : ndarray of shape (K,), int64
        Of the grid, by which a layer's pigment goes; -1 for none.
    density : int
        Quantity of the grid that multiplies coefficients; -1 for none.
    eta : float
        Index inside over index outside, >= 1.
    faint_mm : float
        Way beyond which no light is looked for.
    outer_mm, fine_mm : float
        Depth that the last layer begins above, and step in which layers' faces are looked for.
    uniform, ranges, spectral : bool
        One medium without a grid; extinction that differs from place to place; more channels than RGB.
    spectrum : Spectrum
    grid : SkinGrid
    depth : DepthGrid
    """

    of: Coefficients
    g: Float
    below_mm: Float
    quantity: NDArray[np.int64]
    density: int
    eta: float
    faint_mm: float
    outer_mm: float
    fine_mm: float
    uniform: bool
    ranges: bool
    spectral: bool
    spectrum: Spectrum
    grid: SkinGrid
    depth: DepthGrid


def walk_medium(
    skin: SkinLayers, grid: SkinGrid | None = None, quantities: tuple[str, ...] = (), depth: DepthGrid | None = None
) -> WalkMedium:
    """Media for the kernels.

    Parameters
    ----------
    skin : SkinLayers
    grid : SkinGrid, optional
        Of the skin's pigments, or of `DENSITY`.
    quantities : tuple of str
        Names of the grid's quantities.
    depth : DepthGrid, optional
        For several layers, exact to beyond `outer_mm` over the least density.

    Raises
    ------
    ValueError
        If there are several layers and no depths, or no quantity for a pigment.
    """
    if len(skin.layers) > 1 and depth is None:
        raise ValueError("depth: expected depths below the surface for several layers, got none")
    wanted = {each.name for each in skin.pigments if each}
    if not wanted <= set(quantities):
        raise ValueError(f"quantities: expected {', '.join(sorted(wanted))} among them, got {quantities}")
    grid = no_grid() if grid is None else grid
    # Of one kind, whatever they were made of: kernels are compiled once
    grid = SkinGrid(
        np.ascontiguousarray(grid.value, np.float32), *(np.ascontiguousarray(grid.low_mm, np.float64), grid.cell_mm),
        *(np.ascontiguousarray(each, np.float64) for each in (grid.least, grid.most)),
    )  # fmt: skip
    sigma_t = np.array([layer.sigma_t_per_mm for layer in skin.layers])
    sigma_s = np.array([layer.sigma_s_per_mm for layer in skin.layers])
    added = np.zeros_like(sigma_t)
    quantity = np.full(len(sigma_t), -1)
    for k, pigment in enumerate(skin.pigments):
        if pigment is not None:
            added[k], quantity[k] = pigment.sigma_a_per_mm, quantities.index(pigment.name)

    density = quantities.index(DENSITY) if DENSITY in quantities else -1
    thin, dense = (float(grid.least[density]), float(grid.most[density])) if density >= 0 else (1.0, 1.0)
    low, high = (np.array([each[q] if q >= 0 else 0.0 for q in quantity])[:, None] for each in (grid.least, grid.most))
    each_most = dense * (sigma_t + np.maximum(low * added, high * added))
    each_least = thin * (sigma_t + np.minimum(low * added, high * added))
    most = np.stack([each_most.max(axis=0), each_most[-1]])

    below = np.cumsum(skin.thickness_mm)
    to_rgb = np.eye(3) if skin.to_rgb is None else np.ascontiguousarray(skin.to_rgb, np.float64)
    chance = np.linalg.norm(to_rgb, axis=0)
    cumulated = np.concatenate([[0.0], np.cumsum(chance / chance.sum())])
    cumulated[-1] = 1.0
    return WalkMedium(
        Coefficients(sigma_t, sigma_s, added, most),
        np.array([layer.g for layer in skin.layers]),
        below,
        quantity,
        density,
        float(skin.layers[0].eta),
        FAINT / float(each_least.min()),
        skin.outer_mm / thin,
        OF_LAYER * min(skin.thickness_mm[:-1], default=1.0) / dense,
        len(skin.layers) == 1 and not quantities,
        len(skin.layers) > 1 or not np.array_equal(grid.least, grid.most),
        skin.to_rgb is not None,
        Spectrum(to_rgb, cumulated),
        grid,
        no_depth() if depth is None or len(skin.layers) == 1 else depth,
    )  # fmt: skip


@kernel(inner=True)
def empty_bands(medium):  # type: ignore[no-untyped-def]
    """Room for the coefficients of one walk's three channels, and the matrix that makes RGB of them."""
    layers = len(medium.g)
    of = Coefficients(
        np.empty((layers, BANDS)), np.empty((layers, BANDS)), np.empty((layers, BANDS)), np.empty((2, BANDS))
    )
    return of, np.zeros((3, BANDS))


@kernel(inner=True)
def choose_bands(medium, place, bands, mix):  # type: ignore[no-untyped-def]
    """Write the channels of a walk: R, G and B, or three wavelengths a third of the spectrum's probability apart.

    Weighed by their probability, three values add up, in the mean, to the matrix' product with the whole spectrum
    [Wilkie2014].

    Parameters
    ----------
    medium : WalkMedium
    place : float
        In the spectrum, from 0 to 1; unused for R, G and B.
    bands : Coefficients of shape (K, 3), written
    mix : ndarray of shape (3, 3), written
        Share of each band in R, G and B.
    """
    spectrum = medium.spectrum
    for b in range(BANDS):
        c = b
        mix[b, b] = 1.0
        if medium.spectral:
            u = (place + b / BANDS) % 1.0
            c = min(np.searchsorted(spectrum.below, u, side="right") - 1, len(spectrum.below) - 2)
            chance = spectrum.below[c + 1] - spectrum.below[c]
            for rgb in range(3):
                mix[rgb, b] = spectrum.to_rgb[rgb, c] / (BANDS * chance)
        for k in range(len(medium.g)):
            bands.sigma_t[k, b] = medium.of.sigma_t[k, c]
            bands.sigma_s[k, b] = medium.of.sigma_s[k, c]
            bands.pigment[k, b] = medium.of.pigment[k, c]
        for zone in range(2):
            bands.most[zone, b] = medium.of.most[zone, c]


@kernel(inner=True)
def layer_at(medium, depth):  # type: ignore[no-untyped-def]
    """Number of the layer at a depth, mm times the density there."""
    layer = 0
    while depth >= medium.below_mm[layer]:
        layer += 1
    return layer


@kernel(inner=True)
def pigment_at(medium, layer, x, y, z):  # type: ignore[no-untyped-def]
    """What the layer's map says at a place; 0 where it has none.

    Parameters
    ----------
    medium : WalkMedium
    layer : int
    x, y, z : float
        mm about the rays' centre.
    """
    quantity = medium.quantity[layer]
    return value_at(medium.grid, quantity, x, y, z) if quantity >= 0 else 0.0


@kernel(inner=True)
def add_optical_depth(scene, line, way, tau):  # type: ignore[no-untyped-def]
    """Add the optical depth along a line inside the skin, for each band.

    Where something varies, by middles of steps: half a cube of the grid, and near layers' faces a fraction of the
    thinnest one, within which the depth is taken as linear; exact below flat skin, as far as layers go.

    Parameters
    ----------
    scene : WalkScene
    line : tuple of two tuples of three floats
        Where it begins, mm about the rays' centre, and unit direction.
    way : float
        mm.
    tau : ndarray of shape (3,), written
    """
    rays, medium, bands = scene.rays, scene.medium, scene.bands
    if medium.uniform:
        for c in range(BANDS):
            tau[c] += bands.sigma_t[0, c] * way
        return
    (x, y, z), (dx, dy, dz) = line
    layers, graded, dense = len(medium.g), medium.grid.value.size > 0, medium.density >= 0
    begin, end, t = 0.0, 0.0, 0.0
    if layers > 1:
        begin, _ = depth_at(medium.depth, rays, x, y, z)
    while t < way:
        # A step within which nothing changes but linearly
        step = way - t
        if graded:
            step = min(step, 0.5 * medium.grid.cell_mm)
        if layers > 1:
            room = begin - medium.outer_mm
            if room < 0.0 and not dense:
                room = medium.outer_mm - begin
                for k in range(layers - 2):
                    room = min(room, abs(begin - medium.below_mm[k]))
            step = min(step, max(medium.fine_mm, room))
        middle = t + 0.5 * step
        mx, my, mz = x + middle * dx, y + middle * dy, z + middle * dz
        factor = value_at(medium.grid, medium.density, mx, my, mz) if dense else 1.0
        if layers > 1:
            end, _ = depth_at(medium.depth, rays, x + (t + step) * dx, y + (t + step) * dy, z + (t + step) * dz)
        # The part of it in each layer
        upper, low, high = 0.0, min(begin, end) * factor, max(begin, end) * factor
        for k in range(layers):
            lower = medium.below_mm[k]
            share = 1.0
            if layers > 1:
                if high > low:
                    share = max(0.0, min(high, lower) - max(low, upper)) / (high - low)
                elif low < upper or low >= lower:
                    share = 0.0
            if share > 0.0:
                value = pigment_at(medium, k, mx, my, mz)
                for c in range(BANDS):
                    tau[c] += share * step * factor * (bands.sigma_t[k, c] + bands.pigment[k, c] * value)
            upper = lower
        begin = end
        t += step
        if min(tau[0], tau[1], tau[2]) > FAINT:
            return
