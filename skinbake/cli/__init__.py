"""Command line: one module a verb, imported only when that verb runs."""

from __future__ import annotations

import sys

from skinbake import interrupt


def main(arguments: list[str] | None = None) -> None:
    """Run a verb; every expected failure ends as a message and an exit code, never as a traceback."""
    interrupt.install()  # before anything is imported that takes time
    code = run(arguments)
    interrupt.finish()
    sys.exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run a verb and give its exit code."""
    from skinbake.cli.verbs import run_verb

    return run_verb(arguments)
