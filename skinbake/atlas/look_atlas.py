"""Raster of a look: `rasterize` with what the look says."""

from __future__ import annotations

from skinbake.atlas.raster import Atlas
from skinbake.atlas.rasterize import rasterize
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec


def look_atlas(texture: TextureSpec, mesh: SkinMesh) -> Atlas:
    """Raster of the mesh at the look's texture size, one a tile."""
    return rasterize(mesh, texture.size, texture.gutter, texture.udim)
