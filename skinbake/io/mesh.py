"""Meshes: the only file that knows trimesh and xatlas. Out comes a SkinMesh in millimetres with v up."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.atomic import atomic_write
from skinbake.io.obj_indices import may_hold_zero, refuse_bad_indices
from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh, smooth_vertex_normals
from skinbake.scene.spec import MM_PER_UNIT

SUFFIXES = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off")
HEAD_MM = (80.0, 1000.0)  # longest side of anything from a face mask to a bust
TYPICAL_HEAD_MM = 240.0
LARGEST = 1e18  # of any coordinate: its fourth power is still a float64


def read_mesh(
    path: Path | str,
    mm_per_unit: float,
    flip_v: bool = False,
    unwrap: str = "none",
    any_size: bool = False,
    without_uvs: bool = False,
) -> SkinMesh:
    """Read a mesh: polygons cut into triangles, positions welded, UVs and normals kept per corner.

    Parameters
    ----------
    path : path of an OBJ, GLB, glTF, PLY, STL or OFF file
    mm_per_unit : float
    flip_v : bool
        Replaces v by 1 - v after the format's own convention (glTF has v down, all else v up).
    unwrap : "none" or "xatlas"
        "xatlas" makes UVs when the file has none.
    any_size : bool
        Skips the scale gate.
    without_uvs : bool
        Accepts a mesh that has no UVs and gives it zeros.

    Raises
    ------
    InputError
        The file is missing, is not a mesh, has no triangles, NaN vertices or no UVs, or is not as large as a head.
    """
    path = Path(path)
    parts = [_part(path, *geometry) for geometry in _geometries(path)]
    if not parts or not sum(len(faces) for _, faces, _, _ in parts):
        raise InputError(f"{path}: expected triangles, got none")
    offsets = np.cumsum([0] + [len(positions) for positions, *_ in parts])
    with np.errstate(over="ignore"):  # what overflows is infinite, and refused
        positions = np.concatenate([p for p, *_ in parts]) * mm_per_unit
    _check_positions(path, positions)
    faces = np.concatenate([f + o for (_, f, _, _), o in zip(parts, offsets[:-1], strict=True)])
    if not any_size:
        _check_size(path, positions, mm_per_unit)

    has_uvs = all(uv is not None for *_, uv, _ in parts)
    if not has_uvs and unwrap == "none" and not without_uvs:
        raise InputError(
            f"{path}: expected UVs, the mesh has none; add them, or set texture.unwrap: xatlas to make them"
        )
    corner_uv = np.concatenate([np.zeros((len(f), 3, 2)) if uv is None else uv[f] for _, f, uv, _ in parts])
    bad = np.flatnonzero(~np.isfinite(corner_uv).all(axis=(1, 2)))
    if len(bad):
        raise InputError(f"{path}: expected finite UVs, got NaN or Inf in {len(bad)} triangles, the first is {bad[0]}")
    if flip_v and has_uvs:
        corner_uv[..., 1] = 1 - corner_uv[..., 1]

    positions, faces = _weld(positions, faces)
    normal = normalized(np.concatenate([np.zeros((len(f), 3, 3)) if n is None else n[f] for _, f, _, n in parts]))
    missing = ~normal.any(axis=2)
    if missing.any():
        normal[missing] = smooth_vertex_normals(positions, faces)[faces[missing]]
    mesh = SkinMesh(positions, faces, corner_uv, normal)
    return unwrap_mesh(mesh) if unwrap == "xatlas" and not has_uvs else mesh


def unwrap_mesh(mesh: SkinMesh, gutter_texels: int = 4) -> SkinMesh:
    """The same mesh with one non-overlapping chart layout in [0, 1]^2, made by xatlas."""
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(mesh.positions_mm.astype(np.float32), mesh.faces.astype(np.uint32))
    charts, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    packing.padding = gutter_texels
    packing.resolution = 1024
    packing.bilinear = True
    atlas.generate(charts, packing)
    vertex, corner, uv = atlas[0]
    if not np.array_equal(vertex[corner], mesh.faces):
        raise InputError("xatlas could not unwrap this mesh face by face; clean it of duplicate triangles, or add UVs")
    corner_uv = np.clip(uv[corner].astype(np.float64), 0.0, 1.0)
    return SkinMesh(mesh.positions_mm, mesh.faces, corner_uv, mesh.corner_normal)


def write_obj(path: Path | str, mesh: SkinMesh, mm_per_unit: float = 1.0) -> None:
    """Write positions, UVs (v up) and normals as OBJ; equal UVs and normals are written once."""
    uv, uv_of = np.unique(mesh.corner_uv.reshape(-1, 2), axis=0, return_inverse=True)
    normal, normal_of = np.unique(mesh.corner_normal.reshape(-1, 3), axis=0, return_inverse=True)
    address = 1 + np.stack([mesh.faces.ravel(), uv_of.ravel(), normal_of.ravel()], axis=1).reshape(-1, 9)
    with atomic_write(path) as beside, open(beside, "w", encoding="ascii", newline="\n") as file:
        for tag, rows in (("v", mesh.positions_mm / mm_per_unit), ("vt", uv), ("vn", normal)):
            file.writelines(f"{tag} {' '.join(f'{x:.9g}' for x in row)}\n" for row in rows)
        file.writelines("f {}/{}/{} {}/{}/{} {}/{}/{}\n".format(*row) for row in address)


def _geometries(path: Path) -> list[tuple[Any, Float]]:
    """Every mesh instance in the file with its transform."""
    import trimesh  # half a second: only when a mesh is read

    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir() or path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected a mesh file ({', '.join(SUFFIXES)})")
    obj = b""
    try:
        if path.suffix.lower() == ".obj":
            obj = path.read_bytes()
            if may_hold_zero(obj):
                refuse_bad_indices(path, obj)
        # process=False: trimesh would merge vertices. Never maintain_order: it gives both sides of a UV seam one UV
        options: dict[str, Any] = {"process": False, "group_material": False}
        if obj:
            options["skip_materials"] = True  # for glTF this would drop the UVs as well
        with warnings.catch_warnings():  # numpy's, about arithmetic inside trimesh; what it reads is checked below
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(path, **options)
    except InputError:
        raise
    except PermissionError:
        raise InputError(f"{path}: permission to read it is missing") from None
    except Exception as error:  # trimesh raises whatever its parsers meet
        refuse_bad_indices(path, obj)
        raise InputError(
            f"{path}: not a mesh that can be read ({type(error).__name__}: {_first_line(error)})"
        ) from None
    found = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        if isinstance(scene.geometry[name], trimesh.Trimesh):
            found.append((scene.geometry[name], np.asarray(transform, dtype=np.float64)))
    # trimesh leaves out all UVs, or all normals, where a face names one that is not there
    lost_uvs = b"\nvt" in obj and any(_uv(part) is None for part, _ in found)
    if lost_uvs or (b"\nvn" in obj and any(_normals(part) is None for part, _ in found)):
        refuse_bad_indices(path, obj)
    return found


def _uv(geometry: Any) -> Any:
    return getattr(geometry.visual, "uv", None)


def _normals(geometry: Any) -> Any:
    """Normals of the file; those of trimesh's property are split ones, invented where it has none."""
    return geometry._cache.cache.get("vertex_normals")


def _part(path: Path, geometry: Any, transform: Float) -> tuple[Float, NDArray[np.int32], Float | None, Float | None]:
    """Positions, faces, UVs and normals by vertex, in the file's world space."""
    positions = np.asarray(geometry.vertices, dtype=np.float64)
    faces = np.asarray(geometry.faces, dtype=np.int32)
    _check_positions(path, positions)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"{path}: expected triangles, got faces of shape {faces.shape}")
    if len(faces) and (faces.min() < 0 or faces.max() >= len(positions)):
        raise InputError(f"{path}: a triangle names vertex {int(faces.max())}, of {len(positions)} vertices")
    linear = transform[:3, :3]
    size = np.abs(transform).max()
    if not (np.isfinite(size) and size < LARGEST and np.abs(np.linalg.det(linear)) > 0):
        raise InputError(f"{path}: expected a transform that can be undone, got {linear.tolist()}")
    positions = positions @ linear.T + transform[:3, 3]
    uv, normals = _uv(geometry), _normals(geometry)
    if normals is not None:
        normals = np.asarray(normals, dtype=np.float64)
        if normals.shape == positions.shape:  # what is no direction is left out, and made from the triangles
            normals = np.where(np.abs(normals) < LARGEST, normals, 0.0)
            normals = normals @ np.linalg.inv(linear)
        else:
            normals = None
    if np.linalg.det(linear) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    if uv is not None:
        uv = np.asarray(uv, dtype=np.float64)
        if uv.ndim != 2 or uv.shape[1] < 2 or len(uv) != len(positions):
            raise InputError(f"{path}: expected two UV coordinates a vertex, got shape {uv.shape}")
        uv = uv[:, :2]
    return positions, faces, uv, normals


def _check_positions(path: Path, positions: Float) -> None:
    """Refuse what no arithmetic can follow; the size gate comes later, in millimetres."""
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise InputError(f"{path}: expected vertices of three coordinates, got shape {positions.shape}")
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise InputError(
            f"{path}: expected finite vertices, got {len(bad)} with NaN or Inf, the first at index {bad[0]}"
        )
    if positions.size and np.abs(positions).max() >= LARGEST:
        raise InputError(f"{path}: expected vertices below {LARGEST:g}, got {np.abs(positions).max():g}")


def _weld(positions: Float, faces: NDArray[np.int32]) -> tuple[Float, NDArray[np.int32]]:
    """One vertex for each position, in the order of first use; adding 0.0 makes -0 equal 0."""
    corner = positions[faces.ravel()] + 0.0
    # By pairs of numbers, x and y, then those and z: rows sort ten times slower
    _, column = np.unique(corner[:, 0] + 1j * corner[:, 1], return_inverse=True)
    _, first, inverse = np.unique(column + 1j * corner[:, 2], return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return corner[first[order]], rank[inverse].reshape(faces.shape)


def _check_size(path: Path, positions: Float, mm_per_unit: float) -> None:
    """Refuse what cannot be a head, and say which unit would make it one."""
    extent = np.ptp(positions, axis=0)
    longest = float(extent.max())
    if HEAD_MM[0] <= longest <= HEAD_MM[1]:
        return
    size = " x ".join(f"{side:.4g}" for side in extent)
    if longest == 0:
        raise InputError(f"{path}: expected a head of about {TYPICAL_HEAD_MM:.0f} mm, got a single point")
    units = {name: longest / mm_per_unit * mm for name, mm in MM_PER_UNIT.items()}
    likely = {name: size_mm for name, size_mm in units.items() if name != "inch"}
    if not any(HEAD_MM[0] <= size_mm <= HEAD_MM[1] for size_mm in likely.values()):
        likely = units
    best = min(likely, key=lambda name: abs(np.log(units[name] / TYPICAL_HEAD_MM)))
    if HEAD_MM[0] <= units[best] <= HEAD_MM[1]:
        fix = f"set mesh.unit: {best} ({units[best]:.0f} mm)"
    else:
        fix = f"set mesh.mm_per_unit: {TYPICAL_HEAD_MM / longest * mm_per_unit:.4g}"
    raise InputError(
        f"{path}: measures {size} mm, a head is about {TYPICAL_HEAD_MM:.0f}; {fix}, "
        "or mesh.any_size: true if this is no head"
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0][:200]
