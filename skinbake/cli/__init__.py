"""Command line: one module a verb, imported only when that verb runs."""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress
from typing import NoReturn

from skinbake import interrupt


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a verb; every expected failure ends as a message and an exit code, never as a traceback."""
    _open_closed_streams()
    interrupt.install()  # before anything is imported that takes time
    code = run(arguments)
    interrupt.finish()
    _leave(code)


def _open_closed_streams() -> None:
    """Have a standard stream that was closed lead nowhere: the next file that is opened would take its number.

    What libraries say on stderr would then be written into a result.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def _leave(code: int) -> NoReturn:
    """End the process without taking it apart: kernels and libraries, object by object, took 0.7 s of a bake."""
    atexit._run_exitfuncs()  # what was left for the end, as of `multiprocessing`; there is no public name
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # whoever read it has gone, or it is closed
            stream.flush()
    os._exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run a verb and give its exit code."""
    from skinbake.cli.verbs import run_verb

    return run_verb(arguments)
