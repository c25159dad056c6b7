"""Options that several verbs share."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from skinbake.scene.spec import SceneSpec

Command = TypeVar("Command", bound=Callable[..., Any])


class Within(click.FloatRange):
    """A finite number of a range: `click.FloatRange` lets NaN pass, and infinity where the range is open."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number, finite and in range.

        Parameters
        ----------
        value, param, ctx
            As click gives them.

        Raises
        ------
        click.BadParameter
            If it is not.
        """
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"expected a finite number {self._describe_range()}, got {value}", param, ctx)
        return number


_FILES = {".png", ".jpg", ".jpeg", ".exr", ".mp4", ".gif", ".glb", ".gltf", ".html", ".json", ".csv", ".py", ".yaml"}


class Output(click.Path):
    """A file or folder to write to.

    An empty text, as of a variable that is not set, is not the folder one is in, and a name that ends as a file's is no
    folder to be made.

    Parameters
    ----------
    instead : str
        What one may have meant, where a folder is asked for and a file is named.
    **how
        As of `click.Path`.
    """

    def __init__(self, instead: str = "", **how: Any) -> None:
        super().__init__(**how)
        self._instead = instead

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path.

        Parameters
        ----------
        value, param, ctx
            As click gives them.

        Raises
        ------
        click.BadParameter
            If there is none.
        """
        if not str(value):
            self.fail("expected a path, got an empty text; is a variable not set?", param, ctx)
        path = Path(str(value))
        if self.dir_okay and not self.file_okay and not path.is_dir():
            if path.exists():
                self.fail(f"expected a folder, got a file, {value}{self._instead}", param, ctx)
            if path.suffix.lower() in _FILES:
                self.fail(f"expected a folder, got a file's name, {value}{self._instead}", param, ctx)
        return super().convert(value, param, ctx)


_QUIET = "skinbake.quiet"  # key of click's context
config_argument = click.argument("config", type=click.Path(dir_okay=False))
set_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a configuration key; may be repeated."
)
out_option = click.option("--out", type=Output(file_okay=False), help="Folder to write to, instead of output.dir.")
json_option = click.option("--json", "as_json", is_flag=True, help="Report as JSON on stdout.")
force_option = click.option("--force", is_flag=True, help="Run every stage, also those whose inputs have not changed.")


def named_look(path: str) -> SceneSpec | None:
    """The look whose bake is meant, where it is named by that, not by its folder."""
    if Path(path).suffix.lower() not in (".yaml", ".yml") or Path(path).is_dir():
        return None
    from skinbake.io.config import load_look

    return load_look(path, files=False)


def changed_since(look: SceneSpec | None, named: str) -> list[str]:
    """A line to say where a look has other words than its bake, which is what is shown; none where it has not.

    Parameters
    ----------
    look : SceneSpec, optional
        As `named_look` gives it.
    named : str
        Its file.
    """
    from skinbake.io.manifest import changed_keys, read_manifest

    keys = changed_keys(look, read_manifest(look.output.dir), look.output.dir) if look else []
    told = f"warning  {named}: its bake is of another {', '.join(keys)}; bake it again to see what it says now"
    return [told] if keys else []


def lit(look: SceneSpec) -> SceneSpec:
    """The look, refused where it has no lights: for verbs that have nothing to do then.

    Raises
    ------
    InputError
    """
    from skinbake.errors import InputError

    if not look.lights:
        raise InputError("lights: expected at least one, got none; a look with only `relight` is for `bake`")
    return look


def quiet_option(command: Command) -> Command:
    """`--quiet` and `--verbose` as one keyword, `verbosity` (0, 1, 2)."""

    def keep(context: click.Context, _: click.Parameter, quiet: bool) -> None:
        context.meta[_QUIET] = quiet

    def level(context: click.Context, _: click.Parameter, verbose: bool) -> int:
        if verbose and context.meta[_QUIET]:
            raise click.UsageError("expected --quiet or --verbose, got both")
        return 0 if context.meta[_QUIET] else 2 if verbose else 1

    command = click.option("--verbose", "verbosity", is_flag=True, callback=level, help="Say more.")(command)
    return click.option(
        "--quiet", is_flag=True, is_eager=True, expose_value=False, callback=keep, help="Only say what went wrong."
    )(command)
