"""The bake that a look asks for, in a process of its own that may be ended at any moment and keeps its kernels else."""

from __future__ import annotations

import threading
from typing import Any

from skinbake.baking.pace import whole_seconds
from skinbake.baking.stage_log import WORDS
from skinbake.batch.job import BakeJob, bake_job
from skinbake.batch.process_pool import WorkerProcess
from skinbake.io.cache import DEFAULT_LIMIT_BYTES
from skinbake.io.code_digest import package_digest
from skinbake.progress import Progress
from skinbake.scene.spec import SceneSpec


class FinalBake:
    """Bakes one look at a time into its folder.

    Parameters
    ----------
    progress : Progress
        Shows how far it is.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._worker: WorkerProcess | None = None
        self._shown: Any = None
        self._task: Any = None

    def start(self, spec: SceneSpec) -> None:
        """Begin; an unfinished bake is given up."""
        self.give_up()
        if self._worker is None:
            self._worker = WorkerProcess()
        job = BakeJob(spec, False, True, None, DEFAULT_LIMIT_BYTES, package_digest(), "restart watch")
        self._worker.start("look", 0, bake_job, job)
        self._shown = self._progress.task("baking as asked", whole_seconds(spec))
        self._task = self._shown.__enter__()

    def poll(self) -> dict[str, Any] | None:
        """What `bake_job` gives, once; None while nothing is there. A process that has ended is a failure."""
        worker = self._worker
        while worker is not None and worker.name and worker.connection.poll():
            try:
                kind, value = worker.connection.recv()
            except (EOFError, OSError):
                kind, value = "died", worker.last_words()
                self._worker = None
            if kind == "event":
                self._task.note = value.get("text") or WORDS.get(value.get("stage", ""), "")
                continue
            worker.name = ""
            self._hide()
            return dict(value) if kind == "result" else {"status": "failed", "error": value}
        return None

    def give_up(self) -> None:
        """End the process if it is at work, without waiting for it: what it has not finished, the next bake will."""
        self._hide()
        if self._worker is not None and self._worker.name:
            threading.Thread(target=self._worker.end, daemon=True).start()
            self._worker = None

    def close(self) -> None:
        """End the process, whatever it does."""
        self._hide()
        if self._worker is not None:
            self._worker.end()
            self._worker = None

    def _hide(self) -> None:
        if self._shown is not None:
            self._shown.__exit__(None, None, None)
            self._shown = None
