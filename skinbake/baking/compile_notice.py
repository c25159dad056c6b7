"""Tells the person at the terminal that time goes into compiling kernels, which happens once."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from skinbake.kernels.watch_compiling import watch_compiling

if TYPE_CHECKING:  # rich is slow to import, and most bakes compile nothing
    from rich.console import Console
    from rich.progress import Progress

TEXT = "compiling kernels, once ..."
_EVERY_S = 5.0


@contextmanager
def compile_notice() -> Iterator[None]:
    """Show on stderr that kernels are compiled: a bar on a terminal, a line every five seconds anywhere else."""
    notice = _CompileNotice()
    with watch_compiling(notice.on_kernel):
        try:
            yield
        finally:
            notice.close()


class _CompileNotice:
    """What is shown while kernels are compiled; nothing before the first one."""

    def __init__(self) -> None:
        self._console: Console | None = None
        self._bar: Progress | None = None
        self._count, self._seconds = 0, 0.0
        self._begun = self._said = -_EVERY_S

    def on_kernel(self, name: str, begun: bool) -> None:
        """Show that a kernel is being compiled, or take the bar away."""
        now = time.monotonic()
        if begun:
            self._begun = now
            console = self._console or self._open()
            if self._bar:
                self._bar.update(self._bar.task_ids[0], visible=True, count=self._count)
            elif now - self._said >= _EVERY_S:
                self._said = now
                console.print(f"  {TEXT}" + (f" {self._count} so far" if self._count else ""))
        else:
            self._count += 1
            self._seconds += now - self._begun
            if self._bar:
                self._bar.update(self._bar.task_ids[0], visible=False)

    def close(self) -> None:
        """Take the bar away for good, and say what it took."""
        if self._bar:
            self._bar.stop()
        if self._console:
            kernels = "1 kernel" if self._count == 1 else f"{self._count} kernels"
            self._console.print(f"  compiled {kernels} in {self._seconds:.1f} s; kept for the next time")

    def _open(self) -> Console:
        """The console, and the bar where that is a terminal."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._console = Console(file=sys.stderr, highlight=False, soft_wrap=True)
        if self._console.is_terminal:
            columns = (
                TextColumn(f"  {TEXT}"),
                BarColumn(bar_width=24),  # nobody knows how many there will be: it pulses
                TextColumn("{task.fields[count]}"),
                TimeElapsedColumn(),
            )
            self._bar = Progress(*columns, console=self._console, transient=True, redirect_stdout=False)
            self._bar.add_task("", total=None, count=0)
            self._bar.start()
        return self._console
