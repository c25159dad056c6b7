"""The mesh of a look, and what else is in the way of its light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from skinbake.errors import InputError
from skinbake.io.mesh.opacity import with_opacity
from skinbake.io.mesh.parts import choose_parts
from skinbake.io.mesh.placement import placed
from skinbake.io.mesh.raw_file import read_raw
from skinbake.io.mesh.read_mesh import casters_of, read_mesh
from skinbake.io.waiting import Waiting, unseen
from skinbake.scene.casters import Casters, joined_casters
from skinbake.scene.maps import IMAGES
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.mesh_files import OccluderSpec
from skinbake.scene.spec import SceneSpec


def read_look_mesh(spec: SceneSpec, waiting: Waiting = unseen) -> SkinMesh:
    """Read the skin of a look with everything that shadows it; `waiting` is told while UVs are made.

    Raises
    ------
    InputError
        A file is missing or unusable, or maps were painted for UVs that the mesh does not have.
    """
    of, maps = spec.mesh, spec.maps
    mesh = read_mesh(
        of.path,
        of.millimetres_per_unit,
        flip_v=of.flip_v,
        unwrap=spec.texture.unwrap,
        any_size=of.any_size,
        uv_set=of.uv_set,
        time=of.time,
        up=of.up,
        front=of.front,
        skin=of.skin,
        cast=of.cast,
        ignore=of.ignore,
        opacity=of.opacity,
        waiting=waiting,
    )
    painted = [name for name in (*IMAGES, "cavity") if getattr(maps, name) is not None]
    if painted:
        refuse_unpainted(spec, mesh, f"maps.{painted[0]}")
    return replace(
        mesh,
        corner_rgb=mesh.corner_rgb if maps.vertex_colors else None,
        casters=joined_casters([*filter(None, [mesh.casters]), *map(read_occluder, spec.occluders)]),
    )


def refuse_unpainted(spec: SceneSpec, mesh: SkinMesh, key: str) -> None:
    """Refuse a map where the only UVs are those that `texture.unwrap` has just made.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
    key : str
        Of the map, for the message.

    Raises
    ------
    InputError
    """
    if spec.texture.unwrap != "none" and mesh.map_uv is None:
        raise InputError(
            f"{spec.mesh.path}: {key}: was painted for UVs that the mesh does not have: texture.unwrap makes a"
            " layout that no map knows; unwrap the mesh in your tool, paint, and set texture.unwrap: none,"
            " or leave the maps out"
        )


def read_occluder(spec: OccluderSpec) -> Casters:
    """Read one file of things that shadow the skin.

    Raises
    ------
    InputError
        The file or its picture is missing or unusable, no part has the name, or there are no UVs for the picture.
    """
    path = Path(spec.path)
    raw = placed(
        path, read_raw(path, spec.uv_set, spec.time, "occluders"), spec.millimetres_per_unit, spec.up, spec.front
    )
    cast = choose_parts(path, raw, skin=spec.parts, uvs_needed=False, key="occluders.parts").skin
    casters = casters_of(raw, cast, spec.flip_v)
    if spec.opacity is None:
        return casters
    return with_opacity(path, raw, cast, casters, {"*": spec.opacity}, spec.uv_set, "occluders.opacity")
