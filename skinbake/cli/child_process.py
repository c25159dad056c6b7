"""A process of its own for one task after another, so that the peak memory is that of the task alone."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from skinbake.errors import InputError, MachineError, SkinbakeError
from skinbake.interrupt import install, starting_children


class Child:
    """Fresh process that runs one task after another; a context manager."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with starting_children():
            self._process.start()
        theirs.close()

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()  # the child sees the end and leaves; one in the middle of a bake is ended
        self._process.join(0.5)
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()

    def __call__(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Run `task(*arguments)` in the process, and give its result.

        Raises
        ------
        SkinbakeError
            What the task raised.
        MachineError
            The process died.
        """
        try:
            self._ours.send((task, arguments))
            result = self._ours.recv()
        except (EOFError, BrokenPipeError):
            self._process.join()
            raise MachineError(
                f"a measured bake died with exit code {self._process.exitcode} (out of memory?)"
            ) from None
        if isinstance(result, SkinbakeError):
            raise result
        return result


def in_child(task: Callable[..., Any], *arguments: Any) -> Any:
    """Run one task in a process of its own."""
    with Child() as child:
        return child(task, *arguments)


def _serve(connection: Connection) -> None:
    """Loop of the process: take a task, send its result or its error, until the other end closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    install(say=False, signals=(signal.SIGTERM, signal.SIGHUP))
    while True:
        try:
            task, arguments = connection.recv()
        except EOFError:
            return
        try:
            result = task(*arguments)
        except MachineError as error:
            result = MachineError(str(error))
        except SkinbakeError as error:
            result = InputError(str(error))
        except MemoryError:
            result = MachineError("out of memory")
        except Exception as error:
            result = MachineError(f"{type(error).__name__}: {error}")
        try:
            connection.send(result)
        except OSError:  # nobody waits for it any more
            return
