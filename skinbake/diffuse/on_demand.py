"""A large result that is made when it is first asked for, and again if it is asked for after it was released."""

from __future__ import annotations

from collections.abc import Callable
from inspect import ismethod
from typing import Generic, TypeVar
from weakref import WeakMethod

T = TypeVar("T")


class OnDemand(Generic[T]):
    """What `make` gives, held from the first `get` until `release`.

    Parameters
    ----------
    make : callable
        Gives the same result each time. A method is held weakly: its object holds this one, and a ring would keep
        them both, with all that they hold, until the collector comes round.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make: Callable[[], Callable[[], T] | None] = WeakMethod(make) if ismethod(make) else lambda: make
        self._held: tuple[T] | None = None

    def get(self) -> T:
        """The result, made now unless it is held."""
        if self._held is None:
            make = self._make()
            assert make is not None  # whoever asks has the object
            self._held = (make(),)
        return self._held[0]

    def release(self) -> None:
        """Free the memory of the result."""
        self._held = None
