"""Everything that a look's maps come from: files, the mesh's own materials, and the colours of its vertices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, interpolate, on_charts, rasterize, sample_map, tile_of_face
from skinbake.errors import InputError, SkinbakeError
from skinbake.io.image_values import filled
from skinbake.io.map_values import ggx_as_beckmann
from skinbake.io.mesh.gltf_file import GltfFile
from skinbake.io.mesh.gltf_material import GltfMaterial, picture_of, read_materials
from skinbake.io.mesh.look_mesh import refuse_unpainted
from skinbake.io.read_maps import inward_normals, missing_tiles, read_maps
from skinbake.io.repaint import painted_mesh, repaint
from skinbake.profile.skin_albedo import albedo_of_skin
from skinbake.scene.map_files import MapsSpec
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.skin import PhysiologySkin
from skinbake.scene.spec import SceneSpec

GUTTER = 4  # texels beside the charts that get the colour of the vertices at least, for whoever reads between texels
# What is taken of a material for each map: its image, and what multiplies it
OF_MATERIAL = {
    "albedo": ("base_image", "base_rgb"),
    "normal": ("normal_image", "normal_scale"),
    "roughness": ("roughness_image", "roughness"),
}
Charts = Callable[[int, tuple[int, int]], NDArray[np.bool_]]
Image = NDArray[np.float32]


def read_look_maps(
    spec: SceneSpec, mesh: SkinMesh, tiles: Sequence[int], of_files: SkinMaps | None = None
) -> tuple[SkinMaps, tuple[str, ...], tuple[str, ...]]:
    """The maps of a look at the texels of its layout, what they are of a mesh's materials, and warnings.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
        Of the look.
    tiles : sequence of int
        UDIM tiles of the mesh.
    of_files : SkinMaps, optional
        The maps that the look names, where they were read already.

    Raises
    ------
    InputError
        A map is missing, cannot be read, is not finite or leaves its range; the mesh has no materials, or no colours
        of vertices, where the look asks for them.
    """
    charts = partial(on_charts, painted_mesh(mesh))
    maps = read_maps(spec.maps, tiles, charts) if of_files is None else of_files
    warnings, notes = missing_tiles(spec.maps, tiles), list[str]()
    if spec.maps.source == "file":
        maps, notes = _with_materials(spec, mesh, maps, tiles, charts)
    if maps.normal_space == "object" and mesh.turn is not None:
        turn = mesh.turn.T.astype(np.float32)  # the map was made in the file's axes
        maps = replace(maps, normal={tile: image @ turn for tile, image in maps.normal.items()})
    warnings += inward_normals(maps)
    maps = repaint(spec, mesh, maps)
    if spec.maps.vertex_colors:
        maps = replace(maps, albedo=_albedo_of_vertices(spec, mesh, maps))
    if isinstance(spec.skin, PhysiologySkin) and spec.skin.albedo is not None:
        maps = replace(maps, albedo=albedo_of_skin(spec.skin, maps, tiles))
    return maps, tuple(notes), tuple(warnings)


def _with_materials(
    spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps, tiles: Sequence[int], charts: Charts
) -> tuple[SkinMaps, list[str]]:
    """The maps with what the materials of the skin hold, where the look names no map, and what that was."""
    path = Path(spec.mesh.path)
    if path.suffix.lower() not in (".glb", ".gltf"):
        raise InputError(
            f"{path}: maps: file: expected a glTF or GLB, whose materials hold maps, got {path.suffix.lower()};"
            " name the maps under maps"
        )
    file = GltfFile(path)
    painted = painted_mesh(mesh)
    part = mesh.part if mesh.part is not None else np.zeros(len(mesh.faces), np.int32)
    tile = tile_of_face(painted, spec.texture.udim)
    taken = [role for role in OF_MATERIAL if getattr(spec.maps, role) is None]
    made: dict[str, dict[int, Image]] = {role: dict(getattr(maps, role)) for role in taken}
    notes = []
    with TemporaryDirectory() as folder:
        for number in tiles:
            used = sorted({mesh.part_material[k] for k in np.unique(part[tile == number]).tolist()})
            textures = ["base" if role == "albedo" else role for role in taken]
            materials = read_materials(file, used, spec.mesh.uv_set, textures)
            if number != FIRST_TILE:
                for material in materials:
                    material.refuse_outside(path, "maps: file")
            for role in taken:
                material = _one_of(path, role, materials)
                image, called = _image_of(spec, mesh, file, role, material, Path(folder), partial(charts, number))
                if image is not None:
                    made[role][number] = image
                    notes.append(f"maps.{role}: of the material {material.name}: {called}")
    if not notes:
        notes.append("maps: file: its materials hold neither base colour, normals nor roughness")
    return replace(maps, **made), list(dict.fromkeys(notes))  # type: ignore[arg-type]


def _one_of(path: Path, role: str, materials: Sequence[GltfMaterial]) -> GltfMaterial:
    """The material that a map comes from; several may share one picture, as a face and its lips do."""
    held = {tuple(getattr(material, name) for name in OF_MATERIAL[role]): material for material in materials[::-1]}
    if len(held) > 1:
        names = ", ".join(material.name for material in list(held.values())[::-1])
        raise InputError(
            f"{path}: maps: file: expected one {role} for all skin of a tile, got those of {names}; choose by"
            f" mesh.skin, set texture.udim: true where each has a tile of its own, or name the map under maps.{role}"
        )
    return next(iter(held.values()))


def _image_of(
    spec: SceneSpec,
    mesh: SkinMesh,
    file: GltfFile,
    role: str,
    material: GltfMaterial,
    folder: Path,
    charts: Callable[[tuple[int, int]], NDArray[np.bool_]],
) -> tuple[Image | None, str]:
    """One map of a material, decoded and multiplied, and what it is in words; None where the material says nothing."""
    picture, factor = (getattr(material, name) for name in OF_MATERIAL[role])
    if picture is None:
        if role == "normal" or factor is None:
            return None, ""
        constant = np.asarray(factor, np.float32).reshape(1, 1, -1)
        if not (constant.min() >= 0 and constant.max() <= 1):
            raise InputError(f"{file.path}: maps: file: {material.name}: expected factors from 0 to 1, got {factor}")
        words = ", ".join(f"{value:.3g}" for value in constant.ravel())
        return constant if role == "albedo" else ggx_as_beckmann(constant[..., 0]), words
    refuse_unpainted(spec, mesh, f"maps.{role}")
    path, called = picture_of(file, picture, folder)
    keys = {"albedo": {"color_space": "srgb"}, "normal": {}, "roughness": {"channel": "g", "kind": "ggx"}}[role]
    wanted = MapsSpec.model_validate({role: {"path": str(path), **keys}})
    try:
        # A glTF's alpha means something in the base colour alone, and there not in an OPAQUE material
        opaque = role != "albedo" or material.alpha_mode == "OPAQUE"
        found = read_maps(wanted, charts=lambda _, shape: charts(shape), opaque=opaque)
    except SkinbakeError as error:
        raise type(error)(str(error).replace(str(path), called)) from error
    image: Image = getattr(found, role)[FIRST_TILE]
    if role == "albedo" and factor is not None:
        image = image * np.asarray(factor, np.float32)
    elif role == "roughness" and factor is not None:
        image = image * np.float32(factor) ** 2
    elif role == "normal":
        image = image * np.asarray([factor, factor, 1.0], np.float32)
    size = f"{image.shape[1]} x {image.shape[0]}"
    return image, f"{Path(called).name}, {size}" + (f", times {factor}" if factor not in (None, 1.0) else "")


def _albedo_of_vertices(spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps) -> dict[int, Image]:
    """Colours of the vertices at the texels, times the albedo that there is."""
    rgb, path = mesh.corner_rgb, spec.mesh.path
    if rgb is None:
        raise InputError(
            f"{path}: maps.vertex_colors: expected vertices with colours (COLOR_0 of a glTF; red, green, blue of a PLY;"
            " v x y z r g b of an OBJ), got none; paint the mesh's vertices, or leave maps.vertex_colors out"
        )
    bare = np.isnan(rgb).any(axis=(1, 2))
    if bare.any():
        label = mesh.part_names[mesh.part[np.argmax(bare)]] if mesh.part is not None else "a part"
        raise InputError(
            f"{path}: maps.vertex_colors: expected colours of all skin, {label} has none in {int(bare.sum())} triangles"
        )
    if not (rgb.min() >= 0 and rgb.max() <= 1):
        raise InputError(
            f"{path}: maps.vertex_colors: expected colours from 0 to 1, got {rgb.min():.3g} to {rgb.max():.3g}"
        )
    albedo = {}
    for raster in rasterize(mesh, spec.texture.size, max(GUTTER, spec.texture.gutter), spec.texture.udim):
        image = interpolate(raster, rgb)
        if maps.albedo:
            image *= sample_map(raster, mesh, maps.albedo, (1.0, 1.0, 1.0))
        albedo[raster.tile] = filled(image, ~raster.addressed)
    return albedo
