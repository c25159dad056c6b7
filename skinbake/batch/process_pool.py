"""Jobs on several processes of this machine. A job that fails, or whose process is killed, does not stop the others.

Each process has a pipe of its own, shared with nobody. The pools of `pebble` and `concurrent.futures` send jobs and
results through one pipe with a lock: a process that is killed while it holds that lock (as memory runs out, say) takes
the jobs of the others with it, after a minute's silence. Nor have they a way for a job to say how far it is.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from skinbake.errors import SkinbakeError
from skinbake.interrupt import install, starting_children
from skinbake.kernels.threads import processors
from skinbake.machine import reuse_freed

Listen = Callable[[str, Any], None]  # job's name, event
Work = Callable[[Any, Callable[[Any], None]], dict[str, Any]]  # payload, tell -> result
SAMPLE_S = 0.1
_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENIMAGEIO_THREADS")


@dataclass
class ProcessPool:
    """Processes that run jobs.

    Attributes
    ----------
    work : callable
        From a payload and a function that takes events to the result.
    workers : int
    retries : int
        How often a job is tried again after its process ended.
    listen : callable
        Takes a job's name and an event.
    peak_mib : float
        Largest resident size of all processes together, sampled; pages they share are counted in each.
    """

    work: Work
    workers: int
    retries: int
    listen: Listen
    peak_mib: float = field(default=0.0, init=False)

    def run(self, payloads: Mapping[str, Any], keep_going: bool = True) -> dict[str, dict[str, Any]]:
        """Run jobs; the result of each by name.

        `status` is "failed" where its process ended, "skipped" after a failure unless `keep_going`.
        """
        todo = [(name, self.retries) for name in payloads]
        results: dict[str, dict[str, Any]] = {}
        pool: list[WorkerProcess] = []
        with fewer_threads(self.workers):
            try:
                while todo or any(worker.name for worker in pool):
                    stop = not keep_going and any(result["status"] == "failed" for result in results.values())
                    while todo and not stop and (idle := self._idle(pool)):
                        name, tries = todo.pop(0)
                        idle.start(name, tries, self.work, payloads[name])
                        self.listen(name, {"event": "begin"})
                    if not any(worker.name for worker in pool):
                        break
                    for worker in self._ready(pool):
                        self._hear(worker, pool, todo, results)
            finally:
                for worker in pool:
                    worker.end()
        return {name: results.get(name, {"status": "skipped", "error": "an earlier job failed"}) for name in payloads}

    def _idle(self, pool: list[WorkerProcess]) -> WorkerProcess | None:
        """A worker without a job, started if there may be one more; None if all are busy."""
        for worker in pool:
            if not worker.name:
                return worker
        if len(pool) < self.workers:
            pool.append(WorkerProcess())
            return pool[-1]
        return None

    def _ready(self, pool: list[WorkerProcess]) -> list[WorkerProcess]:
        """Busy workers that have something to say, after a wait of at most `SAMPLE_S`."""
        busy = [worker for worker in pool if worker.name]
        ready = connection.wait([worker.connection for worker in busy], SAMPLE_S)
        self.peak_mib = max(self.peak_mib, sum(resident_mib(worker.process.pid) for worker in pool))
        return [worker for worker in busy if worker.connection in ready]

    def _hear(
        self,
        worker: WorkerProcess,
        pool: list[WorkerProcess],
        todo: list[tuple[str, int]],
        results: dict[str, dict[str, Any]],
    ) -> None:
        """Take one message of a worker: an event, a result, or its end."""
        name = worker.name
        try:
            kind, value = worker.connection.recv()
        except (EOFError, OSError):
            kind, value = "died", worker.last_words()
            pool.remove(worker)
        if kind == "event":
            self.listen(name, value)
            return
        worker.name = ""
        if kind in ("died", "raised") and worker.tries > 0:
            todo.insert(0, (name, worker.tries - 1))
            self.listen(name, {"event": "again", "why": value})
            return
        results[name] = value if kind == "result" else {"status": "failed", "error": value}
        self.listen(name, {"event": "end", **results[name]})


class WorkerProcess:
    """One process, a job at a time; `connection` brings ("event", value), then ("result", value) or ("raised", why)."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_serve, args=(theirs,), daemon=True)
        with starting_children():
            self.process.start()
        theirs.close()
        self.name = ""
        self.tries = 0

    def start(self, name: str, tries: int, work: Work, payload: Any) -> None:
        """Give the process a job.

        Parameters
        ----------
        name : str
        tries : int
            How often it may be tried again.
        work : callable
        payload : object
        """
        self.name, self.tries = name, tries
        with suppress(OSError):  # it is gone: heard of as the end of its connection
            self.connection.send((work, payload))

    def last_words(self) -> str:
        """Why the process ended, in words."""
        self.process.join(10)
        code = self.process.exitcode or 0
        if code < 0:
            name = signal.Signals(-code).name
            hint = "; out of memory? use fewer processes or a smaller texture.size" if name == "SIGKILL" else ""
            return f"its process was ended by {name}{hint}"
        return f"its process ended with exit code {code}"

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self.connection.close()
        if self.name:
            self.process.terminate()  # files are whole or not there at all
        self.process.join(10)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def _serve(pipe: Connection) -> None:
    """Loop of a worker process: take a job, pass its events on, send its result, until the other end closes."""
    reuse_freed()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent hears of it and ends us
    install(say=False, signals=(signal.SIGTERM, signal.SIGHUP))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            work, payload = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer: Any = "result", work(payload, lambda event: pipe.send(("event", event)))
        except SkinbakeError as error:
            answer = "raised", str(error)
        except Exception as error:  # the other jobs go on, whatever this one met
            answer = "raised", f"{type(error).__name__}: {error}"
        pipe.send(answer)


def _end_with_parent() -> None:
    """End this process when its parent has ended: it would go on holding the folder of its look."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def fewer_threads(workers: int) -> Iterator[None]:
    """Divide the machine's threads among `workers` processes, in the environment they inherit."""
    before = {name: os.environ.get(name) for name in _THREADS}
    for name, value in before.items():
        total = int(value) if value and value.isdigit() and int(value) > 0 else processors()
        os.environ[name] = str(max(1, total // workers))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def resident_mib(pid: int | None) -> float:
    """Resident size of a process, 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
    except (OSError, ValueError, IndexError):
        return 0.0
