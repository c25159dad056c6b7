"""Probe texels, at which lobes are compared with the exact surface integral, and what images hold there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiles
from skinbake.bilinear import read_bilinear
from skinbake.numerics import Float


@dataclass(frozen=True)
class Probes:
    """Texels on the skin.

    Attributes
    ----------
    tile : ndarray of shape (P,), int32
        Number of the tile.
    flat_index : ndarray of shape (P,), int64
        row * W + col at the full texture size.
    place : ndarray of shape (P, 2), float64
        (row, column) / size of the skin point that the texel shows; a texel's centre has (i + 0.5) / size.
    position, normal : ndarray of shape (P, 3), float32
        As in `TexelPoints`.
    texel_mm2 : ndarray of shape (P,), float32
    weight : ndarray of shape (P,), float64
        For means over the skin; 1 unless drawn with a preference.
    """

    tile: NDArray[np.int32]
    flat_index: NDArray[np.int64]
    place: Float
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    texel_mm2: NDArray[np.float32]
    weight: Float = field(default_factory=lambda: np.ones(1))

    def __len__(self) -> int:
        return len(self.tile)


def joined_probes(first: Probes, second: Probes) -> Probes:
    """Both sets; means over either are means over the skin, so means over both are too."""
    parts = {}
    for name in ("tile", "flat_index", "place", "position", "normal", "texel_mm2"):
        parts[name] = np.concatenate([getattr(first, name), getattr(second, name)])
    weights = [np.broadcast_to(p.weight, len(p)) for p in (first, second)]
    return Probes(**parts, weight=np.concatenate(weights))


def light_at_probes(source: Tiles, probes: Probes) -> Float:
    """What full-size images hold at the probes' own texels, (P, 3 L); `source` is (L, H, W, 3) a tile."""
    out = np.zeros((len(probes), 3 * _lights(source)))
    for tile, image in source.items():
        mine = probes.tile == tile
        values = image.reshape(len(image), -1, 3)[:, probes.flat_index[mine]]
        out[mine] = values.transpose(1, 0, 2).reshape(-1, out.shape[1])
    return out


def read_at_probes(lobe: Tiles, probes: Probes, half: bool = False) -> Float:
    """A stored lobe of any size read bilinearly at the probes, (P, 3 L).

    Parameters
    ----------
    lobe : Tiles
        (L, h, w, 3) a tile.
    probes : Probes
    half : bool
        Round each texel to binary16 first, as a file would hold it.
    """
    out = np.zeros((len(probes), 3 * _lights(lobe)))
    for tile, image in lobe.items():
        mine = probes.tile == tile
        out[mine] = read_bilinear(image, probes.place[mine], half)
    return out


def _lights(tiles: Tiles) -> int:
    return len(next(iter(tiles.values())))
