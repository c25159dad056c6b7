"""`skinbake bake CONFIG`: every stage, the manifest, the preview."""

from __future__ import annotations

import json

import click

from skinbake.cli.options import (
    Output,
    config_argument,
    force_option,
    json_option,
    out_option,
    quiet_option,
    set_option,
)


@click.command("bake")
@config_argument
@out_option
@set_option
@force_option
@click.option("--preview/--no-preview", default=True, help="Render preview.png at the end.")
@click.option("--cache", type=Output(file_okay=False), help="Folder shared with other looks [$SKINBAKE_CACHE].")
@json_option
@quiet_option
def command(
    config: str,
    out: str | None,
    overrides: tuple[str, ...],
    force: bool,
    preview: bool,
    cache: str | None,
    as_json: bool,
    verbosity: int,
) -> int:
    """Bake CONFIG: profile, irradiance, diffusion, measured error, preview, and the exports that it asks for.

    Of a sequence (`frames:`) every frame, each into a folder of its own, as `skinbake batch` does.
    """
    from skinbake.baking.session import BakeSession
    from skinbake.export.after_bake import bake_and_export
    from skinbake.io.cache import DEFAULT_LIMIT_BYTES, cache_folder
    from skinbake.io.config import frames_of, load_look

    if len(frames_of(config, overrides)) > 1:
        from skinbake.cli import batch

        return int(
            click.get_current_context().invoke(
                batch.command, file=config, out=out, overrides=overrides, force=force, cache=cache, preview=preview,
                as_json=as_json, verbosity=verbosity,
            )
        )  # fmt: skip
    look = load_look(config, overrides, out)
    folder = cache_folder(cache)
    session = BakeSession.of(str(folder) if folder else None, DEFAULT_LIMIT_BYTES, keep=False)
    manifest = bake_and_export(look, force, preview, verbosity, session)
    if as_json:
        print(json.dumps(manifest, indent=1, default=str))
    return 0
