"""Drafts of a look: small, in memory, and quick where little has changed since the last one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake import pipeline
from skinbake.atlas.report import refuse_spoilt, uv_report
from skinbake.atlas.sample import shrink
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.preview_scene import scene_of
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.io.memory_cache import MemoryCache
from skinbake.irradiance.scene_data import SceneData
from skinbake.preview.scene import PreviewScene
from skinbake.scene.maps import IMAGES
from skinbake.scene.spec import DRAFT, SceneSpec

SIZE, DRAFT_METHOD = 512, "hybrid"
LEFT_OUT = ("beam", "interreflection", "transmission")  # unless the look says "on": to weigh them takes time


def draft_of(spec: SceneSpec) -> SceneSpec:
    """The look at SIZE texels a side at most, with a loose tolerance, nothing weighed and nothing measured."""
    width, height = spec.texture.size
    while max(width, height) > SIZE:
        width, height = max(width // 2, 1), max(height // 2, 1)
    texture = spec.texture.model_copy(update={"size": (width, height), "reduce": "off"})
    tolerance = max(spec.diffusion.tolerance, DRAFT)
    method = DRAFT_METHOD if spec.diffusion.method == "auto" else spec.diffusion.method
    diffusion = spec.diffusion.model_copy(update={"method": method, "tolerance": tolerance, "probes": 0})
    terms = spec.terms.model_copy(update={name: "off" for name in LEFT_OUT if getattr(spec.terms, name) == "auto"})
    output = spec.output.model_copy(update={"lights": "separate", "precision": "half", "tx": False})
    return spec.model_copy(
        update={"texture": texture, "diffusion": diffusion, "terms": terms, "output": output, "relight": None}
    )


@dataclass(frozen=True)
class Draft:
    """A draft as the preview draws it.

    Attributes
    ----------
    spec : SceneSpec
        Of the draft.
    scene : PreviewScene
        Its lights each on its own, or summed.
    """

    spec: SceneSpec
    scene: PreviewScene


class _DraftStore(MemoryStore):
    """Finds each light, and each light's lobes, of earlier drafts."""

    def __init__(self, cache: Any) -> None:
        self.cache = cache


class Drafter:
    """Makes drafts one after another; what a draft shares with an earlier one is not computed again.

    Parameters
    ----------
    log : StageLog
        Told what is compiled and how far it is.
    separate : bool
        Draw each light on its own: slower, and only a window has use for it.
    """

    def __init__(self, log: StageLog, separate: bool = True) -> None:
        self._separate = separate
        self._log, self._store, self._checked = log, _DraftStore(MemoryCache()), ""
        self._read: SceneData | None = None
        self._small: SceneData | None = None

    def draft(self, look: SceneSpec) -> Draft:
        """The draft of a look.

        Raises
        ------
        InputError, MachineError
            As `bake_look`.
        """
        spec, session = draft_of(look), BakeSession()
        inputs = BakeInputs(spec, session, self._log)
        stages = look_stages(inputs, self._store, session, self._log)
        with self._log.telling_of_compiling():
            scene, key = self._at_size(inputs.scene(), spec.texture.size), inputs.key("mesh")
            inputs.work_on(scene)
            if key != self._checked:
                refuse_spoilt(uv_report(scene.mesh, stages.raster.result()), spec.mesh.path)
                self._checked = key
            baked = pipeline.bake(stages)
        table = baked.gaussians.table
        shown = scene_of(spec, inputs.decisions, scene, baked.irradiance, baked.diffuse, table, self._separate)
        return Draft(spec, shown)

    def _at_size(self, scene: SceneData, size: tuple[int, int]) -> SceneData:
        """The scene with its maps averaged down to the draft's size, as each stage would do by itself."""
        if self._read is not scene or self._small is None:
            maps: dict[str, Any] = {
                role: {tile: _shrunk(image, size[::-1]) for tile, image in getattr(scene.maps, role).items()}
                for role in IMAGES
            }
            self._read, self._small = scene, replace(scene, maps=replace(scene.maps, **maps))
        return self._small


def _shrunk(image: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    flat = shrink(image.reshape(*image.shape[:2], -1), shape)
    return flat.reshape(*flat.shape[:2], *image.shape[2:])
