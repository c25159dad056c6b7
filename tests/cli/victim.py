"""Bakes that can be killed: a process that has everything imported, and forks a child for each command.

A line on stdin is a JSON object: `arguments` of skinbake, `kill_after` seconds or `die_at`, the number of the step on
the file system (fsync, rename, removal) that is never made. The answer is a line with `code` (minus the signal, if one
ended it), `seconds`, `steps` made and what was said on `stderr`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import threading
import time


def child(command: dict, counter: int, said: str) -> None:
    """Run skinbake; with every step on the file system counted, and the last one not made."""
    from skinbake.cli import run

    descriptor = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(descriptor, 2)
    os.dup2(descriptor, 1)
    steps = 0

    def counted(function):
        def step(*arguments, **named):
            nonlocal steps
            if steps == command.get("die_at"):
                os.kill(os.getpid(), signal.SIGKILL)
            steps += 1
            return function(*arguments, **named)

        return step

    for name in ("replace", "fsync", "unlink"):
        setattr(os, name, counted(getattr(os, name)))
    code = run(command["arguments"])
    os.write(counter, str(steps).encode())
    os._exit(code)


def serve() -> None:
    """Answer commands until stdin ends."""
    import skinbake.baking.bake_look
    import skinbake.cli.preview  # noqa: F401

    for line in sys.stdin:
        command = json.loads(line)
        read, write = os.pipe()
        descriptor, said = tempfile.mkstemp()  # a child may be killed before it has opened it
        os.close(descriptor)
        begun = time.monotonic()
        pid = os.fork()
        if pid == 0:
            child(command, write, said)
        os.close(write)
        if "kill_after" in command:
            timer = threading.Timer(command["kill_after"], os.kill, (pid, signal.SIGKILL))
            timer.start()
            _, status = os.waitpid(pid, 0)
            timer.cancel()
        else:
            _, status = os.waitpid(pid, 0)
        seconds = time.monotonic() - begun
        steps = os.read(read, 20).decode()
        os.close(read)
        with open(said) as file:
            stderr = file.read()
        os.unlink(said)
        code = os.waitstatus_to_exitcode(status)
        print(
            json.dumps({"code": code, "seconds": seconds, "steps": int(steps or 0), "stderr": stderr}),
            flush=True,
        )


if __name__ == "__main__":
    serve()
