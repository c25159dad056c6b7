"""Installs packages with pip, and shows meanwhile which; `make` runs it before anything but Python is there.

`python -m skinbake.install REQUIREMENT ...`: exit code is pip's, whose own words are shown where it fails.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import deque
from collections.abc import Iterable, Sequence

from skinbake import interrupt
from skinbake.progress import Progress, Task

LAST_LINES = 30  # of pip, where it fails
_PACKAGE = re.compile(r"(?:Collecting|Downloading|Using cached) ([A-Za-z0-9._]+(?:-[A-Za-z]\w*)*)")


def follow(lines: Iterable[str], task: Task) -> list[str]:
    """Show where pip is by what it says, and give its last lines."""
    found: dict[str, None] = {}
    last: deque[str] = deque(maxlen=LAST_LINES)
    for line in lines:
        last.append(line)
        if package := _PACKAGE.match(line.strip()):
            found[package[1]] = None
            task.note = f"{package[1]}, {len(found)} so far"
        elif line.strip().startswith(("Installing build", "Getting requirements", "Preparing", "Building")):
            task.note = "what builds them" if not found else task.note
        elif line.startswith("Installing collected packages:"):
            task.note = f"unpacking {line.count(',') + 1} packages"
    return list(last)


def install(arguments: Sequence[str]) -> int:
    """Run `pip install`; its exit code."""
    command = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "--progress-bar=off", *arguments]
    with (
        Progress().task("installing packages") as task,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process,
        interrupt.undone_at_stop(process.kill),
    ):
        assert process.stdout is not None
        last = follow(process.stdout, task)
        code = process.wait()
    if code:
        print("".join(last), end="", file=sys.stderr)
    return code


if __name__ == "__main__":
    interrupt.install()
    done = install(sys.argv[1:])
    interrupt.finish()
    sys.exit(done)
