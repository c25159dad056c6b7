"""Progress of a batch: which looks are at which stage, and a line for each that has ended."""

from __future__ import annotations

import time
from collections.abc import Collection
from contextlib import ExitStack
from statistics import fmean
from types import TracebackType
from typing import Any

from rich.console import Console

from skinbake.baking.stage_log import WORDS as STAGES
from skinbake.progress import Progress, time_left

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
    quicker : collection of str
        Looks that take the blurs of another one, and are baked in a part of its time.
    """

    def __init__(self, total: int, workers: int, console: Console, quicker: Collection[str] = ()) -> None:
        self.total, self.workers, self.quicker = total, workers, quicker
        self.ended = 0
        self._still_quicker = set(quicker)
        self.seconds: dict[bool, list[float]] = {False: [], True: []}  # of looks that have ended: quicker ones apart
        self.begun: dict[str, float] = {}
        self.running: dict[str, list[str]] = {}  # where a look is baked, then its stages, one inside the other
        self.notes: dict[str, str] = {}  # where the innermost of them is
        self.start = time.monotonic()
        self._progress, self._shown = Progress(not console.quiet), ExitStack()
        self._task: Any = None

    def __enter__(self) -> BatchProgress:
        self._task = self._shown.enter_context(self._progress.task("looks", total=self.total))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._shown.close()

    def on_event(self, name: str, event: dict[str, Any]) -> None:
        """Show one event of a job."""
        kind = event["event"]
        if kind == "begin":
            self.begun[name] = time.monotonic()
            self.running[name] = [event.get("host", "")]
            self.notes.pop(name, None)
        elif kind in ("stage", "stage end", "note") and name in self.running:
            self._move(name, event)
        elif kind == "again":
            self._progress.line(f"{name}: {event['why']}; trying again")
        elif kind == "wait":
            self._progress.line(f"{name}: {event['why']}")
        elif kind == "end":
            self._end(name, event)
        if self._task is not None:
            self._task.note = ", ".join(map(self._state, self.running))

    def _move(self, name: str, event: dict[str, Any]) -> None:
        """Note what a job has begun, or has done."""
        self.notes.pop(name, None)
        if event["event"] == "stage":
            self.running[name].append(STAGES.get(event["stage"], event["stage"]))
        elif event["event"] == "stage end":
            # Of a process that was lost, an end may still come once another one has begun
            self.running[name][1:] = self.running[name][1:-1]
        else:
            self.notes[name] = event["text"]

    def _state(self, name: str) -> str:
        """Where a job is, in words."""
        at = f"{name} {self.running[name][-1]}".strip()
        return f"{at}: {self.notes[name]}" if name in self.notes else at

    def _end(self, name: str, event: dict[str, Any]) -> None:
        """Show that a job has ended, and how."""
        self.ended += 1
        self.running.pop(name, None)
        self.notes.pop(name, None)
        if name in self.begun:
            self.seconds[name in self.quicker].append(time.monotonic() - self.begun[name])
        self._still_quicker.discard(name)
        left = self._left_s()
        if self._task is not None and left is not None:  # in seconds: looks are not all as slow
            self._task.done = time.monotonic() - self.start
            self._task.total = self._task.done + left
        text = f"[{self.ended:>{len(str(self.total))}}/{self.total}] {name:<28} {WORDS[event['status']]}"
        if name in self.begun:
            text += f", {time.monotonic() - self.begun[name]:.1f} s"
        if event["status"] not in ("failed", "skipped"):
            text += f"  {event.get('note', '')}".rstrip()
        elif event.get("error"):
            text += f": {event['error'].splitlines()[0]}"
        if left:
            text += f"  ({time_left(left)})"
        self._progress.line(text)

    def _left_s(self) -> float | None:
        """Seconds left, if the looks to come are as slow as those of their kind so far; None before one has ended."""
        quicker = len(self._still_quicker)
        coming = {False: self.total - self.ended - quicker, True: quicker}
        if not all(self.seconds[kind] or not count for kind, count in coming.items()):
            return None
        taken = sum(map(sum, self.seconds.values()))
        left = sum(count * fmean(self.seconds[kind]) for kind, count in coming.items() if count)
        return left * (time.monotonic() - self.start) / taken if left else 0.0  # several looks at a time
