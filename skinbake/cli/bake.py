"""`skinbake bake CONFIG`: every stage, the manifest, the preview."""

from __future__ import annotations

import json

import click

from skinbake.cli.options import config_argument, force_option, json_option, out_option, quiet_option, set_option


@click.command("bake")
@config_argument
@out_option
@set_option
@force_option
@click.option("--preview/--no-preview", default=True, help="Render preview.png at the end.")
@json_option
@quiet_option
def command(
    config: str, out: str | None, overrides: tuple[str, ...], force: bool, preview: bool, as_json: bool, verbosity: int
) -> None:
    """Bake CONFIG: profile, irradiance, diffusion, measured error, preview."""
    from skinbake.cli.baking import bake_look
    from skinbake.io.config import load_look

    manifest = bake_look(load_look(config, overrides, out), force=force, preview=preview, verbosity=verbosity)
    if as_json:
        print(json.dumps(manifest, indent=1, default=str))
