"""Light as the diffusion takes it: of the right shape, finite, and of a brightness whose sums float32 can hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles
from skinbake.errors import InputError

_FAINTEST, _BRIGHTEST = 1e-12, 1e12  # peaks between which sums of light stay within float32


def checked_source(source: Tiles, lights: tuple[str, ...], atlas: Atlas) -> Tiles:
    """The light of each tile as a contiguous float32 array (L, H, W, 3), in the order of the atlas.

    Parameters
    ----------
    source : dict of int to ndarray
        By tile.
    lights : tuple of L str
        Their names.
    atlas : Atlas

    Raises
    ------
    InputError
        If a tile is missing or of another shape; if a texel is not finite, with its tile, light, row and column.
    """
    tiles = {}
    for raster in atlas:
        values = source.get(raster.tile)
        want = (len(lights), *raster.shape, 3)
        if values is None or values.shape != want:
            got = "nothing" if values is None else str(values.shape)
            raise InputError(f"irradiance of tile {raster.tile}: expected shape {want}, got {got}")
        with np.errstate(over="ignore"):  # then each is looked at
            finite = np.isfinite(values.sum())
        if not finite:
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                light, row, col, _ = bad[0]
                raise InputError(
                    f"irradiance of tile {raster.tile}: light {lights[light]} is not finite at row {row}, column {col} "
                    f"({len(bad)} values): expected finite light"
                )
        tiles[raster.tile] = np.ascontiguousarray(values, dtype=np.float32)
    return tiles


def scaled_source(tiles: Tiles) -> tuple[Tiles, list[int]]:
    """Each light divided by a power of two, if sums of it could leave float32; and the exponents of the divisors, L."""
    exponents = []
    for k in range(len(next(iter(tiles.values())))):
        peak = max(max(float(t[k].max(initial=0)), -float(t[k].min(initial=0))) for t in tiles.values())
        exponents.append(int(np.frexp(peak)[1]) if peak > 0 and not _FAINTEST < peak < _BRIGHTEST else 0)
    return scaled_by(tiles, exponents), exponents


def scaled_by(tiles: Tiles, exponents: list[int]) -> Tiles:
    """Each light divided by two to the power of its exponent; the same arrays where all of these are 0."""
    if not any(exponents):
        return tiles
    factor = np.exp2(-np.asarray(exponents, np.float64))[:, None, None, None]
    return {tile: (rgb * factor).astype(np.float32) for tile, rgb in tiles.items()}


def unscaled(rgb: NDArray[np.float32], exponents: list[int]) -> NDArray[np.float32]:
    """An image (L, h, w, 3) of scaled light in its first brightness; the same array where nothing was scaled."""
    if not any(exponents):
        return rgb
    return (rgb * np.exp2(np.asarray(exponents, np.float64))[:, None, None, None]).astype(np.float32)
