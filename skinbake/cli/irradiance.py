"""`skinbake irradiance CONFIG`: the light arriving at each texel."""

from __future__ import annotations

import click

from skinbake.cli.options import config_argument, force_option, lit, out_option, quiet_option, set_option


@click.command("irradiance")
@config_argument
@out_option
@set_option
@force_option
@quiet_option
def command(config: str, out: str | None, overrides: tuple[str, ...], force: bool, verbosity: int) -> None:
    """Rasterise CONFIG's mesh into UV space, light it, and write irradiance.exr."""
    from skinbake.baking.light_look import light_look
    from skinbake.errors import printable
    from skinbake.io.config import load_look

    written = light_look(lit(load_look(config, overrides, out)), force, verbosity)
    print(printable("\n".join(map(str, written))))
