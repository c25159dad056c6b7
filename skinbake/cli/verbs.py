"""The verbs by name, and how each ends: with an exit code, and where something is wrong with a message."""

from __future__ import annotations

import gc
import importlib
import io
import os
import sys
from contextlib import suppress
from typing import Any

import click

import skinbake
from skinbake.errors import SkinbakeError, printable
from skinbake.machine import require_memory, reuse_freed

VERBS = {
    "bake": "Bake a look: irradiance, diffusion, error, preview.",
    "batch": "Bake many looks from one file.",
    "check": "Report on units, texels, UVs, memory and time before baking.",
    "compare": "Compare two images or two bakes (exit 0 same, 1 differs, 2 could not compare).",
    "diffuse": "Blur an irradiance EXR into lobes.",
    "export": "Write a bake as files that other programs read.",
    "fit": "Fit a sum of Gaussians to a skin's profile.",
    "info": "Show where a file or a bake came from.",
    "init": "Write a first look for a mesh.",
    "irradiance": "Rasterise the light arriving at each texel.",
    "preview": "Show or render what a bake left.",
    "profile": "Evaluate R(r), T(r) and totals of a skin.",
    "schema": "Print the JSON schema of a look, or the page of every key.",
    "tradeoff": "Measure time and memory against error.",
    "truth": "Measure how far a bake is from light transport in the same skin.",
    "watch": "Bake a look again whenever it is saved: a draft at once, then as asked.",
}
LIGHT = {"info", "init", "compare"}  # verbs that load little
LOADED_BYTES, LOADED_DATA = 700 * 2**20, 0.5  # of the libraries that a bake loads, and their share of data


class _Verbs(click.Group):
    """Knows every verb's name and line of help without importing it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        return importlib.import_module(f"skinbake.cli.{cmd_name}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl([(verb, VERBS[verb]) for verb in self.list_commands(ctx)])


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(skinbake.__version__, prog_name="skinbake")
def group() -> None:
    """Bake texture-space diffusion of human skin, know its error, and preview it.

    Exit codes: 0 done, 1 a comparison differs or a tolerance was missed, 2 bad input, 3 the machine failed us.
    """
    if click.get_current_context().invoked_subcommand not in LIGHT:
        require_memory(LOADED_BYTES, "loading its libraries", LOADED_DATA)


def run_verb(arguments: list[str] | None = None) -> int:
    """Run a verb and give its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may have less letters than a name: no reason to fail
            stream.reconfigure(errors="backslashreplace")
    reuse_freed()
    gc.set_threshold(500_000)  # imports make many objects that stay: looking them through ever again takes 0.5 s
    try:
        result: Any = group.main(arguments, prog_name="skinbake", standalone_mode=False)
        with suppress(BrokenPipeError):  # whoever read it has gone; the verb has done all the same
            sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.exceptions.Abort:
        print("stopped", file=sys.stderr)
        return 130
    except click.ClickException as error:
        error.show()
        return 2
    except SkinbakeError as error:
        print(f"skinbake: {printable(str(error))}", file=sys.stderr)
        return error.exit_code
    except UnicodeEncodeError as error:  # a library was given a path whose bytes are no text
        print(printable(f"skinbake: expected names in UTF-8, got {error.object!r}"), file=sys.stderr)
        return 2
    except MemoryError:
        print(
            "skinbake: out of memory; use a smaller texture.size (`skinbake check` tells what a bake needs)",
            file=sys.stderr,
        )
        return 3
    except ImportError as error:  # a library that is broken, or for which there is no memory
        told = (
            f"skinbake: a library cannot be loaded: {error}; is it installed, and is there memory for it (ulimit -v)?"
        )
        print(printable(told), file=sys.stderr)
        return 3
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        told = f"skinbake: {error.filename or _unwritten() or 'the system'}: {error.strerror or error}"
        print(printable(told), file=sys.stderr)
        return 2 if error.filename else 3


def _unwritten() -> str:
    """`stdout` where what was printed cannot be written, else nothing."""
    try:
        print(flush=True)
    except OSError:
        return "stdout"
    return ""
