"""Chromium without a window, on the processor, spoken to through a pipe: what a page says and draws."""

from __future__ import annotations

import itertools
import json
import os
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-first-run",
    "--disable-extensions",
    "--window-size=900,700",
    "--allow-file-access-from-files",  # a test may look into frames
    "--remote-debugging-pipe",
)
_PATIENCE_S = 240.0


class Browser:
    """One page of a browser of its own; a context manager.

    Parameters
    ----------
    folder : Path
        For the browser's own files.

    Attributes
    ----------
    problems : list of str
        Whatever the page has written to its console, and its uncaught errors.
    """

    def __init__(self, folder: Path) -> None:
        program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        if program is None:
            pytest.skip("Chromium is not installed (make test installs it where it may; else: apt install chromium)")
        self.problems: list[str] = []
        self._numbers, self._left = itertools.count(1), b""
        theirs_in, self._to = os.pipe()
        self._from, theirs_out = os.pipe()
        script = f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}'  # it listens on 3 and answers on 4
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", program, *_FLAGS, f"--user-data-dir={folder}"],
            pass_fds=(theirs_in, theirs_out), start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._session: str | None = None
        try:
            target = self._call("Target.createTarget", url="about:blank")["targetId"]
            self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Runtime", "Log", "Page"):
                self._call(f"{domain}.enable")
        except BaseException:
            self.close()
            raise

    def open(self, page: Path) -> None:
        """Go to a file."""
        self._call("Page.navigate", url=page.as_uri())

    def run(self, body: str) -> Any:
        """What the body of an async function gives, run in the page; `until(condition)` waits there."""
        until = "const until = async (c) => { while (!c()) await new Promise((r) => setTimeout(r, 30)); };"
        answer = self._call(
            "Runtime.evaluate",
            expression=f"(async () => {{ {until} {body} }})()",
            awaitPromise=True,
            returnByValue=True,
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command; events that come before it are looked at."""
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session and not method.startswith("Target."):
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + _PATIENCE_S
        while True:
            while b"\0" not in self._left:
                left = max(0.0, end - time.monotonic())
                assert select.select([self._from], [], [], left)[0], f"no answer to {method}"
                part = os.read(self._from, 1 << 20)
                assert part, f"the browser ended during {method}"
                self._left += part
            text, _, self._left = self._left.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        about = event.get("params", {})
        if event.get("method") == "Runtime.consoleAPICalled":
            self.problems.append(" ".join(str(each.get("value", each)) for each in about["args"]))
        elif event.get("method") == "Runtime.exceptionThrown":
            self.problems.append(str(about["exceptionDetails"]))
        elif event.get("method") == "Log.entryAdded":
            self.problems.append(about["entry"]["text"])

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the browser."""
        os.killpg(self._process.pid, signal.SIGKILL)  # with the processes that it has begun
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
