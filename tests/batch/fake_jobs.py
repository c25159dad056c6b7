"""Jobs that do what a payload says, for tests of who runs them: importable by the processes that do."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

from skinbake.errors import InputError


class Fatal:
    """Kills the process that pickles it: as its result is sent."""

    def __reduce__(self):
        os.kill(os.getpid(), signal.SIGKILL)


def work(payload: dict[str, Any], tell) -> dict[str, Any]:
    """`do`: done, fail, raise, die (once, while `mark` is missing), kill, die giving (its result).

    `log` gathers who ran what, and when.
    """
    tell({"event": "stage", "stage": "irradiance"})
    note(payload, "begin")
    time.sleep(payload.get("seconds", 0.0))
    do = payload.get("do", "done")
    if do == "fail":
        return {"status": "failed", "error": "no such mesh"}
    if do == "raise":
        raise InputError("no such mesh")
    if do == "die" and not Path(payload["mark"]).exists():
        Path(payload["mark"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if do == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    note(payload, "end")
    if do == "die giving":
        return {"status": "done", "value": Fatal()}
    return {"status": "done", "error": None, "value": payload.get("value"), "threads": os.environ["NUMBA_NUM_THREADS"]}


def note(payload: dict[str, Any], what: str) -> None:
    if "log" in payload:
        with open(payload["log"], "a") as file:
            file.write(f"{what} {payload.get('value')} {os.getpid()}\n")
