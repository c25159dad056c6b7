"""Where the arrays of a bake are: in memory, or in the files of a folder."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinbake.relight.transfer import Transfer
from skinbake.scene.maps import SkinMaps

Image = NDArray[np.float32]


class Pixels(Protocol):
    """Where the arrays of a bake are. Without a light's name they give the sum over the lights."""

    def irradiance(self, tile: int, light: str | None) -> Image:
        """Light arriving, (H, W, 3)."""

    def lobe(self, index: int, tile: int, light: str | None) -> Image:
        """A lobe as it is stored, (h, w, 3).

        Parameters
        ----------
        index : int
        tile : int
        light : str, optional
        """

    def albedo(self, tile: int) -> Image:
        """Linear albedo of the skin, (H, W, 3) or (1, 1, 3)."""

    def transfer(self) -> Transfer:
        """Textures for lights that come later.

        Raises
        ------
        InputError
            The look has no `relight`.
        """

    def maps(self) -> SkinMaps:
        """Maps of the look."""
