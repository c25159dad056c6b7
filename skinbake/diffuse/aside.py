"""Where large results stand until they are asked for again: in memory, unless somebody has another place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.diffuse_map import Lobe
from skinbake.numerics import Zeros


class Aside(NamedTuple):
    """How results are put aside.

    Attributes
    ----------
    lobe : callable
        Takes a lobe that is made and gives it as it is read again: its pixels rounded as they are stored, perhaps.
    array : callable
        Takes an array and gives the same values.
    zeros : callable
        Takes a shape and a type and gives an array of zeros, to be filled, that is put aside from the beginning.
    rest : callable
        Frees the memory of what was read again of all that was put aside.
    on_disk : bool
        Whether it stands in no memory.
    """

    lobe: Callable[[Lobe], Lobe]
    array: Callable[[NDArray[Any]], NDArray[Any]]
    zeros: Zeros
    rest: Callable[[], None]
    on_disk: bool


IN_MEMORY = Aside(lambda lobe: lobe, lambda array: array, np.zeros, lambda: None, False)
