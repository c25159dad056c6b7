"""What looks baked one after another share: the cache of stages, the last mesh and its raster."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from skinbake.baking.shared_blurs import BlurBase
from skinbake.baking.stage_log import OnEvent, nobody
from skinbake.io.cache import Cache

T = TypeVar("T")

_LAST: dict[str, tuple[str, Any]] = {}  # one of each kind: a worker's next look is often of the same head


@dataclass
class BakeSession:
    """A single bake has one without a cache.

    Attributes
    ----------
    cache : Cache or None
    on_event : callable
        Told when a stage begins, where it is, and when it has ended.
    keep : bool
        Whether another look may follow that has use for this one's mesh and raster.
    base : BlurBase, optional
        Of a look that takes the blurs of another one.
    traced : list of str
        Lights whose irradiance was computed, neither read from a folder nor from the cache.
    """

    cache: Cache | None = None
    on_event: OnEvent = nobody
    keep: bool = True
    base: BlurBase | None = None
    traced: list[str] = field(default_factory=list, init=False)

    @staticmethod
    def of(
        folder: str | None,
        limit_bytes: int,
        on_event: OnEvent = nobody,
        keep: bool = True,
        base: BlurBase | None = None,
    ) -> BakeSession:
        """A session with a cache.

        Parameters
        ----------
        folder : str, optional
            Of the cache; none by default.
        limit_bytes : int
            Of the cache.
        on_event, keep, base
            As the attributes.
        """
        return BakeSession(Cache(Path(folder), limit_bytes) if folder else None, on_event, keep, base)

    @property
    def figures(self) -> dict[str, int]:
        """How often the cache had what was asked for."""
        return {"hits": self.cache.hits, "misses": self.cache.misses} if self.cache else {"hits": 0, "misses": 0}

    def peek(self, kind: str, key: str) -> Any:
        """The process's last result of this kind where its key fits, else None; one of another key is let go."""
        if _LAST.get(kind, ("",))[0] != key:
            _LAST.pop(kind, None)  # before the new one takes memory
        return _LAST[kind][1] if kind in _LAST else None

    def put(self, kind: str, key: str, result: T) -> T:
        """Keep a result for the process's next look, if there may be one, and give it back.

        Parameters
        ----------
        kind : str
            One result of each kind is kept.
        key : str
        result : any
        """
        if self.keep:
            _LAST[kind] = (key, result)
        return result
