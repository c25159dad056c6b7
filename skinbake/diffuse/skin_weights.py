"""Weights of the lobes over the skin: the same everywhere, or those of a table at what the maps hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiles
from skinbake.bilinear import bilinear_texels, magnify_bilinear
from skinbake.diffuse.probes import Probes
from skinbake.kernels.threads import for_slices
from skinbake.numerics import Float, Zeros
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.maps import SkinMaps
from skinbake.scene.skin import SkinSpec

_AT_ONCE = 1 << 16  # texels whose weights are read from a table at a time


@dataclass(frozen=True)
class SkinWeights:
    """What each Gaussian counts at each place, theory.md 4.8.

    Attributes
    ----------
    weight_rgb : ndarray of shape (N, 3)
        Where no table says otherwise.
    table : WeightTable, optional
        Of the Gaussians, which come first; what follows them is light through thin parts.
    maps : SkinMaps
        What the table's quantities are; read bilinearly, as a GPU does.
    """

    weight_rgb: Float
    table: WeightTable | None = None
    maps: SkinMaps = field(default_factory=SkinMaps)

    @classmethod
    def of(cls, gaussians: GaussianSum, maps: SkinMaps) -> SkinWeights:
        """Weights of a fitted sum on a skin with given maps."""
        return cls(gaussians.weight_rgb, gaussians.table, maps)

    def at(self, tile: NDArray[np.integer], place: Float) -> Float:
        """Weights at places.

        Parameters
        ----------
        tile : ndarray of shape (P,)
            UDIM number of each.
        place : ndarray of shape (P, 2)
            (row, column) / size.

        Returns
        -------
        ndarray of shape (N, P, 3), or (N, 3) where they are the same everywhere
        """
        if self.table is None:
            return self.weight_rgb
        values, shape = self._values_at(tile, place), (len(place), 3)
        weight = [np.broadcast_to(each, shape) for each in self.table.at(values)]
        scatter = self.table.scatter_at(values)[:, None]
        through = [np.broadcast_to(scatter * each, shape) for each in self.weight_rgb[len(weight) :]]
        return np.stack([*weight, *through])

    def at_probes(self, probes: Probes) -> Float:
        """Weights at probes, as `at`."""
        return self.at(probes.tile, probes.place)

    def scatter_at(self, tile: NDArray[np.integer], place: Float) -> Float:
        """Share of the light that scatters at places, (P,) or (1,)."""
        return np.ones(1) if self.table is None else self.table.scatter_at(self._values_at(tile, place))

    def counts_at_probes(self, probes: Probes) -> Float:
        """How much a lobe that scatters counts at probes, (P, 1) or (1, 1): nothing where the skin does not scatter."""
        return self.scatter_at(probes.tile, probes.place)[:, None]

    def image(self, lobe: int, tile: int, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Weights of one lobe at every texel, (H, W, 3), or (1, 1, 3) where they are the same everywhere.

        Parameters
        ----------
        lobe : int
        tile : int
        shape : (H, W)
        """
        if self.table is None:
            return self.weight_rgb[lobe].astype(np.float32)[None, None]
        if lobe >= self.table.weight_rgb.shape[2]:
            return self.scatter_image(tile, shape)[..., None] * self.weight_rgb[lobe].astype(np.float32)
        return self._colours(partial(self.table.of_lobe, lobe), self.table.quantities, tile, shape)

    def total_image(self, tile: int, shape: tuple[int, int], zeros: Zeros = np.zeros) -> NDArray[np.float32]:
        """What the skin gives back of light at every texel, as `image`.

        Parameters
        ----------
        tile : int
        shape : (H, W)
        zeros : callable, optional
            Makes the image.
        """
        if self.table is None:
            return self.weight_rgb.sum(axis=0).astype(np.float32)[None, None]
        return self._colours(self.table.total, self.table.names, tile, shape, zeros)

    def scatter_image(self, tile: int, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Share of the light that scatters at every texel, (H, W), or (1, 1) where it is the same everywhere."""
        if self.table is None or not self.table.scatters:
            return np.ones((1, 1), np.float32)
        image = self.maps.scatter.get(tile)
        if image is None:
            return self.table.scatter_at({}).astype(np.float32).reshape(1, 1)
        return magnify_bilinear(np.asarray(image, np.float32)[..., None], shape)[..., 0]

    def scattering_share(self, atlas: Atlas) -> Tiles | None:
        """Share of the light that scatters at the texels of an atlas, (H, W) a tile; None where all of it does, or the
        same share everywhere.
        """
        if self.table is None or not self.table.scatters:
            return None
        return {r.tile: np.broadcast_to(self.scatter_image(r.tile, r.shape), r.shape) for r in atlas}

    def _values_at(self, tile: NDArray[np.integer], place: Float) -> dict[str, Float]:
        """The table's quantities at places, (P,) each."""
        assert self.table is not None
        found = {}
        for name in self.table.quantities:
            values = np.full(len(place), self.table.constants[name])
            for number, image in getattr(self.maps, name).items():
                mine = np.flatnonzero(tile == number)
                flat, share = bilinear_texels(place[mine], *image.shape)
                values[mine] = (image.reshape(-1)[flat] * share).sum(axis=1)
            found[name] = values
        return found

    def _colours(
        self,
        read: Callable[[Mapping[str, Float]], Float],
        names: Sequence[str],
        tile: int,
        shape: tuple[int, int],
        zeros: Zeros = np.zeros,
    ) -> NDArray[np.float32]:
        """What a table gives at every texel, (H, W, 3), or (1, 1, 3) where no map varies it.

        Some rows at a time: what is read on the way takes many times the memory of the result.

        Parameters
        ----------
        read : callable
            Takes some of the table's quantities, (P,) each, and gives (P, 3).
        names : sequence of str
            Quantities that it reads.
        tile : int
        shape : (H, W)
        zeros : callable
            Makes the image.
        """
        maps = {name: getattr(self.maps, name).get(tile) for name in names}
        images = {name: np.asarray(each, np.float32)[..., None] for name, each in maps.items() if each is not None}
        if not images:
            return read({}).astype(np.float32).reshape(1, 1, 3)
        height, width = shape
        out = zeros((height, width, 3), np.float32)

        def fill(rows: slice) -> None:
            values = {name: magnify_bilinear(image, shape, rows).reshape(-1) for name, image in images.items()}
            out[rows] = read({name: each.astype(np.float64) for name, each in values.items()}).reshape(-1, width, 3)

        for_slices(fill, height, max(_AT_ONCE // width, 1))
        return out


ScatterOf = Callable[[int, tuple[int, int]], NDArray[np.float32]]  # of a tile and (H, W): (H, W), or (1, 1)


def scatter_of(gaussians: GaussianSum, skin: SkinSpec, maps: SkinMaps) -> ScatterOf:
    """What gives the share of the light that scatters, at every texel of a tile.

    Parameters
    ----------
    gaussians : GaussianSum
    skin : SkinSpec
    maps : SkinMaps
    """
    weights, share = SkinWeights.of(gaussians, maps), np.float32(uniform_scatter(gaussians, skin))
    return lambda tile, shape: share * weights.scatter_image(tile, shape)


def uniform_scatter(gaussians: GaussianSum, skin: SkinSpec) -> float:
    """Share of the light that scatters everywhere; 1 where a map says it place by place."""
    return 1.0 if gaussians.table is not None and gaussians.table.scatters else skin.scatter
