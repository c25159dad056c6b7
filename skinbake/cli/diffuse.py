"""`skinbake diffuse CONFIG IRRADIANCE.exr`: blur any irradiance into lobes."""

from __future__ import annotations

import click

from skinbake.cli.options import config_argument, force_option, lit, out_option, quiet_option, set_option


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
    from skinbake.baking.diffuse_file import diffuse_file
    from skinbake.io.config import load_look

    diffuse_file(lit(load_look(config, overrides, out)), irradiance, force, verbosity)
