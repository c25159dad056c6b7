"""The one container of what each texture tile has."""

from __future__ import annotations

from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

Tiled: TypeAlias = dict[int, T]  # by tile number (1001, 1002, ...), in the order of the atlas
Tiles: TypeAlias = Tiled[NDArray[np.float32]]  # images of shape (L, h, w, 3)
