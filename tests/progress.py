"""A line every ten seconds that says where a run of the tests is."""

from __future__ import annotations

import os
import threading
import time

import pytest

SECONDS = 10.0


class Progress:
    """Counts tests as they end and tells of them on the terminal, also while a test captures what is printed.

    Parameters
    ----------
    seconds : float
        Between two lines.
    """

    def __init__(self, seconds: float = SECONDS) -> None:
        self.seconds = seconds
        self.begun = time.monotonic()
        self.total, self.done, self.running = 0, 0, ""
        self._out = os.dup(1)  # pytest redirects descriptor 1 while a test runs
        self._ended = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)

    def line(self) -> str:
        """How far the run is, and at which test."""
        took = time.monotonic() - self.begun
        share = self.done / self.total if self.total else 0.0
        return f"[{share:4.0%}] {self.done} of {self.total} tests, {took:.0f} s: {self.running}"

    def _tell(self) -> None:
        while not self._ended.wait(self.seconds):
            os.write(self._out, f"\n{self.line()}\n".encode())

    def pytest_collection_finish(self, session):
        """All tests are known: begin to tell."""
        self._begin(len(session.items))

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids):
        """The same where other processes run them."""
        self._begin(len(ids))

    def _begin(self, total: int) -> None:
        self.total = total
        if total and not self._teller.is_alive():
            self._teller.start()

    def pytest_runtest_logstart(self, nodeid):
        """A test begins."""
        self.running = nodeid

    def pytest_runtest_logfinish(self):
        """A test has ended."""
        self.done += 1

    def pytest_sessionfinish(self):
        """No line is written below pytest's own last lines."""
        self._ended.set()
