"""Whether a look, or a file that it names, was saved."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from skinbake.errors import SkinbakeError
from skinbake.io.fingerprint import every_input, stamp
from skinbake.scene.spec import SceneSpec

Stamps = dict[Path, tuple[int, ...] | None]


class SavedFiles:
    """The files of a look, and how they were when they were last read.

    Parameters
    ----------
    config : path
        Of the look.
    """

    def __init__(self, config: Path | str) -> None:
        self._config = Path(config)
        self._paths: tuple[Path, ...] = (self._config,)
        self._read = self._stamps()
        self._seen = self._read

    def __len__(self) -> int:
        return len(self._paths)

    def _stamps(self) -> Stamps:
        return {path: stamp(path) for path in self._paths}

    def follow(self, spec: SceneSpec) -> None:
        """Watch the files that a look names from now on; those that are new count as read."""
        paths = [self._config, *sorted((self._config.parent / "skins").glob("*.yaml"))]  # presets beside the look
        with suppress(SkinbakeError):
            paths += every_input(spec)
        self._paths = tuple(dict.fromkeys(paths))
        now = self._stamps()
        self._read = self._seen = now | {path: self._read[path] for path in self._paths if path in self._read}

    def saved(self) -> bool:
        """Whether one has changed since the last call that said so, and was the same twice: nobody is writing it."""
        now = self._stamps()
        steady, self._seen = now == self._seen, now
        if now == self._read or not steady:
            return False
        self._read = now
        return True
