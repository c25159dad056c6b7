"""A bake in memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake import pipeline
from skinbake.api.baked_skin import BakedSkin
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages, refuse_spoilt_look
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.diffuse.light_entering import albedo_of
from skinbake.errors import InputError
from skinbake.io.config import load_look
from skinbake.io.lobes import StoredLobe
from skinbake.pipeline import Baked, Stages
from skinbake.relight.transfer import Transfer
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SceneSpec
from skinbake.stored_precision import as_stored

Image = NDArray[np.float32]


def bake(look: SceneSpec | Path | str, verbosity: int = 0) -> BakedSkin:
    """Bake a look and give what `skinbake bake` writes, as arrays; no file is written.

    Parameters
    ----------
    look : SceneSpec or path
        From `load_look`, or the file itself. `output.dir` is not used.
    verbosity : int
        0 says nothing, 1 a line a stage on stderr, 2 more. Logger `skinbake` tells at level INFO when kernels are
        compiled, which the first bake does for a quarter of a minute.

    Returns
    -------
    BakedSkin
        Rounded as its files would be: `output.precision: float` keeps all digits.

    Raises
    ------
    InputError, ConfigError
        The look, or a file of it, cannot be used.
    MachineError
        Too little memory.

    References
    ----------
    [dEon2007]
    """
    spec = look if isinstance(look, SceneSpec) else load_look(look)
    session, log = BakeSession(keep=False), StageLog(verbosity)
    inputs = BakeInputs(spec, session, log)
    stages = look_stages(inputs, MemoryStore(), session, log)
    with log.telling_of_compiling():
        refuse_spoilt_look(inputs, stages, on_disk=False)
        baked = pipeline.bake(stages)
    lobes = baked.diffuse.lobes
    return BakedSkin(
        inputs.spec,
        _MemoryPixels(inputs, stages, baked),
        tuple(light.name for light in spec.lights),
        inputs.tiles,
        np.array([lobe.variance_mm2 for lobe in lobes]),
        np.array([lobe.weight_rgb for lobe in lobes]).reshape(-1, 3),
        baked.diffuse.error,
        baked.plan,
        bool(lobes) and lobes[-1].transmitted,
        table=baked.gaussians.table,
    )


@dataclass(frozen=True)
class _MemoryPixels:
    """Arrays of a bake in memory."""

    inputs: BakeInputs
    stages: Stages
    baked: Baked

    def irradiance(self, tile: int, light: str | None) -> Image:
        found = next(of for of in self.baked.irradiance if of.tile == tile)
        if light is None:
            return as_stored(found.total, self.inputs.spec.output.precision).astype(np.float32)
        return found.rgb[found.lights.index(light)].astype(np.float32)

    def lobe(self, index: int, tile: int, light: str | None) -> Image:
        lobe = self.baked.diffuse.lobes[index]
        assert isinstance(lobe, StoredLobe)
        stored = lobe.total[tile] if light is None else lobe.rgb[tile][self.baked.diffuse.lights.index(light)]
        return stored.astype(np.float32)

    def albedo(self, tile: int) -> Image:
        raster = next(of for of in self.stages.raster.result() if of.tile == tile)
        scene = self.inputs.scene()
        return albedo_of(scene.maps, raster, scene.mesh)

    def transfer(self) -> Transfer:
        if self.baked.relight is None:
            raise InputError("relight: expected a look with relight, got one without")
        return self.baked.relight

    def maps(self) -> SkinMaps:
        return self.inputs.scene().maps
