"""A LobeEvaluator that asks for what is already known, light by light.

Blurring is linear and a light's lobes do not depend on the others: when one light of a look has changed, that one alone
is blurred again. Plan and error are then found from the same numbers as in a bake from nothing, to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.evaluator import LobeEvaluator, Tiles
from skinbake.diffuse.probes import Probes
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

Kind = tuple[Any, ...]
Values = dict[str, NDArray[np.generic]]
Make = Callable[[tuple[str, ...]], Mapping[str, Values]]
# (kind of result, names of lights, how to make those of some names) -> values by name
Memoize = Callable[[Kind, tuple[str, ...], Make], Mapping[str, Values]]

_QUICK = ("identity", "texture")  # blurred sooner than read


class MemoizedEvaluator(LobeEvaluator):
    """As `LobeEvaluator`, each light's maps and probe values taken from `remember` where it has them.

    Parameters
    ----------
    names : tuple of L str
    remember : callable
        Knows mesh, raster, spec, and what identifies the light behind each name; a kind adds the rest.
    """

    def __init__(
        self,
        source: Sequence[NDArray[np.float32]],
        atlas: Atlas,
        mesh: SkinMesh,
        spec: DiffusionSpec,
        names: tuple[str, ...],
        remember: Memoize,
    ) -> None:
        super().__init__(source, atlas, mesh, spec)
        self.names, self.remember = names, remember
        self._parts: dict[tuple[str, ...], LobeEvaluator] = {}

    def map(self, method: str, *rest: Any, **named: Any) -> Tiles:
        """One lobe at a stored size, (L, h, w, 3) a tile."""
        if method in _QUICK:
            return super().map(method, *rest, **named)

        def make(names: tuple[str, ...]) -> dict[str, Values]:
            tiles = self._only(names).map(method, *rest, **named)
            return {
                name: {str(r.tile): tile[i] for r, tile in zip(self.atlas, tiles, strict=True)}
                for i, name in enumerate(names)
            }

        found = self.remember(_kind("map", method, *rest, *named.items()), self.names, make)
        return [np.stack([np.asarray(found[name][str(r.tile)], np.float32) for name in self.names]) for r in self.atlas]

    def at(self, method: str, *rest: Any, **named: Any) -> Float:
        """The same lobe at probe points as the method gives it before any storage, (P, 3 L)."""
        if method in _QUICK:
            return super().at(method, *rest, **named)
        kind = _kind("at", method, *rest, *named.items())
        return self._columns(kind, lambda part: part.at(method, *rest, **named))

    def reference(self, variance_mm2: float, probes: Probes) -> Float:
        """The exact integral at the probes, (P, 3 L)."""
        kind = _kind("reference", variance_mm2, probes)
        return self._columns(kind, lambda part: part.reference(variance_mm2, probes))

    def read_surface(self, variance_mm2: float, level: int, spacing: float, probes: Probes) -> Float:
        """What reading a stored `surface` lobe will give at the probes, (P, 3 L)."""
        kind = _kind("read", variance_mm2, level, spacing, probes)
        return self._columns(kind, lambda part: part.read_surface(variance_mm2, level, spacing, probes))

    def read_hybrid(self, variance_mm2: float, level: int, spacing: float, threshold: float, probes: Probes) -> Float:
        """What reading a stored `hybrid` lobe will give at the probes, (P, 3 L)."""
        kind = _kind("read hybrid", variance_mm2, level, spacing, threshold, probes)
        return self._columns(kind, lambda part: part.read_hybrid(variance_mm2, level, spacing, threshold, probes))

    def forget(self, variance_mm2: float) -> None:
        """Let one lobe's clusters go."""
        super().forget(variance_mm2)
        for part in self._parts.values():
            part.forget(variance_mm2)

    def drop_texels(self) -> None:
        """Let the single texels go."""
        super().drop_texels()
        for part in self._parts.values():
            part.drop_texels()

    def drop_pyramids(self) -> None:
        """Let the premultiplied images go."""
        super().drop_pyramids()
        for part in self._parts.values():
            part.drop_pyramids()

    def _columns(self, kind: Kind, compute: Callable[[LobeEvaluator], Float]) -> Float:
        def make(names: tuple[str, ...]) -> dict[str, Values]:
            values = compute(self._only(names))
            return {name: {"values": values[:, 3 * i : 3 * i + 3]} for i, name in enumerate(names)}

        found = self.remember(kind, self.names, make)
        return np.concatenate([np.asarray(found[name]["values"], np.float64) for name in self.names], axis=1)

    def _only(self, names: tuple[str, ...]) -> LobeEvaluator:
        """A plain LobeEvaluator on some of the lights, with this one's skin points."""
        if names not in self._parts:
            if names == self.names:  # the same state, only that it does not ask
                part = LobeEvaluator.__new__(LobeEvaluator)
                part.__dict__ = self.__dict__
            else:
                chosen = [self.names.index(name) for name in names]
                part = LobeEvaluator([s[chosen] for s in self.source], self.atlas, self.mesh, self.spec)
                part._targets, part._atlases = self._targets, self._atlases
            self._parts[names] = part
        return self._parts[names]


def _kind(*parts: Any) -> Kind:
    """Plain values, probes by their digest."""
    return tuple(_digest(part) if isinstance(part, Probes) else part for part in parts)


def _digest(probes: Probes) -> str:
    digest = hashlib.sha256()
    for values in vars(probes).values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
