"""Reading of everything that a look's files hold."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from skinbake.atlas import tiles_of
from skinbake.errors import InputError
from skinbake.io.image import read_environments, read_maps
from skinbake.io.mesh import read_look_mesh
from skinbake.io.repaint import repaint
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.scene.spec import SceneSpec


def read_scene(spec: SceneSpec, rays: bool = True) -> SceneData:
    """Read mesh, maps and environments of a look.

    Parameters
    ----------
    rays : bool
        Begin to build what rays meet, on a thread that goes on while others read and rasterise.

    Raises
    ------
    InputError
        A file is missing or unusable; the message names it, what was expected and what it holds.
    """
    with ThreadPoolExecutor(1) as pool:  # pictures are decoded while the mesh is parsed
        environments = pool.submit(read_environments, spec.lights)
        maps = None if spec.texture.udim else pool.submit(read_maps, spec.maps)
        mesh = read_look_mesh(spec)
        try:
            tiles = tiles_of(mesh, spec.texture.udim)
        except InputError as error:
            raise InputError(f"{spec.mesh.path}: {error}") from error
        builder = ThreadPoolExecutor(1)
        building = builder.submit(Occluder, mesh) if rays else None
        builder.shutdown(wait=False)
        of_tiles = maps.result() if maps else read_maps(spec.maps, tiles)
        return SceneData(mesh, repaint(spec, mesh, of_tiles), environments.result(), building)
