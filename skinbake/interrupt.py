"""Ctrl-C, SIGTERM, a closed terminal (SIGHUP): the process ends within two seconds and leaves nothing half-made.

Python raises KeyboardInterrupt in the main thread only, and only between two of its own steps: never while a library
compiles, traces rays or writes a file, and where it is raised, a library may take it for a fault of its own. Here the
main thread is stopped where it stands, and a thread that does nothing else ends the process: its children, its
temporary files and locks, a line on stderr, the exit code. Nothing that has its name by then is half-written, since
files are renamed to it when they are whole.

Nothing heavy is imported, so that `install` can be the first thing that a process does.
"""

from __future__ import annotations

import _thread
import os
import select
import signal
import sys
import time
from contextlib import contextmanager, suppress

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType
    from typing import Any, NoReturn

STOPPED = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}  # exit codes, as shells have them
SAVING_S = 1.2  # that a block of `saving` has to end by itself
CHILDREN_S = (0.5, 0.3)  # that children have to end by themselves, then to be gone once killed
STEP_S = 0.01

_undo: dict[object, Callable[[], object]] = {}  # what removes a temporary file or a lock that is there now
_saving = 0  # blocks that KeyboardInterrupt may end
_starting = 0  # children that are being started
_asked = False  # a signal was heard that ends the process
_stopping = False
_finished = False


def install(say: bool = True, signals: tuple[signal.Signals, ...] = tuple(STOPPED)) -> None:
    """From now on these signals end this process; to be called by its main thread, once.

    A signal that is ignored, as in what a shell has put into the background, stays so.

    Parameters
    ----------
    say : bool
        Whether the person at the terminal is told.
    signals : tuple of Signals
    """
    heard, rung = os.pipe()
    os.set_blocking(rung, False)
    taken = [number for number in signals if signal.getsignal(number) != signal.SIG_IGN]
    for number in taken:
        signal.signal(number, _stand_still)
    signal.set_wakeup_fd(rung, warn_on_full_buffer=False)
    _thread.start_new_thread(_watch, (heard, taken, say))


def finish() -> None:
    """The exit code is decided: from now on Ctrl-C changes nothing. Does not come back if one came before."""
    global _finished
    stand_still_if_stopping()
    _finished = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as the interpreter ends, it gives other handlers up
    _hurry()


def stand_still_if_stopping() -> None:
    """Do not come back once the process is about to end: what is begun now would be left half-made."""
    while _stopping or _asked:
        time.sleep(60)


@contextmanager
def undone_at_stop(undo: Callable[[], object]) -> Iterator[None]:
    """Have `undo` called if the process is stopped within the block.

    Parameters
    ----------
    undo : callable
        Called on another thread, while this one stands still: it must not wait for it. May raise OSError.
    """
    stand_still_if_stopping()
    token = object()
    _undo[token] = undo
    try:
        yield
    finally:
        stand_still_if_stopping()
        del _undo[token]


@contextmanager
def saving() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt in the block, which then has `SAVING_S` seconds to save what it has."""
    global _saving
    _saving += 1
    try:
        yield
    finally:
        _saving -= 1


@contextmanager
def starting_children() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach, since this one ends them; a stop waits until they are there."""
    global _starting
    _start_tracker()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # what they inherit
    _starting += 1
    try:
        yield
    finally:
        _starting -= 1
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        stand_still_if_stopping()


def _start_tracker() -> None:
    """Have the process that `multiprocessing` starts for itself there already, and quiet.

    Starting it, `multiprocessing` lets this thread hear Ctrl-C again. At its end it warns of what it cleans up.
    """
    from multiprocessing import resource_tracker

    sys.warnoptions.append("ignore:resource_tracker")  # which it inherits
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.pop()


def remove_tree(folder: str) -> None:
    """Remove a folder and what is in it, as far as that goes."""
    for here, folders, files in os.walk(folder, topdown=False):
        for name in files:
            with suppress(OSError):
                os.unlink(os.path.join(here, name))
        for name in folders:
            with suppress(OSError):
                os.rmdir(os.path.join(here, name))
    with suppress(OSError):
        os.rmdir(folder)


def _stand_still(number: int, frame: FrameType | None) -> None:
    """What the main thread does about a signal: the other thread has heard of it as well."""
    if _finished or _starting:
        return
    if _saving and number == signal.SIGINT:
        raise KeyboardInterrupt
    while True:
        time.sleep(60)


def _watch(heard: int, taken: list[signal.Signals], say: bool) -> None:
    """Wait for the first of the signals, and end the process."""
    global _asked
    while True:
        number = os.read(heard, 1)[0]
        if number not in taken or _finished:
            continue
        if number == signal.SIGINT and _saving:
            _wait(SAVING_S, lambda: _finished)
        _asked = not _finished
        _wait(SAVING_S, lambda: not _starting)
        if not _finished:
            _stop(STOPPED[signal.Signals(number)], say)


def _stop(code: int, say: bool) -> NoReturn:
    """End children, remove what is unfinished, say so, and end."""
    global _stopping
    _stopping = True
    with suppress(Exception):  # whatever it meets, the process ends
        _end_children()
    for undo in list(_undo.values()):
        with suppress(Exception):
            undo()
    with suppress(Exception):
        _say(say)
    _hurry()
    os._exit(code)


def _end_children() -> None:
    """End the processes that `multiprocessing` has started, and see them gone."""
    if "multiprocessing.process" not in sys.modules:
        return
    children: list[Any] = sys.modules["multiprocessing.process"].active_children()
    for end, seconds in zip(("terminate", "kill"), CHILDREN_S, strict=True):
        for child in children:
            with suppress(OSError, ValueError, AttributeError):
                getattr(child, end)()
        _wait(seconds, lambda: not any(child.is_alive() for child in children))


def _hurry() -> None:
    """Give no thread less time than the others, where that is allowed: a process is gone when the last of them is.

    Mesa's shader cache has one of the lowest priority, for which a busy machine finds no time for seconds.
    """
    with suppress(OSError):
        for thread in os.listdir("/proc/self/task"):
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, int(thread), os.getpriority(os.PRIO_PROCESS, 0))


def _say(say: bool) -> None:
    """A line on stderr, unless whoever reads it does not; a cursor that a bar has hidden is shown."""
    terminal = os.isatty(2)
    text = ("\x1b[?25h\r\x1b[K" if terminal else "") + ("stopped\n" if say else "")
    if text and select.select([], [2], [], 0.1)[1]:
        os.write(2, text.encode())


def _wait(seconds: float, until: Callable[[], bool]) -> None:
    """Wait, at most so long, until something is so."""
    end = time.monotonic() + seconds
    while not until() and time.monotonic() < end:
        time.sleep(STEP_S)
