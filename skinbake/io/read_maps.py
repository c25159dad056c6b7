"""All maps of a look, read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.atlas import FIRST_TILE
from skinbake.bilinear import magnify_bilinear
from skinbake.errors import InputError
from skinbake.io.image_file import read_stored
from skinbake.io.image_memory import MAP_CHANNELS, image_bytes, refuse_beyond_memory
from skinbake.io.image_values import BLACK, Image, Mask, black_texels, clear_texels, filled
from skinbake.io.map_values import READERS, refuse_narrow
from skinbake.io.tile_names import MARKS, name_of_tile, names_tiles, tile_files
from skinbake.numerics import largest_channel
from skinbake.scene.map_files import FileMapSpec, MapsSpec
from skinbake.scene.maps import OF_SKIN, DetailNormals, SkinMaps

Charts = Callable[[int, tuple[int, int]], Mask]  # tile and shape (h, w) to the texels whose centre a chart holds
WHITE = (1.0, 1.0, 1.0)
SHORT, INWARD_SHARE = 0.5, 0.02  # shorter ones are no normals, as grey about charts; more are no accident


def read_maps(
    spec: MapsSpec, tiles: Sequence[int] = (FIRST_TILE,), charts: Charts | None = None, opaque: bool = False
) -> SkinMaps:
    """Read the maps of a look.

    Parameters
    ----------
    spec : MapsSpec
        Paths as they should be opened; one with `<UDIM>` names a file for each tile.
    tiles : sequence of int
        UDIM tiles that the mesh uses.
    charts : callable, optional
        Where charts lie. Black texels beside them count as unpainted; without it, only those of alpha 0 do. Unpainted
        texels are filled from the painted ones around them, so that no filter draws them over a chart's border.
    opaque : bool
        Whatever lies on a chart is painted, too, where its alpha is 0.

    Raises
    ------
    InputError
        A map is missing, cannot be read, is not finite or leaves its range; the message names file and texel.
    """

    def read(name: str, of: FileMapSpec, tile: int, path: Path) -> Image:
        stored = read_stored(path, of.layer, getattr(of, "channel", None))
        values = READERS[name](of, path, stored)
        unpainted = clear_texels(stored)
        if charts is not None and name != "detail":
            beside = black_texels(stored) | unpainted if opaque else black_texels(stored)
            if beside.any():
                beside &= ~charts(tile, beside.shape)
                unpainted = beside if opaque else unpainted | beside
        values = filled(values, unpainted)
        return refuse_narrow(path, values, charts and charts(tile, values.shape)) if name == "radius" else values

    files = {name: _files(name, of, tiles) for name, of in spec.files().items()}
    refuse_beyond_memory(
        {path: image_bytes(path, MAP_CHANNELS.get(name, 1)) for name, of in files.items() for path in of.values()}
    )
    with ThreadPoolExecutor(2) as pool:  # a picture is inflated without the interpreter's lock
        jobs = {
            name: {tile: pool.submit(read, name, of, tile, files[name][tile]) for tile in files[name]}
            for name, of in spec.files().items()
        }
        maps: dict[str, Any] = {name: {tile: job.result() for tile, job in of.items()} for name, of in jobs.items()}
    if spec.normal is not None:
        maps |= {"normal_space": spec.normal.space, "normal_strength": spec.normal.strength}
    if spec.height is not None:
        maps["height_mm"] = maps.pop("height")
    if spec.cavity is not None:
        maps["specular"] = _times(maps.get("specular", {}), maps.pop("cavity"))
    if spec.detail is not None:
        detail = maps["detail"][FIRST_TILE]
        maps["detail"] = DetailNormals(detail, spec.detail.repeat, spec.detail.strength)
    return SkinMaps(albedo_rgb=spec.albedo_rgb or WHITE, **maps)


def _times(one: dict[int, Image], other: dict[int, Image]) -> dict[int, Image]:
    """Products of two maps, tile by tile, at the larger size of the two along each axis; 1 where one is missing."""
    product = dict(one)
    for tile, image in other.items():
        if tile not in one:
            product[tile] = image
            continue
        height, width = np.maximum(one[tile].shape, image.shape).tolist()
        first, second = (magnify_bilinear(each[..., None], (height, width))[..., 0] for each in (one[tile], image))
        product[tile] = first * second
    return product


def missing_tiles(spec: MapsSpec, tiles: Sequence[int]) -> list[str]:
    """A sentence for each map that has no file for some of the tiles: what is used instead."""
    instead = {
        "albedo": "maps.albedo_rgb",
        "roughness": "specular.roughness",
        "specular": "a factor of 1",
        "cavity": "a factor of 1",
        "f0": "specular.f0",
        **{name: f"skin.{name}" for name in OF_SKIN},
    }
    found = []
    for name, of in spec.files().items():
        lacking = sorted(set(tiles) - set(tile_files(of.path))) if names_tiles(of.path) else []
        if lacking:
            files = ", ".join(Path(name_of_tile(of.path, tile)).name for tile in lacking)
            found.append(f"maps.{name}: no {files}: {instead.get(name, 'the smooth normal')} is used there")
    return found


def inward_normals(maps: SkinMaps) -> list[str]:
    """A sentence where many normals of a tangent-space map point into the skin: they are passed over."""
    found = []
    for tile, image in maps.normal.items() if maps.normal_space == "tangent" else ():
        normals = image[::4, ::4].reshape(-1, 3)
        painted = (np.linalg.norm(normals, axis=1) > SHORT) & (largest_channel(np.abs(normals + 1)) > BLACK)
        inward = painted & (normals[:, 2] <= 0)
        if inward.mean() > INWARD_SHARE:
            found.append(
                f"maps.normal, tile {tile}: {inward.mean():.0%} of its normals point into the skin and are passed over;"
                " is it in object space (space: object), or another picture?"
            )
    return found


def _files(name: str, of: FileMapSpec, tiles: Sequence[int]) -> dict[int, Path]:
    """Existing files by tile."""
    if name == "detail":
        return {FIRST_TILE: Path(of.path)}
    if not names_tiles(of.path):
        if tuple(tiles) != (FIRST_TILE,):
            raise InputError(f"{of.path}: expected {MARKS} in the path, the mesh has tiles {list(tiles)}")
        return tile_files(of.path)
    found = {tile: path for tile, path in tile_files(of.path).items() if tile in tiles}
    if not found:
        raise InputError(f"{of.path}: no such file for any of the tiles {list(tiles)}")
    return found
