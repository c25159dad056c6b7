"""Stage: which point of the skin each texel shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster
from skinbake.atlas.look_atlas import look_atlas
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.pipeline import Stage

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.baking.session import BakeSession
    from skinbake.io.spool import Spool
    from skinbake.pipeline import StageTimer


_ARRAYS = tuple(field.name for field in fields(AtlasRaster) if field.name != "tile")


class RasterStage(Stage[Atlas, Atlas]):
    """Rasterises the mesh. Kept for the next look of the process and in the cache, not in the folder."""

    name = "raster"

    def __init__(self, inputs: BakeInputs, results: ResultStore, session: BakeSession, timer: StageTimer) -> None:
        super().__init__(timer)
        self._inputs, self._results, self._session = inputs, results, session

    def key(self) -> str:
        """Digest of mesh and texture."""
        return key_of(code_digest(__name__), self._inputs.key("mesh"))

    def load(self) -> Atlas | None:
        """What the process or the cache has."""
        found: Atlas | None = self._session.peek("atlas", self.key())
        return found

    def compute(self) -> Atlas:
        """The raster, from the cache or made; what another process is making is waited for."""
        cache, made = self._results.cache, False

        def make(names: tuple[str, ...]) -> dict[str, dict[str, NDArray[Any]]]:
            nonlocal made
            made = True
            return {
                name: _as_arrays(look_atlas(self._inputs.spec.texture, self._inputs.scene().mesh)) for name in names
            }

        found = cache.get_many({"raster": self.key()}, make) if cache else make(("raster",))
        self.reused = not made
        return _of_arrays(found["raster"])

    def store(self, made: Atlas) -> Atlas:
        """Keep the raster for the process's next look."""
        return self._session.put("atlas", self.key(), made)

    def put_aside(self, spool: Spool) -> None:
        """Have the raster, if it is there, stand in files while nobody reads it."""
        if self._result is not None and not self._session.keep:
            self._result = _of_arrays({name: spool.keep(array) for name, array in _as_arrays(self._result).items()})

    def stale(self) -> str:
        """Only asked for by stages that would run."""
        return ""


def _as_arrays(atlas: Atlas) -> dict[str, NDArray[Any]]:
    """Every array of every tile, by `tile.field`."""
    return {f"{raster.tile}.{name}": getattr(raster, name) for raster in atlas for name in _ARRAYS}


def _of_arrays(entry: Mapping[str, NDArray[np.generic]]) -> Atlas:
    tiles: dict[int, dict[str, Any]] = {}
    for name, array in entry.items():
        tile, _, field = name.partition(".")
        tiles.setdefault(int(tile), {})[field] = array
    return tuple(AtlasRaster(tile=tile, **arrays) for tile, arrays in sorted(tiles.items()))
