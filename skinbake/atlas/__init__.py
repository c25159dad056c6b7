"""The atlas: the point of the skin that each texel shows."""

from skinbake.atlas.coarser import coarser_atlas, coarser_size, limited_size
from skinbake.atlas.interpolate import interpolate
from skinbake.atlas.metric import face_mm_per_texel, first_fundamental_form, uv_jacobian
from skinbake.atlas.on_charts import on_charts
from skinbake.atlas.raster import NO_FACE, Atlas, AtlasRaster
from skinbake.atlas.rasterize import rasterize, signed_uv_area
from skinbake.atlas.report import UvReport, report_picture, uv_report
from skinbake.atlas.sample import sample_map, shrink
from skinbake.atlas.texel_coordinates import (
    FIRST_TILE,
    corner_texels,
    local_uv,
    tile_of_face,
    tile_origin,
    tiles_of,
)
from skinbake.atlas.tiled import Tiled, Tiles

__all__ = [
    "FIRST_TILE",
    "NO_FACE",
    "Atlas",
    "AtlasRaster",
    "Tiled",
    "Tiles",
    "UvReport",
    "coarser_atlas",
    "coarser_size",
    "corner_texels",
    "face_mm_per_texel",
    "first_fundamental_form",
    "interpolate",
    "limited_size",
    "local_uv",
    "on_charts",
    "rasterize",
    "report_picture",
    "sample_map",
    "shrink",
    "signed_uv_area",
    "tile_of_face",
    "tile_origin",
    "tiles_of",
    "uv_jacobian",
    "uv_report",
]
