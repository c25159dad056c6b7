"""Results of stages in memory, by the key of what they depend on: for one process that bakes a look again and again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping

from skinbake.io.cache import GIB, Entry

LIMIT_BYTES = GIB


class MemoryCache:
    """A `Cache` without files; what was asked for longest ago is dropped once it holds more than its limit.

    Parameters
    ----------
    limit_bytes : int
    """

    def __init__(self, limit_bytes: int = LIMIT_BYTES) -> None:
        self.limit_bytes, self.bytes = limit_bytes, 0
        self._entries: OrderedDict[str, Entry] = OrderedDict()

    def get_many(
        self, keys: Mapping[str, str], make: Callable[[tuple[str, ...]], Mapping[str, Entry]]
    ) -> dict[str, Entry]:
        """Entries by name, copies of their own; those not there are made by `make(names)`.

        Parameters
        ----------
        keys : mapping of name to key
        make : callable
        """
        found = {name: self._entries[key] for name, key in keys.items() if key in self._entries}
        missing = tuple(name for name in keys if name not in found)
        for name in found:
            self._entries.move_to_end(keys[name])
        for name, entry in (make(missing) if missing else {}).items():
            found[name] = self._put(keys[name], entry)
        self._drop()
        return {name: {part: values.copy() for part, values in found[name].items()} for name in keys}

    def _put(self, key: str, entry: Entry) -> Entry:
        kept = {part: values.copy() for part, values in entry.items()}
        self.bytes += sum(values.nbytes for values in kept.values())
        self._entries[key] = kept
        return kept

    def _drop(self) -> None:
        while self.bytes > self.limit_bytes and self._entries:
            _, entry = self._entries.popitem(last=False)
            self.bytes -= sum(values.nbytes for values in entry.values())
