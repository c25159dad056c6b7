"""The loop of `skinbake watch`: a save, its draft, then the bake as asked; what cannot be used is told in a line."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from skinbake.baking.stage_log import StageLog
from skinbake.baking.verdict import marked, verdict
from skinbake.errors import InputError, SkinbakeError
from skinbake.interrupt import undone_at_stop
from skinbake.io.config import load_look
from skinbake.io.lock import remove_leftovers
from skinbake.io.manifest import read_manifest
from skinbake.scene.spec import SceneSpec
from skinbake.watch.draft import Draft, Drafter
from skinbake.watch.final_bake import FinalBake
from skinbake.watch.saved_files import SavedFiles

POLL_S = 0.02  # between two looks at the files
AGAIN_S = 1.0  # ... at what could not be used: a file that it names may have come


class Screen(Protocol):
    """Where pictures are shown. What begins with `ready` runs on a thread of its own, one call at a time.

    Attributes
    ----------
    separate : bool
        Whether it wants each light of a draft on its own.
    """

    separate: bool

    def ready_draft(self, draft: Draft) -> Any:
        """What `show` takes, of a draft."""

    def ready_bake(self, folder: Path) -> Any:
        """What `show` takes, of a bake's folder."""

    def show(self, ready: Any) -> str:
        """Show it; where, in words."""

    def fault(self, text: str) -> None:
        """Show that what was saved last cannot be used; empty where it can."""


class Watch:
    """One look that is watched.

    Parameters
    ----------
    config : path
    overrides : sequence of str
        As of `load_look`.
    out : path, optional
        In place of `output.dir`.
    screen : Screen
    verbosity : int
        0 says only what went wrong, 1 a line a picture.
    """

    def __init__(
        self, config: Path | str, overrides: Sequence[str], out: Path | str | None, screen: Screen, verbosity: int = 1
    ) -> None:
        self._config, self._overrides, self._out = config, overrides, out
        self._screen, self._verbosity = screen, verbosity
        self._log = StageLog(0)
        self._log.progress = self._progress = StageLog(verbosity).progress
        self._drafter = Drafter(self._log, screen.separate)
        self._final = FinalBake(self._progress)
        self._thread = ThreadPoolExecutor(1, "draft")
        self._files = SavedFiles(config)
        self._work: Future[Any] | None = None
        self._kind, self._since, self._stale = "", 0.0, False
        self._fault, self._unread, self._tried, self._looked = "", False, 0.0, 0.0
        self.spec = self._load()

    def _load(self) -> SceneSpec:
        spec = load_look(self._config, self._overrides, self._out)
        if not spec.lights:
            raise InputError(f"{self._config}: expected at least one light, got none")
        self._files.follow(spec)
        return spec

    def begin(self) -> None:
        """Show the first draft, and wait for it.

        Raises
        ------
        InputError, ConfigError, MachineError
            The look cannot be baked, or the folder not be written to.
        """
        self._say(f"watching {self._config} and {len(self._files) - 1} files that it names; Ctrl-C ends it")
        with self._progress.task("first draft"):
            self._draft()
            self._settle(first=True)

    def run(self) -> None:
        """Watch until the process is stopped."""
        while True:
            self.step()
            time.sleep(POLL_S)

    def guarded(self) -> Any:
        """A block within which Ctrl-C leaves nothing behind, and whose end ends the bake that is at work."""
        return undone_at_stop(partial(remove_leftovers, Path(self.spec.output.dir)))

    def close(self) -> None:
        """End what is at work."""
        self._final.close()
        self._thread.shutdown()

    def step(self) -> None:
        """Do what there is to do, without waiting."""
        now = time.monotonic()
        if now - self._looked < POLL_S:
            return
        self._looked = now
        if self._files.saved() or (self._unread and now - self._tried > AGAIN_S):
            self._tried = now
            self._reload()
        if self._work is not None and self._work.done():
            self._settle()
        found = self._final.poll()
        if found is not None:
            self._take(found)

    def _reload(self) -> None:
        """Read what was saved, and begin its draft."""
        try:
            self.spec = self._load()
        except SkinbakeError as error:
            self._unread = True
            self._tell_fault(str(error))
            return
        self._unread = False
        self._final.give_up()
        self._stale = self._work is not None
        if self._work is None:
            self._draft()

    def _draft(self) -> None:
        self._kind, self._since, self._stale = "draft", time.monotonic(), False
        self._work = self._thread.submit(lambda spec: self._screen.ready_draft(self._drafter.draft(spec)), self.spec)

    def _settle(self, first: bool = False) -> None:
        """Show what is ready, and begin what comes next; a fault of the first picture is raised."""
        work, kind, self._work = self._work, self._kind, None
        assert work is not None
        try:
            where = self._screen.show(work.result())
        except (SkinbakeError, OSError) as error:
            if first:
                raise
            self._tell_fault(str(error))
        else:
            self._tell_fault("")
            if kind == "draft":
                self._say(f"draft in {time.monotonic() - self._since:.1f} s: {where}")
            else:
                manifest = read_manifest(self.spec.output.dir)
                within, *_ = verdict(manifest).split("; ")
                self._say(f"as asked: {where}; {within}")
                for line in marked(manifest.get("warnings", ())):
                    self._say(line)
        if self._stale:  # it was saved again meanwhile
            self._draft()
        elif kind == "draft":
            self._final.start(self.spec)

    def _take(self, found: dict[str, Any]) -> None:
        """Show what the bake has left."""
        if found["status"] == "failed":
            self._tell_fault(str(found["error"]))
        if found["status"] != "failed" and self._work is None:
            self._kind, folder = "bake", Path(self.spec.output.dir)
            self._work = self._thread.submit(self._screen.ready_bake, folder)

    def _tell_fault(self, text: str) -> None:
        """Say a fault once, on the terminal whatever the verbosity."""
        if text and text != self._fault:
            StageLog(1).say(f"{_clock()}  {text}")
        if text != self._fault:
            self._screen.fault(text)
        self._fault = text

    def _say(self, text: str) -> None:
        if self._verbosity:
            self._progress.line(f"{_clock()}  {text}")


def _clock() -> str:
    return time.strftime("%H:%M:%S")
