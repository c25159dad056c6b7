"""The irradiance of a look alone."""

from __future__ import annotations

from pathlib import Path

from skinbake.baking.folder_bake import folder_bake
from skinbake.baking.look_stages import put_aside, refuse_spoilt_look
from skinbake.baking.pace import expected_seconds
from skinbake.scene.spec import SceneSpec


def light_look(spec: SceneSpec, force: bool = False, verbosity: int = 1) -> list[Path]:
    """Write the irradiance of a look, and give its files, one a tile.

    Parameters
    ----------
    spec, force, verbosity
        As `bake_look`, which also has the failures.
    """
    bake = folder_bake(spec, force, verbosity)
    stages = bake.stages()
    expected = expected_seconds(bake.inputs, stages, asked=("read", "raster", "irradiance", "write"))
    with bake.log.telling_of_compiling(), bake.log.whole("lighting", expected):
        refuse_spoilt_look(bake.inputs, stages)
        with bake.results.open():
            put_aside(bake.inputs, stages, bake.results.spool)
            stages.irradiance.result()
        return list(bake.results.irradiance_paths().values())
