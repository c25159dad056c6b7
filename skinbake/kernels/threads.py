"""Loops over threads: kernels compiled without Python's lock take parts of a range each.

Which thread takes which part is left to chance, so parts must not share sums: each writes what is its own.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from skinbake.errors import InputError

_PARTS = 4  # a thread, so that one slow part does not hold up the rest
_MOST = 4  # threads a processor, however many are asked for

_pool: ThreadPoolExecutor | None = None
_pool_size = 0


def processors() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """Threads that loops run on: NUMBA_NUM_THREADS, else one a processor.

    Raises
    ------
    InputError
        That variable of the environment is not a whole number from 1 on.
    """
    asked = os.environ.get("NUMBA_NUM_THREADS", "")
    if not asked.strip():
        return processors()
    if not asked.strip().isdecimal() or int(asked) < 1:
        raise InputError(f"NUMBA_NUM_THREADS: expected a whole number from 1 on, got {asked!r}")
    return min(int(asked), _MOST * processors())


def parallel_for(kernel: Callable[..., Any], count: int, *arguments: Any) -> None:
    """Call `kernel(first, stop, *arguments)` so that every number of 0 ... count is in one of the ranges.

    Parameters
    ----------
    kernel : callable
        Does the numbers first <= k < stop; what it writes must not depend on where the range was cut.
    count : int
        How many numbers there are; for none, the kernel is not called.
    arguments
        Passed on.
    """
    threads = thread_count()
    parts = min(count, _PARTS * threads) if threads > 1 else min(count, 1)
    on_threads(lambda k: kernel(count * k // parts, count * (k + 1) // parts, *arguments), parts)


def for_slices(work: Callable[[slice], None], count: int, step: int) -> None:
    """Do `work` on the numbers 0 ... count in parts.

    Parameters
    ----------
    work : callable
        Takes the slice of its part.
    count, step : int
        Numbers in all, and in a part.
    """
    on_threads(lambda k: work(slice(step * k, min(step * (k + 1), count))), -(-count // step))


def on_threads(work: Callable[[int], None], count: int) -> None:
    """Do `work` on each number below `count`: this thread helps, so it may be called from anywhere, also from itself.

    Raises
    ------
    Exception
        One of those that `work` has raised; what has not begun by then is left undone.
    """
    helpers = min(thread_count(), count) - 1
    if helpers <= 0:
        for k in range(count):
            work(k)
        return
    numbers = itertools.count()  # `next` is one step for Python's lock

    def take() -> None:
        try:
            while (k := next(numbers)) < count:
                work(k)
        except BaseException:
            for _ in itertools.takewhile(lambda k: k < count, numbers):
                pass
            raise

    others = [_threads(helpers).submit(take) for _ in range(helpers)]
    try:
        take()
    finally:
        for other in others:
            other.cancel()  # not begun: busy elsewhere, and all is done
        failed = [error for other in others if not other.cancelled() and (error := other.exception())]
    if failed:
        raise failed[0]


def _threads(helpers: int) -> ThreadPoolExecutor:
    """The threads that all loops share."""
    global _pool, _pool_size
    if _pool is None or _pool_size < helpers:
        # One that is given up ends by itself, after whatever still runs there
        _pool, _pool_size = ThreadPoolExecutor(helpers, "kernels"), helpers
    return _pool


def _forget() -> None:
    """A forked process has none of its parent's threads."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
