"""Where large results stand until they are asked for again: in memory, unless somebody has another place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import NDArray

from skinbake.diffuse.diffuse_map import Lobe


class Aside(NamedTuple):
    """How results are put aside.

    Attributes
    ----------
    lobe : callable
        Takes a lobe that is made and gives it as it is read again: its pixels rounded as they are stored, perhaps.
    array : callable
        Takes an array and gives the same values.
    rest : callable
        Frees the memory of what was read again of all that was put aside.
    on_disk : bool
        Whether it stands in no memory.
    """

    lobe: Callable[[Lobe], Lobe]
    array: Callable[[NDArray[Any]], NDArray[Any]]
    rest: Callable[[], None]
    on_disk: bool


IN_MEMORY = Aside(lambda lobe: lobe, lambda array: array, lambda: None, False)
