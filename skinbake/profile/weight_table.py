"""Weights of shared Gaussians by what maps of the skin hold: the profile of each place, theory.md 4.8."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

MOST_AXES = 2


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
        along = self._along_axes(values)
        return np.stack([self._weight(i, values, along) for i in range(self.weight_rgb.shape[2])])

    def of_lobe(self, index: int, values: Mapping[str, ArrayLike]) -> Float:
        """Weights of one Gaussian, (P, 3)."""
        return self._weight(index, values, self._along_axes(values))

    def total(self, values: Mapping[str, ArrayLike]) -> Float:
        """What all Gaussians together give back of light, (P, 3)."""
        return self._read(self.weight_rgb.sum(axis=2), self._along_axes(values))

    def _weight(self, index: int, values: Mapping[str, ArrayLike], along: tuple[Float, ...]) -> Float:
        """Weights of one Gaussian, (P, 3), from the quantities along both axes."""
        weight = self._read(self.weight_rgb[:, :, index], along)
        if self.scatters:
            scatter = self.scatter_at(values)[:, None]
            weight = scatter * weight
            if index == 0:
                weight = weight + (1 - scatter) * self._read(self.weight_rgb.sum(axis=2), along)
        return weight

    def _along_axes(self, values: Mapping[str, ArrayLike]) -> tuple[Float, ...]:
        """The quantity of each axis, (P,) or (1,)."""
        given = [np.atleast_1d(np.asarray(values.get(n, self.constants[n]), np.float64)) for n in self.names]
        return tuple(given + [np.zeros(1)] * (MOST_AXES - len(given)))

    def _read(self, rows: Float, along: tuple[Float, ...]) -> Float:
        """Rows at the nodes, (K, J, 3), read between them, (P, 3)."""
        out = np.empty((max(map(len, along)), 3))
        axes = (_roots(self.nodes[0]), _roots(self.nodes[1]))
        _read_rows(np.ascontiguousarray(rows), axes, tuple(map(np.ascontiguousarray, along)), out)
        return out

    def scatter_at(self, values: Mapping[str, ArrayLike]) -> Float:
        """Share of the light that scatters, (P,) or (1,)."""
        if not self.scatters:
            return np.ones(1)
        return np.atleast_1d(np.asarray(values.get("scatter", self.constants["scatter"]), np.float64))


def _roots(nodes: Float) -> tuple[float, float, int]:
    """Roots of the least and of the greatest value of an axis, and its number of nodes, as `_read_rows` takes them."""
    low, high = np.sqrt(nodes[[0, -1]])
    return float(low), float(high), len(nodes)


@kernel(inline=True)
def _between(value, axis):  # type: ignore[no-untyped-def]
    """The first of two nodes around a value, and the share of the second.

    Parameters
    ----------
    value : float
    axis : tuple
        As `_roots` gives it.
    """
    low, high, count = axis
    if count == 1:
        return 0, 0.0
    place = min(max((np.sqrt(max(value, 0.0)) - low) / (high - low), 0.0), 1.0) * (count - 1)
    first = max(min(int(place), count - 2), 0)
    return first, place - first


@kernel
def _read_rows(rows, axes, values, out):  # type: ignore[no-untyped-def]
    """Rows at nodes, read between them.

    Parameters
    ----------
    rows : ndarray of shape (K, J, 3)
    axes : tuple of two tuples
        As `_roots` gives them.
    values : tuple of two ndarrays of shape (P,) or (1,)
        Along both axes.
    out : ndarray of shape (P, 3)
        Written.
    """
    along, across = values
    for p in range(len(out)):
        k, of_k = _between(along[p if len(along) > 1 else 0], axes[0])
        j, of_j = _between(across[p if len(across) > 1 else 0], axes[1])
        red, green, blue = 0.0, 0.0, 0.0
        for a in range(min(2, axes[0][2])):
            for b in range(min(2, axes[1][2])):
                share = (of_k if a else 1.0 - of_k) * (of_j if b else 1.0 - of_j)
                red += share * rows[k + a, j + b, 0]
                green += share * rows[k + a, j + b, 1]
                blue += share * rows[k + a, j + b, 2]
        out[p, 0], out[p, 1], out[p, 2] = red, green, blue


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
