"""Everything a look's files hold, read at once."""

from __future__ import annotations

from skinbake.io.image import read_environment, read_maps
from skinbake.io.mesh import read_mesh
from skinbake.pipeline import SceneData
from skinbake.scene.spec import SceneSpec


def read_scene(spec: SceneSpec) -> SceneData:
    """Read mesh, maps and environments of a look.

    Raises
    ------
    InputError
        A file is missing or unusable; the message names it, what was expected and what it holds.
    """
    mesh = read_mesh(
        spec.mesh.path,
        spec.mesh.millimetres_per_unit,
        flip_v=spec.mesh.flip_v,
        unwrap=spec.texture.unwrap,
        any_size=spec.mesh.any_size,
    )
    paths = {light.name: getattr(light, "path", None) for light in spec.lights}
    environments = {name: read_environment(path) for name, path in paths.items() if path is not None}
    return SceneData(mesh, read_maps(spec.maps), environments)
