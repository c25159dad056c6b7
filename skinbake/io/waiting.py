"""Long waits while files are read: the reader says what for and about how long, whoever has the terminal shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

Tick = Callable[[], None]  # called now and then while it lasts
Waiting = Callable[[str, float], AbstractContextManager[Tick]]  # what for, and for about how many seconds


@contextmanager
def unseen(_what: str, _seconds: float) -> Iterator[Tick]:
    """A wait that nobody is told of."""
    yield lambda: None
