"""`skinbake watch CONFIG`: bakes again whenever the look, or a file of it, is saved."""

from __future__ import annotations

from pathlib import Path

import click

from skinbake.cli.options import config_argument, lit, out_option, quiet_option, set_option


@click.command("watch")
@config_argument
@out_option
@set_option
@quiet_option
def command(config: str, out: str | None, overrides: tuple[str, ...], verbosity: int) -> None:
    """Bake CONFIG whenever it, or a file that it names, is saved: a draft at once, then as it asks.

    The newest picture is watch.png in the look's folder. A look that cannot be used is told in a line, and the last
    good picture stays. Ctrl-C ends it.
    """
    from skinbake.io.config import load_look
    from skinbake.io.fingerprint import every_input
    from skinbake.io.output_names import refuse_inputs
    from skinbake.watch.picture_file import PictureFile
    from skinbake.watch.watch import Watch

    spec = lit(load_look(config, overrides, out))
    screen = PictureFile(Path(spec.output.dir))
    refuse_inputs([screen.path], [config, *every_input(spec)])
    watch = Watch(config, overrides, out, screen, verbosity)
    with watch.guarded():
        watch.begin()
        watch.run()
