"""Bakes that can be killed: a process that has everything imported and loaded, and forks a child for each command.

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
from pathlib import Path

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: 16, gutter: 2}
skin: {model: gaussians, variance_mm2: [0.05, 1.0], weight_rgb: [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]}
lights:
  - {name: key, type: directional, direction: [-0.6, 0, -0.8], irradiance: [1, 2, 3]}
  - {name: lamp, type: point, position_mm: [10, 20, 60], intensity: [900, 800, 700]}
diffusion: {method: surface, tolerance: 1.0, probes: 50}
terms: {energy_conservation: off, transmission: off, interreflection: off}
output: {dir: out}
"""


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


def load() -> None:
    """Bake something else in memory, so that no child has to load kernels.

    Children, too, stamp plots, which nobody's cache keeps, and judge light that comes later by few lights. No file is
    written: OpenEXR's threads, which a child would wait for, begin with the first.
    """
    import skinbake
    import skinbake.baking.bake_look
    import skinbake.cli.preview
    from skinbake.baking import kept_fit, session
    from skinbake.io import profile_plot
    from skinbake.io.mesh import write_obj
    from skinbake.relight import transfer
    from tests.plots import stamp_fit_plot
    from tests.relight.conftest import few_lights
    from tests.shapes import relief

    profile_plot.write_fit_plot = stamp_fit_plot
    kept_fit.user_cache = lambda: None  # or a user's bakes would find the stamps there
    transfer.unseen_lights = lambda seed: few_lights(seed)[2:]  # no sky, which takes longest
    with tempfile.TemporaryDirectory() as folder:
        write_obj(Path(folder, "mesh.obj"), relief(segments=4))
        Path(folder, "look.yaml").write_text(LOOK)
        skinbake.bake(skinbake.load_look(Path(folder, "look.yaml")))
    session._LAST.clear()


def serve() -> None:
    """Answer commands until stdin ends."""
    load()
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
