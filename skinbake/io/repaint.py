"""Maps painted for a mesh's own UVs, in the layout that was made for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.atlas import FIRST_TILE, rasterize, sample_map
from skinbake.errors import InputError
from skinbake.irradiance.normal_map import shading_normals
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec


def repaint(spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps) -> SkinMaps:
    """The look's maps at the texels of the layout that `texture.unwrap` made; the maps as they are where it made none.

    Normals come out in object space, since tangents turn with the layout.

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
    if mesh.map_uv is None or not (maps.albedo or maps.normal or maps.roughness or maps.specular):
        return maps
    if mesh.map_uv.min() < -1e-6 or mesh.map_uv.max() > 1 + 1e-6:
        raise InputError(
            f"{spec.mesh.path}: texture.unwrap: expected the mesh's own UVs within [0, 1], by which maps are read, got"
            f" {mesh.map_uv.min():.3g} to {mesh.map_uv.max():.3g}; leave the maps out, or set texture.unwrap: none"
        )
    (raster,) = rasterize(mesh, spec.texture.size, spec.texture.gutter)
    painted = replace(mesh, corner_uv=mesh.map_uv)
    fields: dict[str, object] = {}
    for name, constant in (("albedo", maps.albedo_rgb), ("roughness", 0.0), ("specular", 0.0)):
        images = getattr(maps, name)
        if images:
            fields[name] = {FIRST_TILE: sample_map(raster, painted, images, constant)}
    if maps.normal:
        _, mapped = shading_normals(raster, painted, maps)
        fields |= {"normal": {FIRST_TILE: np.ascontiguousarray(mapped)}, "normal_space": "object"}
    return replace(maps, **fields)  # type: ignore[arg-type]
