"""Seconds of each stage, and what the terminal and a batch are told of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any

from skinbake.pipeline import Stage
from skinbake.progress import Progress, Task

if TYPE_CHECKING:
    from skinbake.baking.compile_notice import CompileNotice

WORDS = {  # what is done, by the name of its stage
    "read": "reading mesh and maps",
    "raster": "finding the skin of each texel",
    "profile": "fitting Gaussians to the skin",
    "irradiance": "tracing light",
    "diffuse": "scattering light",
    "relight": "light from everywhere",
    "preview": "drawing the picture",
    "textures": "making .tx files",
    "write": "writing files",
    "export": "exporting",
}
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
        Told when a stage begins, where it is, and when it has ended.

    Attributes
    ----------
    seconds : dict of stage name to float
        Of each stage alone, without those that ran inside it.
    busy : dict of stage name to float
        ... without those of compiling either.
    parts : dict of str to float
        Seconds of what stages said that they do, by what they said.
    reused : dict of stage name to bool
        Whether the stage's result was there already.
    progress : Progress
        The bar.
    """

    def __init__(self, verbosity: int = 0, on_event: OnEvent = nobody) -> None:
        self.verbosity, self.on_event = verbosity, on_event
        self.progress = Progress(verbosity > 0)
        self.seconds: dict[str, float] = {}
        self.busy: dict[str, float] = {}
        self.reused: dict[str, bool] = {}
        self.parts: dict[str, float] = {}
        self._part: tuple[str, float] | None = None  # what is being done, and since when
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
        with self.progress.task(WORDS.get(name, name)) as task:
            try:
                yield
            finally:
                self._end_part()
                whole = time.perf_counter() - start
                seconds = whole - self._inner.pop()
                self._inner[-1] += whole
                self.busy[name] = self.busy.get(name, 0.0) + task.spent(time.monotonic())
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        self.reused[name] = reused()
        self.on_event({"event": "stage end", "stage": name, "seconds": seconds, "reused": self.reused[name]})
        self.say(f"  {WORDS.get(name, name):<30}" + ("as it was" if self.reused[name] else f"{seconds:6.2f} s"))

    def whole(self, name: str, seconds: Mapping[str, float]) -> AbstractContextManager[Task]:
        """Show the stages within the block as parts of one wait.

        Parameters
        ----------
        name : str
            In words.
        seconds : mapping of stage name to float
            That each takes, about; stages that are not expected to run are left out.
        """
        return self.progress.task(name, parts={WORDS[stage]: of for stage, of in seconds.items()})

    def telling_of_compiling(self) -> AbstractContextManager[CompileNotice]:
        """Show when kernels are compiled within the block."""
        from skinbake.baking.compile_notice import compile_notice

        return compile_notice(self.progress)

    @contextmanager
    def waiting(self, what: str, seconds: float) -> Iterator[Callable[[], None]]:
        """Show a wait of about so many seconds, `what` for in words; see `skinbake.io.waiting`."""
        with self.progress.task(what, seconds):
            yield lambda: None

    def note(self, text: str) -> None:
        """Say where a stage is: beside its bar, to who listens, and with much verbosity in a line."""
        self._end_part()
        self._part = text, time.perf_counter()
        self.progress.note(text)
        self.on_event({"event": "note", "text": text})
        self.say(f"    {text}", 2)

    def _end_part(self) -> None:
        """What was being done is done."""
        if self._part is not None:
            name, since = self._part
            self.parts[name] = self.parts.get(name, 0.0) + time.perf_counter() - since
            self._part = None

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr, if `verbosity` is `level` or more."""
        if self.verbosity >= level:
            self.progress.line(text)
