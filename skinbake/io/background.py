"""Writing files while the next stage computes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType


class Background:
    """One thread that does what it is given, one thing after the other; a context manager.

    What fails is raised by the next `do` or `finish`, in the thread that calls it, and what was to follow is left
    undone: a file that vouches for others never appears without them. When the block ends in an error, what has not
    begun is left undone, too.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "background")
        self._given: list[Future[None]] = []
        self._fault: BaseException | None = None
        self._stopped = False

    @property
    def busy(self) -> bool:
        """Whether something was given since the last `finish`."""
        return bool(self._given)

    def do(self, work: Callable[[], object]) -> None:
        """Have `work` done after all that was given before.

        Raises
        ------
        As `finish`, where something has failed already.
        """
        if self._fault is not None:
            raise self._fault
        self._given.append(self._pool.submit(self._do, work))

    def _do(self, work: Callable[[], object]) -> None:
        """Do one piece of work, unless one before it has failed."""
        if self._fault is None and not self._stopped:
            try:
                work()
            except BaseException as fault:
                self._fault = fault

    def finish(self) -> None:
        """Wait until all is done.

        Raises
        ------
        Whatever the first work that failed has raised.
        """
        while self._given:
            self._given.pop(0).result()
        if self._fault is not None:
            raise self._fault

    def __enter__(self) -> Background:
        return self

    def __exit__(self, kind: type | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self._stopped = kind is not None
        self._pool.shutdown(wait=True)
        if kind is None:
            self.finish()
