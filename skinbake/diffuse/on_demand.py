"""A large result that is made when it is first asked for, and again if it is asked for after it was released."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class OnDemand(Generic[T]):
    """What `make` gives, held from the first `get` until `release`.

    Parameters
    ----------
    make : callable
        Gives the same result each time.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._held: tuple[T] | None = None

    def get(self) -> T:
        """The result, made now unless it is held."""
        if self._held is None:
            self._held = (self._make(),)
        return self._held[0]

    def release(self) -> None:
        """Free the memory of the result."""
        self._held = None
