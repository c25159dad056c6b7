"""SceneData: what a look's files hold, read."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_texels import SkyTexels, sky_texels
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec


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
    _sky_texels: dict[tuple[object, ...], SkyTexels] = field(default_factory=dict, repr=False, compare=False)

    def lit_by(self, environments: Mapping[str, NDArray[np.float32]]) -> SceneData:
        """The same skin under other skies, with the occluder that is there."""
        ready: Future[Occluder] = Future()
        ready.set_result(self.occluder)
        return replace(self, environments=environments, building=ready)

    @cached_property
    def occluder(self) -> Occluder:
        """What rays meet, one for the whole bake."""
        return self.building.result() if self.building else Occluder(self.mesh)

    def sky_texels(self, texture: TextureSpec) -> SkyTexels:
        """Texels by which skies are planned and seen, the same ones whenever they are asked for: who asks first traces.

        A scene that is this one under other skies, or with its maps put aside, has them too.
        """
        of = texture.size, texture.gutter, texture.udim
        if of not in self._sky_texels:
            self._sky_texels[of] = sky_texels(self.mesh, self.occluder, *of)
        return self._sky_texels[of]
