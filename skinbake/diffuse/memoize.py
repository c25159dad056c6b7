"""Runs methods' operations, asking first for what is already known of a light.

Blurring is linear and a light's lobes do not depend on the others: when one light of a look has changed, that one alone
is blurred again. Plan and error are then found from the same numbers as in a bake from nothing, to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiles
from skinbake.diffuse.methods.method import DiffusionMethod, LobeParameters
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.terms.diffuse_profile import EverywhereLight
from skinbake.numerics import Float

Kind = tuple[Any, ...]
LobeLight = tuple[bool, float | None]
Values = dict[str, NDArray[np.generic]]
Make = Callable[[tuple[str, ...]], Mapping[str, Values]]
# (kind of result, names of lights, how to make those of some names) -> values by name
Memoize = Callable[[Kind, tuple[str, ...], Make], Mapping[str, Values]]


class Memoizer:
    """Each light's maps and probe values from `memoize` where it has them, else from the method itself.

    Parameters
    ----------
    resources : LobeResources
        Of all lights.
    names : tuple of L str
        The lights.
    memoize : callable, optional
        Knows mesh, raster, spec, and what identifies the light behind each name; a kind adds the rest. Without it
        methods are run on all lights at once.
    of_wide : LobeResources, optional
        Of the light that wider lobes blur, where that is another.
    wide_mm2 : float
        Least variance of these.
    everywhere : EverywhereLight, optional
        The part of the light of which each lobe blurs more, or less.
    """

    def __init__(
        self,
        resources: LobeResources,
        names: tuple[str, ...],
        memoize: Memoize | None = None,
        of_wide: LobeResources | None = None,
        wide_mm2: float = np.inf,
        everywhere: EverywhereLight | None = None,
    ) -> None:
        self.resources, self.names, self._memoize = resources, names, memoize
        self._of_wide, self._wide_mm2, self._everywhere = of_wide, wide_mm2, everywhere
        self._of_lights: dict[tuple[LobeLight, tuple[str, ...]], LobeResources] = {((False, None), names): resources}
        if of_wide:
            self._of_lights[(True, None), names] = of_wide
        self._room: Tiles | None = None  # of the last lobe's own light, for the next one's

    def light_of(self, variance_mm2: float) -> LobeLight:
        """Which light the lobe of a variance blurs: that of wider lobes or not, and whose factors are in it, if any."""
        wide = self._of_wide is not None and variance_mm2 >= self._wide_mm2
        own = self._everywhere is not None and self._everywhere.changes(variance_mm2)
        return wide, variance_mm2 if own else None

    def in_common(self) -> Memoizer:
        """The same, but for lights that are one lobe's: each lobe blurs what it has in common with others."""
        if self._everywhere is None:
            return self
        of_wide, wide_mm2 = self._of_wide, self._wide_mm2
        return Memoizer(self.resources, self.names, self._memoize, of_wide, wide_mm2)

    def of_lobe(self, variance_mm2: float) -> LobeResources:
        """What the lobe of a variance is made of."""
        light = wide, own = self.light_of(variance_mm2)
        if own is not None and (light, self.names) not in self._of_lights:
            assert self._everywhere is not None
            # Lobes are made one after another: what is only another's would fill the memory
            self._of_lights = {key: each for key, each in self._of_lights.items() if key[0][1] is None}
            base = self._of_lights[(wide, None), self.names]
            self._room = self._everywhere.added_to(base.source, own, base.zeros, self._room)
            self._of_lights[light, self.names] = base.with_light(self._room)
        return self._of_lights[light, self.names]

    def map(self, method: DiffusionMethod, lobe: LobeParameters) -> Tiles:
        """The lobe at its stored size, (L, h, w, 3) a tile."""
        if self._memoize is None or method.quick:
            tiles = method.map(self.of_lobe(lobe.variance_mm2), lobe)
            if self._room and any(np.may_share_memory(rgb, self._room[tile]) for tile, rgb in tiles.items()):
                self._room = None  # the lobe is the light itself, which stays
            return tiles

        def make(names: tuple[str, ...]) -> dict[str, Values]:
            tiles = method.map(self._only(names, lobe), lobe)
            return {name: {str(tile): rgb[i] for tile, rgb in tiles.items()} for i, name in enumerate(names)}

        found = self._memoize(("map", method.name, *lobe, *self._own(lobe)), self.names, make)
        return {
            tile: np.stack([np.asarray(found[name][str(tile)], np.float32) for name in self.names])
            for tile in self.resources.source
        }

    def at_probes(self, method: DiffusionMethod, lobe: LobeParameters, probes: Probes) -> Float:
        """The lobe at probes as the method gives it, before any storage, (P, 3 L).

        Parameters
        ----------
        method : DiffusionMethod
        lobe : LobeParameters
        probes : Probes
        """
        return self._columns("at", method.at_probes, method, lobe, probes)

    def read_stored(self, method: DiffusionMethod, lobe: LobeParameters, probes: Probes) -> Float:
        """What reading the stored map will give at probes, (P, 3 L).

        Parameters
        ----------
        method : DiffusionMethod
        lobe : LobeParameters
        probes : Probes
        """
        return self._columns("read", method.read_stored, method, lobe, probes)

    def release(self, unneeded: Collection[Resource]) -> None:
        """Free the memory of some resources."""
        for resources in self._of_lights.values():
            resources.release(unneeded)

    def release_lobe(self, variance_mm2: float) -> None:
        """Free what belongs to one lobe."""
        for resources in self._of_lights.values():
            resources.release_lobe(variance_mm2)

    def _columns(
        self,
        what: str,
        operation: Callable[[LobeResources, LobeParameters, Probes], Float],
        method: DiffusionMethod,
        lobe: LobeParameters,
        probes: Probes,
    ) -> Float:
        if self._memoize is None or method.quick:
            return operation(self.of_lobe(lobe.variance_mm2), lobe, probes)

        def make(names: tuple[str, ...]) -> dict[str, Values]:
            values = operation(self._only(names, lobe), lobe, probes)
            return {name: {"values": values[:, 3 * i : 3 * i + 3]} for i, name in enumerate(names)}

        found = self._memoize((what, method.name, *lobe, *self._own(lobe), _digest(probes)), self.names, make)
        return np.concatenate([np.asarray(found[name]["values"], np.float64) for name in self.names], axis=1)

    def _own(self, lobe: LobeParameters) -> Kind:
        """Part of a kind that tells a lobe of a light of its own from one of the light in common."""
        return ("own",) if self.light_of(lobe.variance_mm2)[1] is not None else ()

    def _only(self, names: tuple[str, ...], lobe: LobeParameters) -> LobeResources:
        """Resources of some of the lights for a lobe, with the same geometry."""
        key = self.light_of(lobe.variance_mm2), names
        if key not in self._of_lights:
            chosen = [self.names.index(name) for name in names]
            some = self.of_lobe(lobe.variance_mm2).of_lights(chosen)
            self._of_lights[key] = some
        return self._of_lights[key]


def _digest(probes: Probes) -> str:
    digest = hashlib.sha256()
    for values in vars(probes).values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
