"""Who is told that kernels are being compiled; without numba, so that telling costs nothing where nothing is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Watcher = Callable[[str, bool], None]

_watchers: list[Watcher] = []


@contextmanager
def watch_compiling(watcher: Watcher) -> Iterator[None]:
    """Have a function called about each kernel that is compiled meanwhile, on the thread that compiles.

    Those that a kernel calls are part of it. Kernels whose machine code is on the disk are not compiled.

    Parameters
    ----------
    watcher : callable
        Takes the kernel's name, and True when compiling begins, False when it has ended.
    """
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def tell_watchers(name: str, begun: bool) -> None:
    """Tell everybody of a kernel whose compiling begins or has ended."""
    for watcher in tuple(_watchers):
        watcher(name, begun)
