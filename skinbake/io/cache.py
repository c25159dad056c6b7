"""Cache of stage results by the key of what they read, for every look and every process that names the same folder.

An entry appears whole or not at all and is read-only afterwards; a damaged one counts as missing. The oldest read are
dropped when the folder has grown past its limit.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, SkinbakeError
from skinbake.io.atomic import atomic_write
from skinbake.io.lock import Lock

Entry = dict[str, NDArray[Any]]
FOLDER = "SKINBAKE_CACHE"
GIB = 2**30
DEFAULT_LIMIT_BYTES = 8 * GIB
SHARE = 1 / 8  # of the room that is left: others write there, too
ORPHANED_S = 3600.0  # a temporary file this old has no writer any more
CONTENTS = "skinbake.contents"  # beside the arrays of an entry: what they are
_NAME = re.compile(r"[0-9a-f]{62}\.npz")
_TEMPORARY = re.compile(r"\.[0-9a-f]{62}\.\d+\.part\.npz")


@dataclass
class Cache:
    """A folder of entries.

    Attributes
    ----------
    folder : Path
    limit_bytes : int
    say : callable, optional
        Told what is waited for.
    hits, misses : int
        Entries found, and made, through this object.
    """

    folder: Path
    limit_bytes: int = DEFAULT_LIMIT_BYTES
    say: Callable[[str], None] | None = None
    hits: int = field(default=0, init=False)
    misses: int = field(default=0, init=False)
    _may_write: float = field(default=-1.0, init=False)  # bytes, before the folder is looked through again

    def get_many(
        self, keys: Mapping[str, str], make: Callable[[tuple[str, ...]], Mapping[str, Entry]]
    ) -> dict[str, Entry]:
        """Entries by name; what is missing is made once, though several processes ask for it at a time.

        What another process is making is waited for last, while holding nothing: nobody waits in a circle.

        Parameters
        ----------
        keys : mapping of name to key
        make : callable
            Given the names that are missing, their entries.
        """
        found = {name: entry for name, key in keys.items() if (entry := self.read(key)) is not None}
        self.hits += len(found)
        todo = [name for name in keys if name not in found]
        wait = False
        while todo:
            locks = self._lock({name: keys[name] for name in (todo[:1] if wait else todo)}, wait)
            try:
                arrived = {name: entry for name in locks if (entry := self.read(keys[name])) is not None}
                self.hits += len(arrived)
                missing = tuple(name for name in locks if name not in arrived)
                if missing:
                    made = make(missing)
                    self.misses += len(missing)
                    for name in missing:
                        self.write(keys[name], made[name])
                    arrived |= {name: made[name] for name in missing}
                found |= arrived
            finally:
                for lock in locks.values():
                    if lock:
                        lock.release()
            todo = [name for name in todo if name not in found]
            wait = True
        return {name: found[name] for name in keys}

    def _lock(self, keys: Mapping[str, str], wait: bool) -> dict[str, Lock | None]:
        """Locks of the keys that nobody else is making, by name; None where the folder cannot be written to."""
        locks: dict[str, Lock | None] = {}
        for name, key in keys.items():
            lock = Lock(self.folder / "locks" / key)
            try:
                ours = lock.acquire()
                if not ours and wait:
                    if self.say:
                        self.say(f"{name}: waiting for {lock.holder()}, which is making it")
                    ours = lock.acquire(wait=True)
                if ours:
                    locks[name] = lock
            except (SkinbakeError, OSError):
                if lock.path.is_symlink():
                    for other in filter(None, locks.values()):
                        other.release()
                    raise
                locks[name] = None  # a cache that cannot be written to keeps nobody from working
        return locks

    def read(self, key: str) -> Entry | None:
        """Arrays of an entry, or None; reading makes it young again.

        An entry that is damaged, or holds other arrays than were written under its key, is removed and counts as
        missing. A folder that can only be read is a cache all the same.
        """
        path = self.path_of(key)
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)  # a link leads to what may be no entry
        except OSError:
            return None
        try:
            # Each array has a checksum: damage is seen, as one of many errors
            with open(descriptor, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                contents = json.loads(bytes(file[CONTENTS]))
                entry = {name: file[name] for name in file.files if name != CONTENTS}
            whole = contents == _contents(key, entry)
        except MemoryError:
            return None
        except Exception:
            whole = False
        with suppress(OSError):  # somebody else's
            os.utime(path) if whole else path.unlink()
        return entry if whole else None

    def write(self, key: str, entry: Entry) -> None:
        """Store an entry. A cache that cannot be written to is no reason to fail: its content can be made again."""
        contents = np.frombuffer(json.dumps(_contents(key, entry)).encode(), np.uint8)
        arrays: dict[str, Any] = entry | {CONTENTS: contents}
        with suppress(SkinbakeError, OSError), atomic_write(self.path_of(key)) as temporary:
            np.savez(temporary, **arrays)
        self._may_write -= sum(array.nbytes for array in entry.values())
        if self._may_write < 0:
            self.prune()

    def prune(self) -> None:
        """Drop the entries read longest ago, until the rest fits, and what killed writers left.

        Files of other names than a cache gives are somebody's, and stay.
        """
        entries = []
        for path in self.folder.glob("[0-9a-f][0-9a-f]/*.npz"):
            with suppress(OSError):
                status = path.stat()
                if _TEMPORARY.fullmatch(path.name):
                    if time.time() - status.st_mtime > ORPHANED_S:
                        path.unlink()
                elif _NAME.fullmatch(path.name):
                    entries.append((status.st_mtime, status.st_size, path))
        used = sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if used <= self.limit_bytes:
                break
            with suppress(OSError):
                path.unlink()
                used -= size
        self._may_write = SHARE * max(self.limit_bytes - used, 0)

    def path_of(self, key: str) -> Path:
        """Path of an entry's file."""
        return self.folder / key[:2] / f"{key[2:]}.npz"


def _contents(key: str, entry: Entry) -> dict[str, Any]:
    """Key of an entry, and shape and type of each of its arrays."""
    return {"key": key, "arrays": {name: [list(array.shape), array.dtype.str] for name, array in entry.items()}}


def cache_folder(option: str | None, default: Path | None = None) -> Path | None:
    """Folder that a command's option names, else the environment's SKINBAKE_CACHE, else `default`.

    Raises
    ------
    InputError
        It begins with ~ and somebody who has no home here.
    """
    chosen = option or os.environ.get(FOLDER)
    if not chosen:
        return default
    try:
        return Path(chosen).expanduser().absolute()
    except RuntimeError as error:
        said = "--cache" if option else FOLDER
        raise InputError(f"{said}: expected a folder, got {chosen!r}: {error}") from error
