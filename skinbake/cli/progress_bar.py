"""Progress of a long measurement: a bar with the time left on a terminal, a line a step anywhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from skinbake.errors import printable

Step = Callable[[str, float], None]


@contextmanager
def counted(total: float, name: str, verbosity: int) -> Iterator[Step]:
    """Function to call after each step, with a line on what was done and how much of `total` that was.

    Parameters
    ----------
    total : int
    name : str
        Name of the things counted.
    verbosity : int
        0 shows nothing.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(file=sys.stderr, quiet=verbosity == 0, highlight=False, soft_wrap=True)
    start, done = time.monotonic(), 0.0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=28),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal or verbosity == 0)
    with bar:
        task = bar.add_task(name, total=total, left="")

        def step(line: str, amount: float) -> None:
            """Show one step."""
            nonlocal done
            done += amount
            left = time_left((time.monotonic() - start) / done * (total - done))
            bar.update(task, completed=done, left=left)
            console.print(printable(f"[{100 * done / total:3.0f} %] {line}  ({left})"), markup=False)

        yield step


def time_left(seconds: float) -> str:
    """A rough time in words."""
    if seconds < 1:
        return "done"
    return f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"
