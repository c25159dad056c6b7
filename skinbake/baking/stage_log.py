"""Seconds of each stage, and what the terminal and a batch are told of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from skinbake.errors import printable
from skinbake.pipeline import Stage

SHORT_S, TELL_S = 2.0, 20.0  # a wait that nobody need be told of; between two lines about a longer one
OnEvent = Callable[[dict[str, Any]], None]


def nobody(_: object) -> None:
    """Listens to nothing."""


def in_words(seconds: float) -> str:
    """A rough length of time."""
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{max(seconds, 1):.0f} s"


class StageLog:
    """What is known of a bake's stages while it runs.

    Parameters
    ----------
    verbosity : int
        0 tells nothing on stderr, 1 a line a stage, 2 more.
    on_event : callable
        Told when a stage begins and when it has ended.

    Attributes
    ----------
    seconds : dict of stage name to float
        Of each stage alone, without those that ran inside it.
    reused : dict of stage name to bool
        Whether the stage's result was there already.
    """

    def __init__(self, verbosity: int = 0, on_event: OnEvent = nobody) -> None:
        self.verbosity, self.on_event = verbosity, on_event
        self.seconds: dict[str, float] = {}
        self.reused: dict[str, bool] = {}
        self._inner = [0.0]  # seconds of the stages inside each one that runs

    @contextmanager
    def timed(self, stage: Stage[Any, Any]) -> Iterator[None]:
        """Take the time of a stage."""
        with self.measured(stage.name, lambda: stage.reused):
            yield

    @contextmanager
    def measured(self, name: str, reused: Callable[[], bool] = lambda: False) -> Iterator[None]:
        """Take the time of a block, without that of those inside it, and say it."""
        self.on_event({"event": "stage", "stage": name})
        start = time.perf_counter()
        self._inner.append(0.0)
        try:
            yield
        finally:
            whole = time.perf_counter() - start
            seconds = whole - self._inner.pop()
            self._inner[-1] += whole
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        self.reused[name] = reused()
        self.on_event({"event": "stage end", "stage": name, "seconds": seconds, "reused": self.reused[name]})
        self.say(f"  {name:<12}" + ("as it was" if self.reused[name] else f"{seconds:6.2f} s"))

    def telling_of_compiling(self) -> AbstractContextManager[None]:
        """Show on stderr, unless all is quiet, when kernels are compiled within the block."""
        from skinbake.baking.compile_notice import compile_notice

        return compile_notice() if self.verbosity else nullcontext()

    @contextmanager
    def waiting(self, what: str, seconds: float) -> Iterator[Callable[[], None]]:
        """Show a wait of more than a moment: a bar where there is a terminal, else a line and now and then another.

        Parameters
        ----------
        what : str
            What is done, for the person who waits.
        seconds : float
            That it takes, about.
        """
        if self.verbosity < 1 or seconds < SHORT_S:
            yield lambda: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        console = Console(file=sys.stderr, highlight=False, soft_wrap=True)
        expected, start, told = in_words(seconds), time.monotonic(), 0.0
        columns = TextColumn("  {task.description}"), BarColumn(bar_width=28), TimeElapsedColumn()
        bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self.say(f"  {what}: takes about {expected}")
        with bar:
            task = bar.add_task(what, total=seconds)

            def tick() -> None:
                """Show that it goes on."""
                nonlocal told
                past = time.monotonic() - start
                bar.update(task, completed=min(past, 0.99 * seconds))
                if not console.is_terminal and past - told > TELL_S:
                    told = past
                    self.say(f"    {in_words(past)} of about {expected}")

            yield tick

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr, if `verbosity` is `level` or more."""
        if self.verbosity >= level:
            from rich.console import Console

            Console(file=sys.stderr, highlight=False, soft_wrap=True).print(printable(text), markup=False)
