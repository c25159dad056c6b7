"""Maps painted for a mesh's own UVs, in the layout that was made for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.atlas import FIRST_TILE, rasterize, sample_map, tiles_of
from skinbake.errors import InputError
from skinbake.io.image_values import filled
from skinbake.irradiance.fine_normals import add_fine_normals
from skinbake.irradiance.normal_map import shading_normals
from skinbake.scene.maps import IMAGES, OF_SKIN, SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec


def painted_mesh(mesh: SkinMesh) -> SkinMesh:
    """The mesh with the UVs that its maps are painted for; itself where no other layout was made."""
    return mesh if mesh.map_uv is None else replace(mesh, corner_uv=mesh.map_uv)


def repaint(spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps) -> SkinMaps:
    """The look's maps as they are used: heights and details in the normals, and all at the texels of the layout.

    Where `texture.unwrap` made a layout, normals come out in object space, since tangents turn with it; where it made
    none, and there are neither heights nor details, maps stay as they are in the files.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
    maps : SkinMaps
        As they are in the files.

    Raises
    ------
    InputError
        The mesh's own UVs lie on more than one tile.
    """
    painted = painted_mesh(mesh)
    tiles = tiles_of(painted, spec.texture.udim)
    maps = add_fine_normals(maps, painted, spec.texture.size, tiles, spec.texture.udim, spec.specular.roughness)
    if mesh.map_uv is None or not any(getattr(maps, name) for name in IMAGES):
        return maps
    if mesh.map_uv.min() < -1e-6 or mesh.map_uv.max() > 1 + 1e-6:
        raise InputError(
            f"{spec.mesh.path}: texture.unwrap: expected the mesh's own UVs within [0, 1], by which maps are read, got"
            f" {mesh.map_uv.min():.3g} to {mesh.map_uv.max():.3g}; leave the maps out, or set texture.unwrap: none"
        )
    (raster,) = rasterize(mesh, spec.texture.size, spec.texture.gutter)
    fields: dict[str, object] = {}
    for name in IMAGES:
        constant = maps.albedo_rgb if name == "albedo" else 0.0
        if name == "normal":
            continue
        images = getattr(maps, name)
        if images:
            image = sample_map(raster, painted, images, constant)
            # What varies the skin has a range: nothing that no texel shows may be in it
            fields[name] = {FIRST_TILE: filled(image, ~raster.addressed) if name in OF_SKIN else image}
    if maps.normal:
        _, mapped = shading_normals(raster, painted, maps)
        fields |= {"normal": {FIRST_TILE: np.ascontiguousarray(mapped)}, "normal_space": "object"}
    return replace(maps, **fields)  # type: ignore[arg-type]
