"""Weights of shared Gaussians by what maps of the skin hold: the profile of each place, theory.md 4.8."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinbake.numerics import Float

MOST_AXES = 2
_Around = tuple[list[tuple[NDArray[np.int64], Float]], ...]  # by axis: nodes, and the share of each


@dataclass(frozen=True)
class WeightTable:
    """Rows of weights at the nodes of one or two quantities, read between them linearly in the quantity's root.

    The root spreads the nodes evenly over what an eye sees of a width or a pigment, and it is 0 at 0. What lies beyond
    the nodes reads as the nearest one. An axis that nothing varies along has one node.

    Attributes
    ----------
    names : tuple of up to 2 str
        Quantities that vary: maps of the look.
    nodes : tuple of 2 ndarrays
        Values along both axes, ascending, evenly spaced in their roots.
    weight_rgb : ndarray of shape (K, J, N, 3)
        Of what scatters.
    error_rgb : ndarray of shape (K, J, 3)
        Relative error (theory.md 4.2) of the profile at each node.
    between_rgb : ndarray of shape (K - 1 or 1, J - 1 or 1, 3)
        The same halfway between nodes, where weights are interpolated.
    constants : mapping of str to float
        What stands for a quantity where there is no map.
    scatters : bool
        Whether part of the light leaves where it arrives: then the first Gaussian is the identity, and holds it.
    """

    names: tuple[str, ...]
    nodes: tuple[Float, Float]
    weight_rgb: Float
    error_rgb: Float
    between_rgb: Float
    constants: Mapping[str, float]
    scatters: bool = False

    @property
    def worst(self) -> tuple[dict[str, float], float]:
        """Values of the node with the largest error, and that error."""
        k, j, _ = np.unravel_index(int(np.argmax(self.error_rgb)), self.error_rgb.shape)
        where = (self.nodes[0][k], self.nodes[1][j])
        return dict(zip(self.names, map(float, where), strict=False)), float(self.error_rgb.max())

    @property
    def quantities(self) -> tuple[str, ...]:
        """Maps that weights depend on."""
        return (*self.names, "scatter") if self.scatters else self.names

    def at(self, values: Mapping[str, ArrayLike]) -> Float:
        """Weights where the quantities have given values.

        Parameters
        ----------
        values : mapping of str to ndarray of shape (P,)
            By quantity; those that are not given are the constants.

        Returns
        -------
        ndarray of shape (N, P, 3)
        """
        around = self._around(values)
        return np.stack([self._weight(i, values, around) for i in range(self.weight_rgb.shape[2])])

    def of_lobe(self, index: int, values: Mapping[str, ArrayLike]) -> Float:
        """Weights of one Gaussian, (P, 3)."""
        return self._weight(index, values, self._around(values))

    def total(self, values: Mapping[str, ArrayLike]) -> Float:
        """What all Gaussians together give back of light, (P, 3)."""
        return _read(self.weight_rgb.sum(axis=2), self._around(values))

    def _weight(self, index: int, values: Mapping[str, ArrayLike], around: _Around) -> Float:
        """Weights of one Gaussian, (P, 3), from the nodes around the values."""
        weight = _read(self.weight_rgb[:, :, index], around)
        if self.scatters:
            scatter = self.scatter_at(values)[:, None]
            weight = scatter * weight
            if index == 0:
                weight = weight + (1 - scatter) * _read(self.weight_rgb.sum(axis=2), around)
        return weight

    def _around(self, values: Mapping[str, ArrayLike]) -> _Around:
        """Nodes around the values of both axes."""
        given = [np.atleast_1d(np.asarray(values.get(n, self.constants[n]), np.float64)) for n in self.names]
        given += [np.zeros(1)] * (MOST_AXES - len(given))
        return tuple(_between(nodes, each) for nodes, each in zip(self.nodes, given, strict=True))

    def scatter_at(self, values: Mapping[str, ArrayLike]) -> Float:
        """Share of the light that scatters, (P,) or (1,)."""
        if not self.scatters:
            return np.ones(1)
        return np.atleast_1d(np.asarray(values.get("scatter", self.constants["scatter"]), np.float64))


def _between(nodes: Float, value: Float) -> list[tuple[NDArray[np.int64], Float]]:
    """The nodes around values, (P,), and their shares."""
    if len(nodes) == 1:
        return [(np.zeros(len(value), np.int64), np.ones(len(value)))]
    low, high = np.sqrt(nodes[[0, -1]])
    place = np.clip((np.sqrt(np.maximum(value, 0)) - low) / (high - low), 0, 1) * (len(nodes) - 1)
    first = np.minimum(place.astype(np.int64), len(nodes) - 2)
    return [(first, 1 - (place - first)), (first + 1, place - first)]


def _read(rows: Float, around: _Around) -> Float:
    """Rows at nodes, (K, J, 3), read between them, (P, 3)."""
    total = np.zeros((1, 3))
    for row, row_share in around[0]:
        for column, column_share in around[1]:
            total = total + (row_share * column_share)[:, None] * rows[row, column]
    return total


def even_nodes(low: float, high: float, count: int) -> Float:
    """Values from `low` to `high`, evenly spaced in their roots; one where both are the same.

    Parameters
    ----------
    low, high : float
        0 or more.
    count : int
    """
    if high <= low:
        return np.array([low])
    return np.linspace(np.sqrt(low), np.sqrt(high), count) ** 2
