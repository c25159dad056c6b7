"""USD stages as triangles; the only file that knows pxr (usd-core) [Pixar2016]."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.mesh.polygons import triangulate
from skinbake.io.mesh.raw_mesh import RawMesh, joined, refuse_missing_vertices
from skinbake.numerics import Float

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
METRE = 1000.0
UV_TYPES = ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]", "float2[]", "double2[]")
UV_NAMES = ("st", "UVMap", "uv", "map1")  # as programs call the first set
# Surfaces that would be missing; curves and points have none
NO_MESHES = ("PointInstancer", "Sphere", "Cube", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane",
             "NurbsPatch", "TetMesh")  # fmt: skip
Index = NDArray[np.int64]


def read_usd(path: Path, uv_set: int | None = None, time: float | None = None) -> RawMesh:
    """Read every visible mesh of a stage in world space; skeletons stay in their bind pose.

    Parameters
    ----------
    path : path
    uv_set : int, optional
        Which set of UVs: 0 is `st` or what stands for it, n is `st<n>`, else the n-th by name.
    time : float, optional
        Time code; by default each attribute's earliest.

    Raises
    ------
    InputError
        usd-core is not installed, or the file is damaged; the message says so.
    """
    with _stage_of(path) as stage:
        from pxr import Usd, UsdGeom

        at = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
        cache = UsdGeom.XformCache(at)
        everything = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        parts = []
        for prim in Usd.PrimRange(stage.GetPseudoRoot(), everything):
            if str(prim.GetTypeName()) in NO_MESHES and _is_seen(prim, at):
                kind = str(prim.GetTypeName())
                what = "its instances as meshes" if kind == "PointInstancer" else "it as a mesh"
                raise InputError(
                    f"{path}: {prim.GetPath()} is a {kind}, which is not supported; export {what}, or make it invisible"
                )
            if prim.IsA(UsdGeom.Mesh) and _is_seen(prim, at):
                parts += _parts(path, prim, at, _to_world(prim, cache), uv_set)
        up = str(UsdGeom.GetStageUpAxis(stage)).lower()
        scale = float(UsdGeom.GetStageMetersPerUnit(stage)) * METRE
    whole = joined(parts)
    return RawMesh(
        **{name: getattr(whole, name) for name in ("positions", "faces", "corner_uv", "has_uv", "corner_normal")},
        part=whole.part,
        names=whole.names,
        mm_per_unit=scale,
        corner_rgb=whole.corner_rgb,
        up="z" if up == "z" else "y",
    )


def files_of_usd(path: Path) -> tuple[Path, ...]:
    """Layers that a stage is composed of, besides its own file; none where it cannot be read."""
    try:
        with _stage_of(path) as stage:
            found = [layer.realPath for layer in stage.GetUsedLayers()]
    except InputError:
        return ()  # whoever reads the mesh says what is wrong with it
    files = [Path(name.split("[")[0]) for name in found if name]
    return tuple(file for file in dict.fromkeys(files) if file.is_file() and not file.samefile(path))


@contextmanager
def _stage_of(path: Path) -> Iterator[Any]:
    """The opened stage; what the library warns of is kept from the terminal."""
    try:
        from pxr import Tf, Usd, UsdUtils
    except ImportError:
        raise InputError(
            f"{path}: is a USD file; install its reader with pip install 'skinbake[usd]', or export as glTF or OBJ"
        ) from None
    silent = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        text = str(error).strip().splitlines()
        reason = next((line.strip() for line in text if "'" in line), text[-1] if text else "damaged")
        raise InputError(f"{path}: not a USD stage that can be read ({reason[-200:]})") from None
    finally:
        silent.TakeUncoalescedDiagnostics()
        silent.TakeCoalescedDiagnostics()
        del silent


def _to_world(prim: Any, cache: Any) -> Float:
    """A mesh's points to the world, for rows; where joints carry it, the mesh's own transform does not count."""
    from pxr import UsdSkel

    binding = UsdSkel.BindingAPI(prim)
    skeleton = binding.GetInheritedSkeleton()
    if not skeleton or not _primvar(prim, cache.GetTime(), "skel:jointIndices"):
        return np.array(cache.GetLocalToWorldTransform(prim))
    bind, rest = skeleton.GetBindTransformsAttr().Get(), skeleton.GetRestTransformsAttr().Get()
    # Programs write the bind pose in the world or in the skeleton's space; the first joint, a root, tells which
    moved = bind[0].GetInverse() * rest[0] if bind and rest else np.eye(4)
    to_world = np.array(binding.GetGeomBindTransformAttr().Get() or np.eye(4)) @ np.array(moved)
    return to_world @ np.array(cache.GetLocalToWorldTransform(skeleton.GetPrim()))


def _is_seen(prim: Any, at: Any) -> bool:
    """Whether a mesh is drawn: visible, and neither a guide nor a proxy."""
    from pxr import UsdGeom

    image = UsdGeom.Imageable(prim)
    return image.ComputeVisibility(at) != UsdGeom.Tokens.invisible and image.ComputePurpose() in (
        UsdGeom.Tokens.default_,
        UsdGeom.Tokens.render,
    )


def _parts(path: Path, prim: Any, at: Any, to_world: Float, uv_set: int | None) -> list[RawMesh]:
    """A mesh's triangles, as a part for each of its subsets and one for what is in none."""
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh(prim)
    points = _array(mesh.GetPointsAttr().Get(at), 3)
    sizes = _array(mesh.GetFaceVertexCountsAttr().Get(at)).astype(np.int64)
    index = _array(mesh.GetFaceVertexIndicesAttr().Get(at)).astype(np.int64)
    if not len(points) or not len(sizes):
        return []
    where = f"{path}: {prim.GetPath()}"
    if sizes.min() < 0 or sizes.sum() != len(index):
        raise InputError(f"{where}: expected {int(sizes.sum())} indices of its faces, got {len(index)}")
    refuse_missing_vertices(path, index, len(points))
    triangles = triangulate(points[index], sizes)
    polygon = np.repeat(np.arange(len(sizes)), sizes)[triangles[:, 0]]
    linear = to_world[:3, :3]  # for vectors as rows
    positions = points @ linear + to_world[3, :3]
    left_handed = mesh.GetOrientationAttr().Get(at) == UsdGeom.Tokens.leftHanded
    turned = bool(left_handed) != bool(np.linalg.det(linear) < 0)

    place = _Place(index, triangles, polygon, len(points), where)
    uv = _at_corners(place, _uv_primvar(prim, at, uv_set), 2)
    normal = None
    if mesh.GetSubdivisionSchemeAttr().Get(at) == UsdGeom.Tokens.none:
        normal = _at_corners(place, _normals(prim, mesh, at), 3)
    if normal is not None:
        with np.errstate(all="ignore"):  # no direction is left where there was none
            normal = normal @ np.linalg.pinv(linear).T
    rgb = _at_corners(place, _primvar(prim, at, "displayColor"), 3)

    holes = _array(mesh.GetHoleIndicesAttr().Get(at)).astype(np.int64)
    kept = ~np.isin(polygon, holes)
    number, names = _subsets(prim, len(sizes))
    part = number[polygon]
    made = []
    for k in np.unique(part[kept]).tolist():
        mine = np.flatnonzero(kept & (part == k))
        faces = index[triangles[mine]]
        order = [0, 2, 1] if turned else [0, 1, 2]
        made.append(
            RawMesh(
                positions,
                faces[:, order].astype(np.int32),
                np.zeros((len(mine), 3, 2)) if uv is None else uv[mine][:, order],
                np.full(len(mine), uv is not None),
                np.zeros((len(mine), 3, 3)) if normal is None else normal[mine][:, order],
                np.zeros(len(mine), np.int32),
                (names[k],),
                corner_rgb=None if rgb is None else rgb[mine][:, order],
            )
        )
    return made


def _subsets(prim: Any, count: int) -> tuple[Index, list[tuple[str, ...]]]:
    """The part of each polygon, and the names each part goes by: its path, names of prim, subset and material."""
    from pxr import UsdGeom

    number = np.zeros(count, np.int64)
    names = [(str(prim.GetPath()), prim.GetName(), *_material(prim))]
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        faces = _array(subset.GetIndicesAttr().Get()).astype(np.int64)
        faces = faces[(faces >= 0) & (faces < count)]
        if subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.face and len(faces):
            of = subset.GetPrim()
            names.append((str(of.GetPath()), prim.GetName(), of.GetName(), *_material(of)))
            number[faces] = len(names) - 1
    return number, names


def _material(prim: Any) -> tuple[str, ...]:
    from pxr import UsdShade

    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    return (material.GetPrim().GetName(),) if material else ()


class _Values(NamedTuple):
    """What a primvar holds, and between what it is interpolated."""

    name: str
    rows: Any
    how: str


class _Place(NamedTuple):
    """Where the corners of a mesh's triangles lie.

    Attributes
    ----------
    vertex : ndarray of shape (C,)
        Of each corner of the polygons.
    triangles : ndarray of shape (T, 3)
        Indices into these corners.
    polygon : ndarray of shape (T,)
    points : int
        Vertices of the mesh.
    name : str
        Of the mesh, for messages.
    """

    vertex: Index
    triangles: Index
    polygon: Index
    points: int
    name: str


def _primvar(prim: Any, at: Any, name: str) -> _Values | None:
    from pxr import UsdGeom

    found = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not found or not found.HasValue():
        return None
    return _Values(name, found.ComputeFlattened(at), str(found.GetInterpolation()))


def _uv_primvar(prim: Any, at: Any, uv_set: int | None) -> _Values | None:
    """A mesh's UVs, or None."""
    from pxr import UsdGeom

    names = [
        str(primvar.GetPrimvarName())
        for primvar in UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance()
        if str(primvar.GetTypeName()) in UV_TYPES
    ]
    ranked = [name for name in UV_NAMES if name in names] + sorted(set(names) - set(UV_NAMES))
    number = uv_set or 0
    if f"st{number}" in names:
        return _primvar(prim, at, f"st{number}")
    return _primvar(prim, at, ranked[number]) if len(ranked) > number else None


def _normals(prim: Any, mesh: Any, at: Any) -> _Values | None:
    """The primvar `normals`, which goes before the attribute of that name."""
    found = _primvar(prim, at, "normals")
    attribute = mesh.GetNormalsAttr()
    if found is None and attribute.HasValue():
        found = _Values("normals", attribute.Get(at), str(mesh.GetNormalsInterpolation()))
    return found


def _at_corners(place: _Place, values: _Values | None, columns: int) -> Float | None:
    """Values at the corners of triangles, (T, 3, columns); None where there are none."""
    rows = _array(values.rows, columns) if values else np.zeros((0, columns))
    if values is None or not len(rows):
        return None
    if values.how == "faceVarying":
        wanted, chosen = len(place.vertex), place.triangles
    elif values.how in ("vertex", "varying"):
        wanted, chosen = place.points, place.vertex[place.triangles]
    elif values.how == "uniform":
        wanted, chosen = int(place.polygon.max(initial=-1)) + 1, np.repeat(place.polygon[:, None], 3, axis=1)
    else:
        wanted, chosen = 1, np.zeros_like(place.triangles)
    if len(rows) < wanted:
        raise InputError(f"{place.name}: {values.name}: expected {wanted} values ({values.how}), got {len(rows)}")
    found: Float = rows[chosen]
    return found


def _array(values: Any, columns: int = 0) -> NDArray:
    """What an attribute holds, (n,) or (n, columns) float64; empty where it holds nothing."""
    if values is None:
        return np.zeros((0, columns) if columns else 0)
    rows = np.asarray(values)
    return rows.astype(np.float64).reshape(-1, columns) if columns else rows.ravel()
