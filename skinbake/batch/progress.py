"""Progress of a batch: bars and stages on a terminal, a line a job anywhere else."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from skinbake.errors import printable

WORDS = {"done": "done", "fresh": "as it was", "missed": "tolerance missed", "failed": "FAILED", "skipped": "skipped"}


class BatchProgress:
    """Shows on stderr what jobs report.

    Parameters
    ----------
    total : int
        Jobs of the batch.
    workers : int
        Jobs that run at a time.
    console : Console
    """

    def __init__(self, total: int, workers: int, console: Console) -> None:
        self.total, self.workers, self.console = total, workers, console
        self.ended = 0
        self.begun: dict[str, float] = {}
        self.start = time.monotonic()
        self.bars: Progress | None = None
        self.rows: dict[str, TaskID] = {}
        if console.is_terminal and not console.quiet:
            columns = (
                SpinnerColumn(),
                TextColumn("{task.description}"),
                BarColumn(bar_width=24),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("{task.fields[note]}"),
            )
            self.bars = Progress(*columns, console=console, transient=True)

    def __enter__(self) -> BatchProgress:
        if self.bars:
            self.bars.start()
            self.whole = self.bars.add_task("looks", total=self.total, note="")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self.bars:
            self.bars.stop()

    def on_event(self, name: str, event: dict[str, Any]) -> None:
        """Show one event of a job."""
        kind = event["event"]
        if kind == "begin":
            self.begun[name] = time.monotonic()
            if self.bars:
                self.rows[name] = self.bars.add_task(f"  {name}", total=None, note=event.get("host", ""))
        elif kind == "stage" and self.bars and name in self.rows:
            self.bars.update(self.rows[name], note=event["stage"])
        elif kind == "again":
            self._print(f"{name}: {event['why']}; trying again")
        elif kind == "wait":
            self._print(f"{name}: {event['why']}")
        elif kind == "end":
            self._end(name, event)

    def _end(self, name: str, event: dict[str, Any]) -> None:
        """Show that a job has ended, and how."""
        self.ended += 1
        if self.bars:
            if name in self.rows:
                self.bars.remove_task(self.rows.pop(name))
            self.bars.update(self.whole, completed=self.ended, note=self._left())
        text = f"[{self.ended:>{len(str(self.total))}}/{self.total}] {name:<28} {WORDS[event['status']]}"
        if name in self.begun:
            text += f", {time.monotonic() - self.begun[name]:.1f} s"
        if event["status"] not in ("failed", "skipped"):
            text += f"  {event.get('note', '')}".rstrip()
        elif event.get("error"):
            text += f": {event['error'].splitlines()[0]}"
        if not self.bars and self._left():
            text += f"  ({self._left()})"
        self._print(text)

    def _print(self, text: str) -> None:
        """Show a line, above the bars where there are some."""
        self.console.print(printable(text), markup=False, soft_wrap=True)

    def _left(self) -> str:
        """Time left in words, if the looks to come are as slow as those so far."""
        if self.ended == self.total:
            return ""
        seconds = (time.monotonic() - self.start) / self.ended * (self.total - self.ended)
        return f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"
