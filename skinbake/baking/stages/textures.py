"""Stage: the textures for renderers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.pipeline import Stage

if TYPE_CHECKING:
    from skinbake.baking.result_store import ResultStore
    from skinbake.pipeline import Stages, StageTimer


class TexturesStage(Stage[int, int]):
    """Makes a .tx of every EXR; its result is how many files were converted."""

    name = "textures"

    def __init__(self, stages: Stages, results: ResultStore, timer: StageTimer) -> None:
        super().__init__(timer)
        self._irradiance, self._diffuse, self._results = stages.irradiance, stages.diffuse, results

    def key(self) -> str:
        """Digest of what is converted. Each .tx holds the key of its own EXR."""
        return key_of(code_digest("skinbake.io.tx"), self._irradiance.key(), self._diffuse.key())

    def load(self) -> int | None:
        """0 where every .tx is that of its EXR."""
        return None if self._results.stale_textures(self._diffuse.result()) else 0

    def compute(self) -> int:
        """Convert what is stale, one file after another."""
        coverage = {tile.tile: tile.coverage for tile in self._irradiance.result()}
        stale = self._results.stale_textures(self._diffuse.result())
        for path, tile in stale.items():
            self._results.keep_textures(path, coverage[tile])
        return len(stale)

    def store(self, made: int) -> int:
        """Each file was kept when it was converted."""
        return made

    def stale(self) -> str:
        """Why textures would be made."""
        if self._diffuse.stale():
            return "to convert"
        lobes = self._results.lobes(self._diffuse.key())
        return "" if lobes and not self._results.stale_textures(lobes) else "to convert"
