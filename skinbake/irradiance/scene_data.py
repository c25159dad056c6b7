"""SceneData: what a look's files hold, read."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh


@dataclass(frozen=True)
class SceneData:
    """What a look's files hold, read.

    Attributes
    ----------
    mesh : SkinMesh
    maps : SkinMaps
    environments : mapping of light name to ndarray of shape (h, w, 3), linear radiance
    building : Future of Occluder, optional
        Of the mesh, where somebody has begun to make one.
    notes : tuple of str
        What is used of the files, where that is not plain.
    warnings : tuple of str
        What is probably not meant, though it can be used.
    """

    mesh: SkinMesh
    maps: SkinMaps
    environments: Mapping[str, NDArray[np.float32]]
    building: Future[Occluder] | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def lit_by(self, environments: Mapping[str, NDArray[np.float32]]) -> SceneData:
        """The same skin under other skies, with the occluder that is there."""
        ready: Future[Occluder] = Future()
        ready.set_result(self.occluder)
        return replace(self, environments=environments, building=ready)

    @cached_property
    def occluder(self) -> Occluder:
        """What rays meet, one for the whole bake."""
        return self.building.result() if self.building else Occluder(self.mesh)
