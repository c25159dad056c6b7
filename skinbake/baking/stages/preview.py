"""Stage: the picture that a bake ends with."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.baking.preview_scene import scene_of, stand_in_of
from skinbake.baking.preview_worker import PreviewWorker
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.pipeline import Stage

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.pipeline import Stages, StageTimer

Pixels = NDArray[np.uint8]
CODE = (__name__, "skinbake.io.scene_files", "skinbake.io.png")


class PreviewStage(Stage[Pixels, bool]):
    """Draws preview.png, from memory, while the files of the bake are still being written."""

    name = "preview"

    def __init__(
        self,
        inputs: BakeInputs,
        stages: Stages,
        results: ResultStore,
        worker: PreviewWorker,
        timer: StageTimer,
    ) -> None:
        super().__init__(timer)
        self._inputs, self._results, self._worker = inputs, results, worker
        self._stages = stages
        self._with_maps = False  # whether the worker was given the maps

    def key(self) -> str:
        """Digest of everything the look says and reads, and of the lobes."""
        look = _without_paths(self._inputs.spec.model_dump(mode="json"))
        return key_of(code_digest(*CODE), look, self._inputs.digests, self._stages.diffuse.key())

    def prepare(self) -> None:
        """Make ready for drawing while the lobes are computed, if they will be."""
        if self._stages.diffuse.stale() and not self._results.has_picture(self.key()):
            inputs = self._inputs
            through = inputs.spec.terms.transmission != "off"  # likely: a lobe more
            count = len(self._stages.profile.result().variance_mm2) + through
            # Maps are in memory twice from then on: at their own size a bake's peak would be higher
            self._with_maps = inputs.reduced
            stand_in = partial(
                stand_in_of, inputs.spec, inputs.decisions, inputs.scene(), inputs.tiles, count, self._with_maps
            )
            self._worker.prepare(stand_in, inputs.spec.preview)

    def load(self) -> bool | None:
        """Whether the picture is there, and nobody has drawn another one since."""
        return self._results.has_picture(self.key()) or None

    def compute(self) -> Pixels:
        """sRGB pixels (H, W, 3)."""
        inputs = self._inputs
        lobes = self._results.lobe_totals(self._stages.diffuse.result())
        table, irradiance = self._stages.profile.result().table, self._stages.irradiance.result()
        prepared = self._worker.stand_in() if self._with_maps else None
        halves = prepared.maps if prepared else None
        scene = scene_of(inputs.spec, inputs.decisions, inputs.scene(), irradiance, lobes, table, halves=halves)
        inputs.close()  # mesh, maps and raster: a quarter of a gigabyte that nothing yet to come has use for
        self._stages.raster.close()
        self._results.spool.rest()
        return self._worker.draw(scene, inputs.spec.preview, self._results.spool.rest)

    def store(self, made: Pixels) -> bool:
        """Keep the picture."""
        self._results.keep_picture(made, self.key())
        return True

    def stale(self) -> str:
        """Why the picture would be drawn."""
        if self._stages.profile.load() is None:
            return "to draw"
        return "" if self._results.has_picture(self.key()) else "to draw"


def _without_paths(value: Any) -> Any:
    """Where files lie makes no difference, what is in them has its own key."""
    if isinstance(value, dict):
        return {key: _without_paths(inner) for key, inner in value.items() if key not in ("path", "dir", "opacity")}
    return [_without_paths(inner) for inner in value] if isinstance(value, list) else value
