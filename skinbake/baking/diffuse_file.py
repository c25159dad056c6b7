"""The lobes of any irradiance."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from skinbake import pipeline
from skinbake.baking.folder_bake import folder_bake
from skinbake.baking.manifest import finish_manifest, manifest_of
from skinbake.baking.pace import STAGES, expected_seconds
from skinbake.baking.report import refuse_missed, report
from skinbake.baking.stages.irradiance import GivenIrradiance
from skinbake.diffuse.planning.texture_size import coarser_sizes, may_be_reduced
from skinbake.errors import InputError
from skinbake.io.digests import sha256_of
from skinbake.io.exr import read_attributes
from skinbake.io.irradiance import is_ours, read_irradiance, tile_path
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
    udim = spec.texture.udim
    bake = folder_bake(_as_large_as(Path(irradiance), spec), force, verbosity)
    path = Path(re.sub(r"\.[1-9]\d{3}(?=\.\w+$)", "", irradiance) if udim else irradiance)
    paths = {tile: tile_path(path, tile, udim) for tile in bake.inputs.tiles}
    with bake.log.progress.task("reading the light"):
        maps = tuple(read_irradiance(file, tile, bake.inputs.spec.texture.size) for tile, file in paths.items())
    given = GivenIrradiance(maps, [sha256_of(file) for file in paths.values()], bake.inputs, bake.log)
    stages = bake.stages(given)
    expected = expected_seconds(bake.inputs, stages, asked=STAGES - {"preview", "irradiance"})
    with (
        bake.log.telling_of_compiling(),
        bake.log.whole("scattering", expected),
        bake.results.open(given=tuple(paths.values())),
    ):
        baked = pipeline.bake(stages)
        bake.results.finish_writing()
        bake.results.remove_own_picture()  # of other lobes
        own = bake.results.irradiance_paths()
        inside = {tile: path for tile, path in paths.items() if own[tile].exists() and own[tile].samefile(path)}
        arriving = [own[tile].name for tile, path in inside.items() if is_ours(path)]
        manifest = manifest_of(bake.inputs, bake.results, bake.log, baked)
        manifest |= {"lights": list(maps[0].lights), "irradiance": arriving}
        finish_manifest(bake.results, manifest)
    report(bake.log, baked, (manifest["error"] or {}).get("model"), bake.inputs.texture_size.lost)
    refuse_missed(spec, baked)
    return manifest


def _as_large_as(irradiance: Path, spec: SceneSpec) -> SceneSpec:
    """The look, whose texture's size is kept if the file has it: a coarser one is chosen where light has it already."""
    try:
        sizes = {tuple(header["size"]) for header in read_attributes(irradiance).values()}
    except InputError:  # told when it is read
        sizes = set()
    coarser = set(coarser_sizes(spec.texture.size).values())
    if may_be_reduced(spec) and sizes <= coarser and sizes:
        return spec
    return spec.model_copy(update={"texture": spec.texture.model_copy(update={"reduce": "off"})})
