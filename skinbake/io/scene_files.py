"""Reading of everything that a look's files hold."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import on_charts, tiles_of
from skinbake.errors import InputError
from skinbake.io.environment import read_environments
from skinbake.io.look_maps import read_look_maps
from skinbake.io.mesh import read_look_mesh
from skinbake.io.read_maps import read_maps
from skinbake.io.repaint import painted_mesh
from skinbake.io.waiting import Waiting, unseen
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec


def read_scene(spec: SceneSpec, rays: bool = True, waiting: Waiting = unseen) -> SceneData:
    """Read mesh, maps and environments of a look.

    Parameters
    ----------
    rays : bool
        Begin to build what rays meet, on a thread that goes on while others read and rasterise.
    waiting : Waiting
        Told while UVs are made.

    Raises
    ------
    InputError
        A file is missing or unusable; the message names it, what was expected and what it holds.
    """
    with ThreadPoolExecutor(1) as pool:  # pictures are decoded while the mesh is parsed
        environments = pool.submit(read_environments, spec.lights)
        read: Future[SkinMesh] = Future()
        maps = None
        if not spec.texture.udim and spec.maps.files():

            def charts(tile: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
                return on_charts(read.result(), tile, shape)

            maps = pool.submit(read_maps, spec.maps, charts=charts)
        try:
            mesh = read_look_mesh(spec, waiting)
        except BaseException:
            read.cancel()
            raise
        read.set_result(painted_mesh(mesh))
        try:
            tiles = tiles_of(mesh, spec.texture.udim)
        except InputError as error:
            raise InputError(f"{spec.mesh.path}: {error}") from error
        builder = ThreadPoolExecutor(1)
        building = builder.submit(Occluder, mesh) if rays else None
        builder.shutdown(wait=False)
        found, notes, warnings = read_look_maps(spec, mesh, tiles, maps.result() if maps else None)
        return SceneData(mesh, found, environments.result(), building, notes, warnings)
