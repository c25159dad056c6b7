"""What looks baked one after another share: the cache of stages, the last mesh and its raster, a listener."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from skinbake.io.cache import Cache

T = TypeVar("T")
OnEvent = Callable[[dict[str, Any]], None]

_LAST: dict[str, tuple[str, Any]] = {}  # one of each kind: a worker's next look is often of the same head


@dataclass
class BakeSession:
    """Given to `StageRunner`; a single bake has one without a cache.

    Attributes
    ----------
    cache : Cache or None
    on_event : callable
        Told when a stage begins and when it has ended.
    keep : bool
        Whether another look may follow that has use for this one's mesh and raster.
    traced : list of str
        Lights whose irradiance was computed, neither read from a folder nor from the cache.
    """

    cache: Cache | None = None
    on_event: OnEvent = field(default=lambda event: None)
    keep: bool = True
    traced: list[str] = field(default_factory=list, init=False)

    @staticmethod
    def of(
        folder: str | None, limit_bytes: int, on_event: OnEvent = lambda event: None, keep: bool = True
    ) -> BakeSession:
        """With a cache in `folder`, if any."""
        return BakeSession(Cache(Path(folder), limit_bytes) if folder else None, on_event, keep)

    @property
    def figures(self) -> dict[str, int]:
        """How often the cache had what was asked for."""
        return {"hits": self.cache.hits, "misses": self.cache.misses} if self.cache else {"hits": 0, "misses": 0}

    def last(self, kind: str, key: str, make: Callable[[], T]) -> T:
        """The process's last result of this kind where its key fits, else a new one in its place."""
        if _LAST.get(kind, ("",))[0] != key:
            _LAST.pop(kind, None)  # let go of the old one before the new one takes memory
            made = make()
            if not self.keep:
                return made
            _LAST[kind] = (key, made)
        result: T = _LAST[kind][1]
        return result
