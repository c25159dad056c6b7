"""Work in the background is done in order, and its faults are raised where they can be told."""

import threading
import time

import pytest

from skinbake.errors import MachineError
from skinbake.io.background import Background


def test_work_is_done_in_order_by_another_thread_while_the_caller_goes_on():
    """A job that waits for the caller would otherwise never end."""
    done, go = [], threading.Event()

    def first() -> None:
        assert go.wait(10)
        done.append(("first", threading.current_thread() is threading.main_thread()))

    with Background() as background:
        background.do(first)
        background.do(lambda: done.append(("second", False)))
        assert done == []
        go.set()
        background.finish()
        assert done == [("first", False), ("second", False)]
        background.do(lambda: done.append(("third", False)))
    assert len(done) == 3


def fails() -> None:
    raise MachineError("the disk is full")


def test_a_fault_is_told_to_whoever_gives_more_to_do():
    """Nobody computes for minutes what cannot be written."""

    def block() -> None:
        with Background() as background:
            background.do(fails)
            for _ in range(1000):
                time.sleep(0.01)
                background.do(lambda: None)

    begun = time.monotonic()
    with pytest.raises(MachineError, match="the disk is full"):
        block()
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize("asked", [True, False])
def test_a_fault_is_raised_at_the_finish_and_nothing_follows_it(asked):
    """As a full disk: the file that vouches for the others is not written after one of them failed."""
    done = []

    def block() -> None:
        with Background() as background:
            background.do(fails)
            background.do(lambda: done.append("vouches"))
            if asked:
                background.finish()

    with pytest.raises(MachineError, match="the disk is full"):
        block()
    assert done == []


def test_when_the_block_fails_what_has_begun_is_ended_and_the_rest_left():
    """After Ctrl-C no thread writes on, and the first error is the one that is told."""
    begun, done = threading.Event(), []

    def slow() -> None:
        begun.set()
        time.sleep(0.2)
        done.append("slow")

    def block() -> None:
        with Background() as background:
            background.do(slow)
            background.do(lambda: done.append("later"))
            assert begun.wait(10)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block()
    assert done == ["slow"]
