"""`skinbake watch CONFIG`: bakes again whenever the look, or a file of it, is saved."""

from __future__ import annotations

from pathlib import Path

import click

from skinbake.cli.options import config_argument, lit, out_option, quiet_option, set_option


@click.command("watch")
@config_argument
@out_option
@set_option
@click.option("--window", is_flag=True, help="Show the newest picture in a window, with the preview's keys.")
@quiet_option
def command(config: str, out: str | None, overrides: tuple[str, ...], window: bool, verbosity: int) -> None:
    """Bake CONFIG whenever it, or a file that it names, is saved: a draft at once, then as it asks.

    The newest picture is watch.png in the look's folder, or in a window, whose key W writes gains and view into CONFIG.
    A look that cannot be used is told in a line, and the last good picture stays. Ctrl-C ends it, or Q in the window.
    """
    from skinbake.io.config import load_look
    from skinbake.io.fingerprint import every_input
    from skinbake.io.output_names import refuse_inputs
    from skinbake.watch.picture_file import PictureFile
    from skinbake.watch.watch import Watch

    spec = lit(load_look(config, overrides, out))
    if window:
        _in_window(config, overrides, out, Path(spec.output.dir), verbosity)
        return
    screen = PictureFile(Path(spec.output.dir))
    refuse_inputs([screen.path], [config, *every_input(spec)])
    watch = Watch(config, overrides, out, screen, verbosity)
    with watch.guarded():
        watch.begin()
        watch.run()


def _in_window(config: str, overrides: tuple[str, ...], out: str | None, folder: Path, verbosity: int) -> None:
    """Watch with a window, until that is closed.

    Parameters
    ----------
    config, overrides, out
        As of `Watch`.
    folder : Path
        The look's.
    verbosity : int
    """
    from skinbake.preview.platform import renderer_words
    from skinbake.progress import Progress
    from skinbake.watch.picture_window import PictureWindow
    from skinbake.watch.watch import Watch

    screen = PictureWindow(folder, config)
    watch = Watch(config, overrides, out, screen, verbosity)
    with watch.guarded():
        watch.begin()
        assert screen.window is not None
        Progress(verbosity > 0).line(f"drawn by {renderer_words(screen.window.device)}; H shows the keys")
        screen.idle = watch.step
        screen.window.run()
        watch.close()
