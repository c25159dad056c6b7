"""AtlasRaster: which point of the skin each texel shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NO_FACE = -1


class ShownFaces(NamedTuple):
    """Which point of the skin each texel shows, or each of n places, as the kernels take it.

    Attributes
    ----------
    face_index : ndarray of shape (H, W) or (n,), int32
        NO_FACE where nothing is shown.
    barycentric : ndarray of shape (H, W, 2) or (n, 2), float32
        Weights of corners 1 and 2.
    """

    face_index: NDArray[np.int32]
    barycentric: NDArray[np.float32]


@dataclass(frozen=True)
class AtlasRaster:
    """Address of each texel of one texture tile on the mesh. Row 0 is the top row (v = 1); u grows right, v grows up.

    A texel is one of three: **covered** (`coverage` > 0: its square touches a chart), **gutter** (`coverage` 0 but
    `face_index` set: the closest chart point, evaluated like any texel but without weight in any sum), or empty.

    Attributes
    ----------
    tile : int
        UDIM number; 1001 for a single texture, which spans u, v in [0, 1].
    face_index : ndarray of shape (H, W), int32
        NO_FACE where empty.
    barycentric : ndarray of shape (H, W, 2), float32
        Weights of corners 1 and 2; corner 0 has 1 - b1 - b2. All three lie in [0, 1].
    coverage : ndarray of shape (H, W), float32
        Share of the texel's square that charts cover.
    area_mm2 : ndarray of shape (H, W), float32
        Skin area inside the texel's square: the weight of the texel in surface integrals. Sums to the mesh's area.
    """

    tile: int
    face_index: NDArray[np.int32]
    barycentric: NDArray[np.float32]
    coverage: NDArray[np.float32]
    area_mm2: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.face_index.shape

    @property
    def shown(self) -> ShownFaces:
        """The address alone."""
        return ShownFaces(self.face_index, self.barycentric)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Texels that charts touch, the ones with weight in sums, (H, W)."""
        return self.coverage > 0

    @property
    def addressed(self) -> NDArray[np.bool_]:
        """Texels that show a chart point, covered or gutter, (H, W)."""
        return self.face_index != NO_FACE


Atlas = tuple[AtlasRaster, ...]
