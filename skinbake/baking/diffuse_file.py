"""The lobes of any irradiance."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from skinbake import pipeline
from skinbake.baking.folder_bake import folder_bake
from skinbake.baking.manifest import finish_manifest, manifest_of
from skinbake.baking.report import refuse_missed, report
from skinbake.baking.stages.irradiance import GivenIrradiance
from skinbake.io.digests import sha256_of
from skinbake.io.irradiance import read_irradiance, tile_path
from skinbake.scene.spec import SceneSpec


def diffuse_file(spec: SceneSpec, irradiance: str, force: bool = False, verbosity: int = 1) -> dict[str, Any]:
    """Write the lobes of an irradiance file into a look's folder, with a manifest, which is returned.

    Parameters
    ----------
    spec : SceneSpec
        Its lights are not used.
    irradiance : path
        One of our files, or any EXR with R, G, B. With tiles, any one of them, or the name without a tile's number.
    force, verbosity
        As `bake_look`, which also has the failures.
    """
    bake, udim = folder_bake(spec, force, verbosity), spec.texture.udim
    path = Path(re.sub(r"\.[1-9]\d{3}(?=\.\w+$)", "", irradiance) if udim else irradiance)
    paths = {tile: tile_path(path, tile, udim) for tile in bake.inputs.tiles}
    maps = tuple(read_irradiance(file, tile, spec.texture.size) for tile, file in paths.items())
    given = GivenIrradiance(maps, [sha256_of(file) for file in paths.values()], bake.inputs, bake.log)
    with bake.log.telling_of_compiling(), bake.results.open(given=tuple(paths.values())):
        baked = pipeline.bake(bake.stages(given))
        bake.results.finish_writing()
        manifest = manifest_of(bake.inputs, bake.results, bake.log, baked) | {"lights": list(maps[0].lights)}
        finish_manifest(bake.results, manifest)
    report(bake.log, baked, (manifest["error"] or {}).get("model"))
    refuse_missed(spec, baked)
    return manifest
