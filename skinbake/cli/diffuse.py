"""`skinbake diffuse CONFIG IRRADIANCE.exr`: blur any irradiance into lobes."""

from __future__ import annotations

import click

from skinbake.cli.options import config_argument, force_option, out_option, quiet_option, set_option


@click.command("diffuse")
@config_argument
@click.argument("irradiance", type=click.Path(dir_okay=False))
@out_option
@set_option
@force_option
@quiet_option
def command(
    config: str, irradiance: str, out: str | None, overrides: tuple[str, ...], force: bool, verbosity: int
) -> None:
    """Blur IRRADIANCE (ours, or any EXR with R, G, B) as CONFIG says; write lobe_*.exr and bake.json.

    With UDIM tiles, IRRADIANCE is the name of any one of them, irradiance.1001.exr, or without number, irradiance.exr.
    """
    import re
    from pathlib import Path

    from skinbake.bake.baking import manifest_of, put_manifest, report
    from skinbake.bake.stage_runner import StageRunner
    from skinbake.errors import ToleranceMissedError
    from skinbake.io.config import load_look
    from skinbake.io.fingerprint import sha256_of
    from skinbake.io.irradiance import read_irradiance, tile_path
    from skinbake.pipeline import plan_of

    spec = load_look(config, overrides, out)
    stages = StageRunner(spec, force, verbosity)
    name = re.sub(r"\.[1-9]\d{3}(?=\.\w+$)", "", irradiance) if spec.texture.udim else irradiance
    paths = {tile: tile_path(Path(name), tile, spec.texture.udim) for tile in stages.tiles}
    maps = tuple(read_irradiance(path, tile, spec.texture.size) for tile, path in paths.items())
    with stages.locked():
        gaussians = stages.profile()
        result = stages.diffuse(gaussians, maps, [sha256_of(path) for path in paths.values()])
        stages.finish_writing()
        plan = plan_of(spec, maps, result)
        put_manifest(stages, manifest_of(stages, gaussians, result, plan, maps[0].lights))
    report(stages, result, plan)
    if not result.tolerance_met:
        raise ToleranceMissedError(f"{stages.out}: tolerance {spec.diffusion.tolerance:g} missed: {result.advice}")
