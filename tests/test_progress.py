"""A wait is shown as a bar on a terminal, as lines anywhere else, and not at all to the quiet."""

from __future__ import annotations

import io
import sys
import time

import pytest

from skinbake import progress
from skinbake.progress import Progress, counted, in_words, time_left


class Stream(io.StringIO):
    """What a command writes to: a terminal, or not."""

    encoding = "utf-8"

    def __init__(self, terminal=False):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.fixture
def stderr(monkeypatch):
    """A stream in place of stderr, and a hundred times the pace."""
    monkeypatch.setattr(progress, "SHORT_S", 0.01)
    monkeypatch.setattr(progress, "LINE_S", 0.05)
    monkeypatch.setattr(progress, "DRAW_S", 0.005)
    monkeypatch.delenv("TERM", raising=False)

    def put(terminal=False):
        monkeypatch.setattr(sys, "stderr", Stream(terminal))
        return sys.stderr

    return put


def wait_for(stream, text):
    """Until something was written, ten seconds at most."""
    end = time.monotonic() + 10
    while text not in stream.getvalue() and time.monotonic() < end:
        time.sleep(0.002)
    assert text in stream.getvalue()


def test_lengths_of_time_in_words():
    """Seconds, then minutes."""
    assert [in_words(s) for s in (0.2, 31, 60, 240)] == ["1 s", "31 s", "60 s", "4 min"]
    assert [time_left(s) for s in (0.2, 31, 600)] == ["nearly done", "about 31 s left", "about 10 min left"]


def test_a_line_now_and_then_without_a_terminal(stderr):
    """With stage, share and time left; no control character; lines of the command stand whole."""
    said = stderr()
    shown = Progress()
    with shown.task("baking", parts={"tracing": 500.0, "writing": 500.0}), shown.task("tracing"):
        shown.note("key, 1 of 2")
        wait_for(said, "  ... tracing: key, 1 of 2: 0%, about 17 min left\n")
        shown.line("  a stage")
    assert "  a stage\n" in said.getvalue()
    assert "\x1b" not in said.getvalue()
    assert "\r" not in said.getvalue()


def test_a_bar_on_a_terminal_that_leaves_only_the_lines(stderr):
    """It is drawn in place, in the terminal's width, and is gone at the end."""
    said = stderr(terminal=True)
    shown = Progress()
    with shown.task("counting sheep of a very long name" * 9, total=4) as task:
        task.done = 3.0
        wait_for(said, "75%")
        shown.line("a line")
    text = said.getvalue()
    assert "━━━━━━━━━━━━━━━━━━──────" in text
    assert text.endswith(("\r\x1b[K", "a line\n"))
    left = [piece for piece in text.replace("\x1b[K", "").split("\r") if piece.endswith("\n")]
    assert left == ["a line\n"]
    assert max(map(len, text.replace("\x1b[K", "\r").split("\r"))) < 80


def test_an_ascii_terminal_gets_a_bar_of_its_letters(stderr):
    """No escape of an unknown letter."""
    said = stderr(terminal=True)
    said.encoding = "ascii"
    with Progress().task("counting", total=2) as task:
        task.done = 1
        wait_for(said, "############------------  50%")


def test_the_quiet_and_the_quick_see_nothing(stderr, monkeypatch):
    """Neither with --quiet, nor where it is over at once."""
    said = stderr(terminal=True)
    shown = Progress(shown=False)
    with shown.task("baking", 1.0):
        shown.line("a line")
        time.sleep(0.05)
    monkeypatch.setattr(progress, "SHORT_S", 9.0)
    with Progress().task("baking", 1.0):
        time.sleep(0.05)
    assert said.getvalue() == ""


def test_the_bar_never_goes_back_and_learns_from_the_parts(monkeypatch):
    """Parts that take twice as long as expected double what is left; what nobody has foreseen is taken off."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    shown = Progress(shown=False)
    with shown.task("baking", parts={"a": 10.0, "b": 30.0}):
        with shown.task("a") as part:
            assert part.seconds == 10.0
            now[0] += 5
            assert shown._state(now[0]) == ("a", 5 / 40, 35.0)
            with shown.task("of unknown length"):
                assert shown._state(now[0]) == ("of unknown length", None, None)
            with shown.task("compiling", apart=True):
                now[0] += 100
                assert shown._state(now[0])[2] is None
            now[0] += 15
        words, share, left = shown._state(now[0])
        assert (words, left) == ("baking", pytest.approx(30 * (20 + 4) / (10 + 4)))
        assert share == pytest.approx(20 / (20 + left))
        with shown.task("b") as part:
            now[0] += 10_000
            assert shown._state(now[0]) == ("b", progress.LATE, 0.0)
            assert progress._known(progress.LATE, 0.0, 10_020.0) == " 97%, longer than expected: 167 min so far"


def test_progress_within_progress_has_one_bar(stderr):
    """A bake within a measurement: its lines stand above the bar of the measurement."""
    said = stderr(terminal=True)
    with counted("measuring", 2) as step, Progress().task("baking"):
        wait_for(said, "measuring")
        step("first: 2 s", 1)
        Progress().line("a stage")
    assert "baking" not in said.getvalue()
    assert "\r\x1b[K[ 50%] first: 2 s\n" in said.getvalue()
    assert "a stage\n" in said.getvalue()


def test_nothing_is_drawn_once_the_process_stops(stderr):
    """What Ctrl-C says is the last line."""
    said = stderr(terminal=True)
    shown = Progress()
    with shown.task("counting", total=2):
        wait_for(said, "counting")
        shown._freeze()
        before = said.getvalue()
        time.sleep(0.05)
        assert said.getvalue() == before
