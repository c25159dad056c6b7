"""Tells the person at the terminal that time goes into compiling kernels, which happens once."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from skinbake.kernels.watch_compiling import watch_compiling
from skinbake.progress import Progress

TEXT = "compiling kernels, once"


@contextmanager
def compile_notice(progress: Progress) -> Iterator[CompileNotice]:
    """Show that kernels are compiled, and say in the end what it took; nothing where none is."""
    notice = CompileNotice(progress)
    with watch_compiling(notice.on_kernel):
        try:
            yield notice
        finally:
            notice.close()


class CompileNotice:
    """What is shown while kernels are compiled.

    Attributes
    ----------
    seconds : float
        That compiling has taken so far.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._shown: list[ExitStack] = []
        self._count, self.seconds, self._begun = 0, 0.0, 0.0

    def on_kernel(self, name: str, begun: bool) -> None:
        """Show that a kernel is being compiled, or that it is there."""
        if begun:
            self._begun = time.monotonic()
            shown = ExitStack()
            task = shown.enter_context(self._progress.task(TEXT, apart=True))
            task.note = f"{self._count} so far" if self._count else ""
            self._shown.append(shown)
        else:
            self._count += 1
            self.seconds += time.monotonic() - self._begun
            self._shown.pop().close()

    def close(self) -> None:
        """Say what it took."""
        if self._count:
            kernels = "1 kernel" if self._count == 1 else f"{self._count} kernels"
            self._progress.line(f"  compiled {kernels} in {self.seconds:.1f} s; kept for the next time")
