"""Workers of a Dask cluster that run what we run: the others are given no job."""

from __future__ import annotations

import platform
from importlib import metadata
from typing import Any

WHAT_COUNTS = ("skinbake", "Python", "numba", "numpy")


def versions() -> dict[str, str]:
    """What must be the same on every machine for the same bytes, by name; our own code by its digest."""
    from skinbake.io.code_digest import package_digest

    libraries = {name: metadata.version(name) for name in ("numba", "numpy")}
    return {"skinbake": package_digest(), "Python": platform.python_version(), **libraries}


class DaskWorkers:
    """What is known of a cluster's workers. Each is asked for its versions once, by a task of its own.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._ours = versions()
        self._asked: dict[str, Any] = {}  # future by address
        self.unfit: dict[str, str] = {}  # why, by address
        self._fit: set[str] = set()

    def look(self) -> dict[str, int]:
        """Threads of each worker that is there and fits, by address; asks those that are new."""
        there = self._client.nthreads()
        for address in there.keys() - self._asked.keys():
            key = f"versions-{address}-{id(self)}"
            self._asked[address] = self._client.submit(versions, workers=[address], key=key, pure=False)
        for address, future in list(self._asked.items()):
            if address not in there:  # a worker that is gone never answers
                future.cancel()
                del self._asked[address]
            elif future.done() and address not in self._fit and address not in self.unfit:
                self._judge(address, future)
        return {address: threads for address, threads in there.items() if address in self._fit}

    def _judge(self, address: str, future: Any) -> None:
        """Take a worker's answer."""
        try:
            theirs = future.result()
            other = [name for name in WHAT_COUNTS if theirs.get(name) != self._ours[name]]
        except Exception:  # one so old that it does not know the question
            other, theirs = ["skinbake"], {}
        if not other:
            self._fit.add(address)
            return
        told = [
            "other skinbake code" if name == "skinbake" else f"{name} {theirs.get(name)}, here {self._ours[name]}"
            for name in other
        ]
        self.unfit[address] = f"left out, it runs {' and '.join(told)}; update it"
