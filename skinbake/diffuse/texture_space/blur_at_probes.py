"""The texture's blur at probes only: as it is there, or in the texels that a reader of the stored map touches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled
from skinbake.bilinear import bilinear_texels
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.texture_space.blur import TexturePyramid, blur_at, level_size, stored_variance
from skinbake.numerics import Float


class TexelBlur(NamedTuple):
    """The blur of the four texels around each of one tile's probes.

    Attributes
    ----------
    probe : ndarray of shape (n,)
        Which probes these are.
    flat : ndarray of shape (n, 4)
        row * w + col of the texels.
    weight : ndarray of shape (n, 4)
        Bilinear.
    rgb : ndarray of shape (4 n, 3 L)
    mass : ndarray of shape (4 n,)
        Share of the kernel that lies on charts.
    """

    probe: NDArray[np.int64]
    flat: NDArray[np.int64]
    weight: Float
    rgb: Float
    mass: Float

    def read(self, texels: NDArray[np.floating]) -> Float:
        """Values of these texels, (4 n, C), read bilinearly at the probes, (n, C)."""
        read: Float = np.einsum("pkc,pk->pc", texels.reshape(*self.flat.shape, -1), self.weight)
        return read


def blur_at_probes(
    pyramids: Tiled[TexturePyramid], variance_texels2: tuple[float, float], level: int, probes: Probes
) -> Float:
    """The blur at the probes' texel centres of the full size, before anything is stored, (P, 3 L).

    A level's kernel is band-limited (its variance is at least 0.6 texels): a Fourier shift lays it between the texels.

    Parameters
    ----------
    pyramids : Tiled of TexturePyramid
    variance_texels2 : (float, float)
        Of the lobe along (row, column), texels of the full size squared.
    level : int
        At which it is blurred.
    probes : Probes
    """
    out = np.zeros((len(probes), next(iter(pyramids.values())).levels[0].shape[2] - 1))
    for tile, pyramid in pyramids.items():
        mine = np.flatnonzero(probes.tile == tile)
        full = pyramid.levels[0].shape[:2]
        size = level_size(full, level)
        texel = np.divmod(probes.flat_index[mine], full[1])
        out[mine], _ = blur_at(
            pyramid, variance_texels2, level, [(texel[a] + 0.5) * size[a] / full[a] - 0.5 for a in (0, 1)]
        )
    return out


def blur_around_probes(
    pyramids: Tiled[TexturePyramid], variance_texels2: tuple[float, float], level: int, probes: Probes
) -> Tiled[TexelBlur]:
    """The blur of the texels of a stored size that reading at the probes touches; parameters as `blur_at_probes`.

    Parameters
    ----------
    pyramids, variance_texels2, level, probes
        See `blur_at_probes`.
    """
    found = {}
    for tile, pyramid in pyramids.items():
        mine = np.flatnonzero(probes.tile == tile)
        flat, weight = bilinear_texels(probes.place[mine], *level_size(pyramid.levels[0].shape[:2], level))
        found[tile] = TexelBlur(mine, flat, weight, *blur_of_texels(pyramid, variance_texels2, level, flat.reshape(-1)))
    return found


def read_blur(blurred: Tiled[TexelBlur], probes: Probes) -> Float:
    """What reading the stored blur gives at the probes, (P, 3 L), from the texels around them."""
    out = np.zeros((len(probes), next(iter(blurred.values())).rgb.shape[1]))
    for texels in blurred.values():
        out[texels.probe] = texels.read(texels.rgb)
    return out


def blur_of_texels(
    pyramid: TexturePyramid, variance_texels2: tuple[float, float], level: int, flat: NDArray[np.int64]
) -> tuple[Float, Float]:
    """The blur of a few texels of a stored size, (n, 3 L), and the share of the kernel on charts there, (n,).

    Parameters
    ----------
    pyramid : TexturePyramid
    variance_texels2 : (float, float)
        Of the lobe along (row, column), texels of the full size squared.
    level : int
    flat : ndarray of shape (n,)
        row * w + col at that level.
    """
    row, col = np.divmod(flat, level_size(pyramid.levels[0].shape[:2], level)[1])
    variance_texels2 = stored_variance(variance_texels2, level)
    return blur_at(pyramid, variance_texels2, level, (row.astype(np.float64), col.astype(np.float64)))


def shown_texels(flat_index: NDArray[np.int64], size: tuple[int, int], level: int) -> NDArray[np.int64]:
    """Texels of a stored size that show the middles of texels of the full size.

    Parameters
    ----------
    flat_index : ndarray of shape (n,)
        row * W + col at the full size.
    size : (H, W)
    level : int
        Of the stored size.

    Returns
    -------
    ndarray of shape (n,)
        row * w + col.
    """
    height, width = level_size(size, level)
    row, col = np.divmod(flat_index, size[1])
    row, col = (2 * row + 1) * height // (2 * size[0]), (2 * col + 1) * width // (2 * size[1])
    flat: NDArray[np.int64] = row * width + col
    return flat
