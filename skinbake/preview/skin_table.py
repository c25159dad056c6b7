"""What the shader reads where maps vary the skin: the table of weights, and the maps that it is read by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.profile.weight_table import WeightTable
from skinbake.scene.maps import SkinMaps


def table_images(table: WeightTable, maps: SkinMaps, tile: int) -> dict[str, NDArray[np.floating]]:
    """Images of the samplers that skin which varies is weighed by, (L, h, w, k).

    Parameters
    ----------
    table : WeightTable
    maps : SkinMaps
    tile : int
    """
    quantities = dict(zip(("table_row", "table_column"), table.names, strict=False))
    if table.scatters:
        quantities["scatter_map"] = "scatter"
    found: dict[str, NDArray[np.floating]] = {"weight_table": _packed(table)}
    for sampler in ("table_row", "table_column", "scatter_map"):
        name = quantities.get(sampler)
        image = getattr(maps, name).get(tile) if name else None
        constant = table.constants[name] if name else 1.0
        found[sampler] = (np.full((1, 1), constant, np.float32) if image is None else image)[None, ..., None]
    return found


def table_layers(gaussians: int) -> int:
    """Layers that the weights of so many Gaussians take."""
    return -(-3 * gaussians // 4)


def _packed(table: WeightTable) -> NDArray[np.float32]:
    """Red, green, blue of each Gaussian after the other, four numbers a texel: (L, rows, columns, 4).

    Drivers read texels of four numbers faster than of three, and there are fewer of them.
    """
    rows, columns, gaussians, _ = table.weight_rgb.shape
    layers = table_layers(gaussians)
    numbers = np.zeros((rows, columns, 4 * layers), np.float32)
    numbers[..., : 3 * gaussians] = table.weight_rgb.reshape(rows, columns, -1)
    return np.ascontiguousarray(np.moveaxis(numbers.reshape(rows, columns, layers, 4), 2, 0))


def table_bounds(table: WeightTable) -> NDArray[np.float64]:
    """Roots of the first nodes of rows and columns, and from these to those of the last, (2, 2); 1 for one node."""
    roots = np.sqrt([[nodes[0], nodes[-1]] for nodes in table.nodes])
    wide = roots[:, 1] - roots[:, 0]
    return np.stack([roots[:, 0], np.where(wide > 0, wide, 1.0)])
