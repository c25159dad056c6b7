"""Seconds of each stage, and what the terminal and a batch are told of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from skinbake.pipeline import Stage

OnEvent = Callable[[dict[str, Any]], None]


def nobody(_: object) -> None:
    """Listens to nothing."""


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

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr, if `verbosity` is `level` or more."""
        if self.verbosity >= level:
            from rich.console import Console

            Console(file=sys.stderr, highlight=False, soft_wrap=True).print(text, markup=False)
