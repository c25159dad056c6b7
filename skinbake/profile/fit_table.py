"""Weights of shared Gaussians over the values that maps of a skin hold, theory.md 4.8."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float, safe_div
from skinbake.profile.diffusion_profile import DiffusionProfile
from skinbake.profile.fit_nodes import FitNodes
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.scaled import scaled_nodes
from skinbake.profile.variable_projection import Fitter, shared_variances
from skinbake.profile.varying_skin import Range
from skinbake.profile.weight_table import WeightTable, even_nodes
from skinbake.scene.skin import PhysiologySkin, SkinSpec

NODES = {1: (33, 1), 2: (13, 7)}  # of a table, by its number of axes
SEARCHED = {1: 5, 2: 2}  # nodes of an axis that variances are searched for; weights are found at all


class TableFitter:
    """Fits any number of shared Gaussians to the profiles of a range of skins.

    Parameters
    ----------
    skin : SkinSpec
    over : mapping of str to Range
        What varies: `radius`, or `melanin` and `haemoglobin`, one or both.
    profile_of : callable
        The profile of a skin.

    Raises
    ------
    InputError
        If a profile is dark in a channel that is to be made white.
    """

    def __init__(
        self, skin: SkinSpec, over: Mapping[str, Range], profile_of: Callable[[SkinSpec], DiffusionProfile]
    ) -> None:
        self.skin, self.names = skin, tuple(over)
        self._mean = {name: each.mean for name, each in over.items()}
        counts = NODES[len(over)]
        ranges = [*over.values(), Range(0.0, 0.0, 0.0)][:2]
        self.nodes = tuple(even_nodes(each.low, each.high, n) for each, n in zip(ranges, counts, strict=True))
        base = profile_of(skin.model_copy(update={"radius": 1.0})).fit_nodes() if self.names == ("radius",) else None

        def nodes_at(values: Mapping[str, float]) -> FitNodes:
            if base is not None:  # the profile is computed once, and widened
                return scaled_nodes(base, values["radius"])
            return profile_of(skin.model_copy(update=dict(values))).fit_nodes()

        self._nodes_at = nodes_at
        self._fitters: dict[tuple[float, float], Fitter] = {}

    def variances(self, count: int) -> Float:
        """The `count` shared variances, mm^2, that suit the whole range."""
        searched = [values[np.unique(np.linspace(0, len(values) - 1, SEARCHED[len(self.names)]).astype(int))]
                    for values in self.nodes]  # fmt: skip
        return shared_variances([self._fitter(a, b) for a in searched[0] for b in searched[1]], count)

    def table(self, variance_mm2: Float, constants: Mapping[str, float]) -> WeightTable:
        """Weights for given variances at every node, with the error there and halfway.

        Parameters
        ----------
        variance_mm2 : ndarray of shape (N,)
            Above 0.
        constants : mapping of str to float
            As of a `WeightTable`.
        """
        found = [[self._fitter(a, b).project(variance_mm2) for b in self.nodes[1]] for a in self.nodes[0]]
        error = np.array([[each.error for each in row] for row in found])
        weight = np.array([[self._normalised(each.weight) for each in row] for row in found])
        halfway = [_halfway(values) for values in self.nodes]
        table = WeightTable(self.names, (self.nodes[0], self.nodes[1]), weight, error, error, constants)
        between = np.array([[self._error_between(table, variance_mm2, a, b) for b in halfway[1]] for a in halfway[0]])
        return replace(table, between_rgb=between, weight_rgb=weight * self._levels()[:, :, None])

    def _levels(self) -> Float:
        """Factors on the totals of the nodes, (K, J, 3): of a skin that says its medium and has its own colour."""
        shape = (*map(len, self.nodes), 3)
        if self.skin.normalise == "white" or not isinstance(self.skin, PhysiologySkin):
            return np.ones(shape)
        from skinbake.profile.medium_level import levels

        where = [(a, b) for a in self.nodes[0] for b in self.nodes[1]]
        skins = [self.skin.model_copy(update=self._values(a, b)) for a, b in where]
        total = np.array([self._fitter(a, b).nodes.total for a, b in where])
        mean = self.skin.model_copy(update=self._mean)
        return levels(skins, total, mean, self._nodes_at(self._mean).total).reshape(shape)

    def _values(self, a: float, b: float) -> dict[str, float]:
        """Quantities at a node."""
        return dict(zip(self.names, (float(a), float(b)), strict=False))

    def _normalised(self, weight: Float) -> Float:
        return safe_div(weight, weight.sum(axis=0)) if self.skin.normalise == "white" else weight

    def _error_between(self, table: WeightTable, variance_mm2: Float, a: float, b: float) -> Float:
        """Error of interpolated weights, (3,)."""
        fitter = self._fitter(a, b)
        read = table.at(self._values(a, b))[:, 0]
        total = fitter.nodes.total if self.skin.normalise == "white" else 1.0
        value, _ = fitter.nodes.basis(variance_mm2)
        got = value * fitter.nodes.root_weight[:, None] @ (read * total)
        want = fitter.nodes.target * fitter.nodes.root_weight[:, None]
        return safe_div(np.linalg.norm(got - want, axis=0), np.linalg.norm(want, axis=0))

    def _fitter(self, a: float, b: float) -> Fitter:
        """The fitter of one node, made once."""
        key = (float(a), float(b))
        if key not in self._fitters:
            values = self._values(a, b)
            fit = self.skin.fit
            try:
                made = Fitter(self._nodes_at(values), exact_energy=fit.energy == "exact", signed=fit.signed)
            except ValueError as error:
                raise InputError(f"{_said(values)}: {error}") from error
            dark = [name for name, total in zip(("red", "green", "blue"), made.nodes.total, strict=True) if total <= 0]
            if dark and self.skin.normalise == "white":
                raise InputError(
                    f"skin.normalise: white needs light in every channel, {dark[0]} is dark at {_said(values)};"
                    " use none, or lighter maps"
                )
            self._fitters[key] = made
        return self._fitters[key]


def with_identity(gaussians: GaussianSum, scatter: float, varies: bool, constant: float) -> GaussianSum:
    """The sum of which a share `scatter` scatters: the rest is a Gaussian of no width, which comes first.

    Parameters
    ----------
    gaussians : GaussianSum
    scatter : float
        In the mean.
    varies : bool
        Whether a map says so texel by texel; then a table is there.
    constant : float
        Share where that map is missing.
    """
    variance, weight, table = gaussians.variance_mm2, gaussians.weight_rgb, gaussians.table
    if variance[0] > 0:
        variance = np.concatenate([[0.0], variance])
        weight = np.concatenate([np.zeros((1, 3)), weight])
        if table is not None:
            none = np.zeros((*table.weight_rgb.shape[:2], 1, 3))
            table = replace(table, weight_rgb=np.concatenate([none, table.weight_rgb], axis=2))
    if varies and table is None:
        zero = np.zeros((1, 1, 3))
        table = WeightTable((), (np.zeros(1), np.zeros(1)), weight[None, None], zero, zero, {})
    if varies and table is not None:
        table = replace(table, scatters=True, constants={**table.constants, "scatter": constant})
    elif table is not None:
        table = replace(table, weight_rgb=_mixed(table.weight_rgb, scatter))
    return replace(gaussians, variance_mm2=variance, weight_rgb=_mixed(weight, scatter), table=table)


def _mixed(weight: Float, scatter: float) -> Float:
    """Weights (..., N, 3) times the share that scatters, the rest with the first one."""
    mixed = scatter * weight
    mixed[..., 0, :] += (1 - scatter) * weight.sum(axis=-2)
    return mixed


def _halfway(nodes: Float) -> Float:
    """Values halfway between nodes, in their roots; the node itself where there is one."""
    root = np.sqrt(nodes)
    return nodes if len(nodes) == 1 else (0.5 * (root[1:] + root[:-1])) ** 2


def _said(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
