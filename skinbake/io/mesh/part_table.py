"""The parts of a look's mesh and of its occluders, for a person to choose from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinbake.io.mesh.parts import CAST, SKIN, choose_parts
from skinbake.io.mesh.placement import placed
from skinbake.io.mesh.raw_file import read_raw
from skinbake.scene.mesh_files import MeshFileSpec
from skinbake.scene.spec import SceneSpec


@dataclass(frozen=True)
class PartRow:
    """One part.

    Attributes
    ----------
    name : str
    role : "skin", "cast" or "ignore"
    triangles : int
    extent_mm : tuple of 3 floats
    uv_box : tuple of u and v from, u and v to, or None
        None where no triangle has UVs.
    """

    name: str
    role: str
    triangles: int
    extent_mm: tuple[float, float, float]
    uv_box: tuple[float, float, float, float] | None


def part_table(spec: SceneSpec) -> list[PartRow]:
    """Every part of the mesh, then those of the occluders' files that cast.

    Raises
    ------
    InputError
        A file is missing or unusable.
    """
    of = spec.mesh
    rows = _rows(of, of.skin, of.cast, of.ignore, spec.texture.unwrap == "none")
    for occluder in spec.occluders:
        rows += [
            PartRow(row.name, CAST, row.triangles, row.extent_mm, row.uv_box)
            for row in _rows(occluder, occluder.parts, (), (), False)
            if row.role == SKIN
        ]
    return rows


def _rows(
    of: MeshFileSpec, skin: tuple[str, ...], cast: tuple[str, ...], ignore: tuple[str, ...], uvs_needed: bool
) -> list[PartRow]:
    path = Path(of.path)
    raw = placed(path, read_raw(path, of.uv_set, of.time), of.millimetres_per_unit, of.up, of.front)
    roles = choose_parts(path, raw, skin, cast, ignore, uvs_needed)
    rows = []
    for part, (name, role) in enumerate(zip(raw.labels, roles.of_part, strict=True)):
        mine = raw.part == part
        corners = raw.positions[raw.faces[mine]].reshape(-1, 3)
        uv = raw.corner_uv[mine & raw.has_uv].reshape(-1, 2)
        bare = role == SKIN and not roles.skin[mine].any()
        box = tuple(round(float(x), 4) for x in (*uv.min(axis=0), *uv.max(axis=0))) if len(uv) else None
        extent = tuple(round(float(x), 2) for x in np.ptp(corners, axis=0))
        rows.append(PartRow(name, CAST if bare else role, int(mine.sum()), extent, box))  # type: ignore[arg-type]
    return rows
