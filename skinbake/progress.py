"""What somebody who waits sees on stderr: a bar at the foot of a terminal, a line every five seconds anywhere else.

The one place where waiting is shown. Standard library only: `make` shows with it how packages are installed.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TextIO

from skinbake.errors import printable
from skinbake.interrupt import undone_at_stop

SHORT_S = 0.5  # a wait that no bar is worth
LINE_S = 5.0  # between two lines where there is no terminal
DRAW_S = 0.1  # between two drawings of the bar
CELLS = 24
LATE = 0.97  # as far as a bar goes of a task that takes longer than expected


_on_screen: list[Progress] = []  # the one whose bar it is: others within it write above that bar


def in_words(seconds: float) -> str:
    """A rough length of time."""
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{max(seconds, 1):.0f} s"


def time_left(seconds: float) -> str:
    """A rough time that is left, in words."""
    return "nearly done" if seconds < 1 else f"about {in_words(seconds)} left"


@dataclass(eq=False)
class Task:
    """Something that is waited for.

    Attributes
    ----------
    name : str
        In words.
    seconds : float, optional
        That it takes, about.
    total, done : float
        What is counted, and how much of it there is; nothing is counted where `total` is 0.
    note : str
        Where it is.
    parts : dict of str to float
        Seconds that each of its parts takes, about, by the name of their tasks.
    apart : bool
        Time that none of the tasks about it has taken.
    """

    name: str
    seconds: float | None = None
    total: float = 0.0
    done: float = 0.0
    note: str = ""
    parts: dict[str, float] = field(default_factory=dict)
    apart: bool = False
    begun: float = field(default_factory=lambda: time.monotonic())
    away: float = 0.0  # seconds of tasks within that are `apart`
    past: float = 0.0  # seconds that were expected of the parts that have ended
    taken: float = 0.0  # ... and that they took
    shown: float = 0.0  # share that the bar has come to

    def spent(self, now: float) -> float:
        """Seconds that it has taken until `now`."""
        return max(now - self.begun - self.away, 0.0)

    def share(self, now: float) -> float | None:
        """How much of it is done, 0 ... 1; None where nobody knows: of what is counted, until the first is done."""
        if self.total:
            return min(self.done / self.total, 1.0) if self.done else None
        return min(self.spent(now) / self.seconds, LATE) if self.seconds else None

    def left(self, now: float) -> float | None:
        """Seconds that are left, about."""
        if self.total and self.done:
            return self.spent(now) / self.done * max(self.total - self.done, 0.0)
        return max(self.seconds - self.spent(now), 0.0) if self.seconds else None

    @property
    def pace(self) -> float:
        """How much longer parts take than was expected: known the better, the more of them have ended."""
        whole = self.past + sum(self.parts.values())
        return (self.taken + 0.1 * whole) / (self.past + 0.1 * whole) if whole else 1.0


class Progress:
    """The bar, or the lines, of one command.

    Parameters
    ----------
    shown : bool
        Nothing is shown otherwise.
    """

    def __init__(self, shown: bool = True) -> None:
        self.shown = shown
        self._tasks: list[Task] = []
        self._lock = threading.RLock()
        self._drawn = self._frozen = False
        self._said = 0.0

    def line(self, text: str) -> None:
        """A line that stays, above the bar."""
        if self.shown:
            screen = _on_screen[0] if _on_screen else self
            with screen._lock:
                screen._write(text + "\n")
                screen._said = time.monotonic()

    @contextmanager
    def task(
        self,
        name: str,
        seconds: float | None = None,
        total: float = 0.0,
        parts: Mapping[str, float] | None = None,
        apart: bool = False,
    ) -> Iterator[Task]:
        """Show a task while the block runs; its `done` and `note` may be changed meanwhile.

        Parameters
        ----------
        name : str
            In words; the same as in `parts` of a task about it, whose `seconds` are then expected.
        seconds, total, parts, apart
            As of `Task`.
        """
        with ExitStack() as stack:
            with self._lock:
                about = next((task for task in self._tasks if name in task.parts), None)
                if about is not None and seconds is None:
                    seconds = about.parts[name] * about.pace
                new = Task(name, seconds, total, parts=dict(parts or {}), apart=apart or about is not None)
                first = not self._tasks
                self._tasks.append(new)
            if first and self.shown and not _on_screen:
                stack.enter_context(self._ticking())
            try:
                yield new
            finally:
                with self._lock:
                    self._end(new, about)

    def note(self, text: str) -> None:
        """Say where the innermost task is."""
        with self._lock:
            if self._tasks:
                self._tasks[-1].note = text

    def _end(self, task: Task, about: Task | None) -> None:
        """Take a task away, and its time from the tasks that it is no part of."""
        now = time.monotonic()
        index = self._tasks.index(task)
        del self._tasks[index]
        if task.apart:
            for outer in self._tasks[:index]:
                if outer is not about:
                    outer.away += task.spent(now)
        if about is not None:
            about.past += about.parts[task.name]
            about.taken += task.spent(now)
            about.parts[task.name] = 0.0

    @contextmanager
    def _ticking(self) -> Iterator[None]:
        """Draw, or say, now and then."""
        over = threading.Event()
        self._said = time.monotonic()
        ticker = threading.Thread(target=self._tick, args=(over, self._said), name="progress", daemon=True)
        _on_screen.append(self)
        try:
            with undone_at_stop(self._freeze):
                ticker.start()
                yield
        finally:
            over.set()
            _on_screen.remove(self)
            with self._lock:
                self._write("")

    def _tick(self, over: threading.Event, begun: float) -> None:
        terminal = _is_terminal(sys.stderr)
        while not over.wait(DRAW_S):
            now = time.monotonic()
            with self._lock:
                if over.is_set() or not self._tasks:
                    continue
                if terminal and now - begun > SHORT_S:
                    self._draw(now)
                elif not terminal and now - self._said >= LINE_S:
                    self._said = now
                    words, share, left = self._state(now)
                    known = _known(share, left, self._tasks[0].spent(now)).strip()
                    self._write(f"  ... {words}: {known}\n")

    def _state(self, now: float) -> tuple[str, float | None, float | None]:
        """What is done in words, how much of the whole is done, and the seconds that are left where that is known."""
        outer, inner = self._tasks[0], self._tasks[-1]
        words = f"{inner.name}: {inner.note}" if inner.note else inner.name
        if not outer.parts:
            return words, outer.share(now), outer.left(now)
        within = [task for task in self._tasks[1:] if task.name in outer.parts or not task.apart]
        foreseen = inner is outer or inner in within
        at = now if foreseen else now - inner.spent(now)  # for the others, time stands still meanwhile
        begun = {task.name for task in within}
        if any(task.left(at) is None for task in within):  # a part of which nobody knows how long it takes
            return words, None, None
        left = sum(seconds for name, seconds in outer.parts.items() if name not in begun) * outer.pace
        left += sum(task.left(at) or 0.0 for task in within)
        spent = outer.spent(at)
        outer.shown = max(outer.shown, min(spent / max(spent + left, 1e-9), LATE))
        return words, outer.shown, left if foreseen else None

    def _draw(self, now: float) -> None:
        """The bar, in the terminal's last line."""
        words, share, left = self._state(now)
        full, empty = ("━", "─") if _writes(sys.stderr, "━─") else ("#", "-")
        if share is None:  # nobody knows how long: a piece that wanders
            at = int(8 * now) % CELLS
            bar = "".join(full if (cell - at) % CELLS < 4 else empty for cell in range(CELLS))
        else:
            bar = full * round(share * CELLS) + empty * (CELLS - round(share * CELLS))
        known = f"{bar} {_known(share, left, self._tasks[0].spent(now))}"
        room = shutil.get_terminal_size().columns - len(known) - 6
        if room < 8:
            known, room = "", room + len(known)
        words = words if len(words) <= room else words[: max(room - 3, 0)] + "..."
        self._write(f"  {words:<{min(room, 36)}}  {known}", stays=False)

    def _write(self, text: str, stays: bool = True) -> None:
        """Write in place of the bar, if there is one."""
        if self._frozen or not self.shown:
            return
        erase = "\r\x1b[K" if self._drawn or not stays else ""
        if erase or text:
            try:
                sys.stderr.write(erase + printable(text))
                sys.stderr.flush()
            except (OSError, ValueError):  # nobody reads it any more
                self._frozen = True
        self._drawn = not stays

    def _freeze(self) -> None:
        """Draw no more: the process is about to end, and says so in a line of its own."""
        self._frozen = True
        if self._lock.acquire(timeout=DRAW_S):  # what is being written by now
            self._lock.release()


def _known(share: float | None, left: float | None, spent: float) -> str:
    """What is known of the time, in words."""
    if share is None:
        return f"{in_words(spent)} so far"
    if left == 0 and share < 1:  # what it was expected to take is over, and it is not
        return f"{share:4.0%}, longer than expected: {in_words(spent)} so far"
    return f"{share:4.0%}" + (f", {time_left(left)}" if left is not None else "")


def _is_terminal(stream: TextIO) -> bool:
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def _writes(stream: TextIO, letters: str) -> bool:
    try:
        letters.encode(stream.encoding or "ascii")
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def counted(name: str, total: float, shown: bool = True) -> Iterator[Callable[[str, float], None]]:
    """Function to call after each step of a measurement, with a line on it that stays and how much of `total` it was.

    Parameters
    ----------
    name : str
        In words.
    total : float
    shown : bool
    """
    progress = Progress(shown)
    with progress.task(name, total=total) as task:

        def step(line: str, amount: float) -> None:
            """Show one step."""
            task.done += amount
            progress.line(f"[{task.done / total:4.0%}] {line}")

        yield step
