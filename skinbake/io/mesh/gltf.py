"""glTF 2.0 scenes as triangles, whatever wrote the file [KhronosGltf2]."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.mesh.gltf_file import GltfFile, as_numbers
from skinbake.io.mesh.gltf_material import tangents_fit, uv_of_material
from skinbake.io.mesh.raw_mesh import RawMesh, joined, refuse_missing_vertices
from skinbake.numerics import Float, safe_div

METRE = 1000.0
TRIANGLES, STRIP, FAN = 4, 5, 6
FLOAT32_NOISE = 1e-6  # a transform that differs less from none was none before it was written
SAME_PLACE = 1e-5  # of the mesh's extent: how far skinning by other float32 weights may part one point
Primitive = dict[str, Any]


def read_gltf(path: Path, uv_set: int | None = None) -> RawMesh:
    """Read the default scene of a .gltf or .glb file: meshes in world space, skinned and morphed as they stand.

    Parameters
    ----------
    path : path
    uv_set : int, optional
        Which TEXCOORD_n; by default the one that the material's base colour uses.

    Raises
    ------
    InputError
        The file is damaged or uses what is not supported; the message names it.
    """
    file = GltfFile(path)
    try:
        with np.errstate(all="ignore"):  # what overflows is no longer finite, and refused by whoever reads the mesh
            world, hidden = _world_matrices(file)
            parts = [
                _part(file, node, mesh, primitive, world, uv_set)
                for node in world
                if node not in hidden
                for mesh, primitive in _primitives(file, node)
            ]
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError) as error:
        raise InputError(f"{path}: damaged glTF ({type(error).__name__}: {str(error)[:120]})") from None
    return joined([part for part in parts if part is not None])


def _world_matrices(file: GltfFile) -> tuple[dict[int, Float], set[int]]:
    """World transform of every node of the default scene, depth first, and which of them are hidden."""
    nodes = file.tree.get("nodes", [])
    if "scenes" in file.tree:
        roots = file.item("scenes", file.tree.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    world: dict[int, Float] = {}
    hidden: set[int] = set()
    todo = [(index, np.eye(4), True) for index in reversed(roots)]
    while todo:
        index, above, seen = todo.pop()
        node = file.item("nodes", index)
        if index in world:
            raise InputError(f"{file.path}: node {index} has two parents, or is its own ancestor")
        local = _local_matrix(node)
        nothing = np.abs(local - np.eye(4)).max() < FLOAT32_NOISE
        world[index] = above if nothing else above @ local
        seen = seen and bool(node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True))
        if not seen:
            hidden.add(index)
        todo += [(child, world[index], seen) for child in reversed(node.get("children", []))]
    return world, hidden


def _local_matrix(node: dict[str, Any]) -> Float:
    if "matrix" in node:
        return np.asarray(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    turn = np.asarray(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64).reshape(4)
    turn = turn * np.sqrt(2.0 / np.dot(turn, turn))  # files hold float32, a little off unit length
    (xx, xy, xz, xw), (_, yy, yz, yw), (_, _, zz, zw), _ = np.outer(turn, turn)
    matrix[:3, :3] = [
        [1 - yy - zz, xy - zw, xz + yw],
        [xy + zw, 1 - xx - zz, yz - xw],
        [xz - yw, yz + xw, 1 - xx - yy],
    ]
    matrix[:3, :3] *= np.asarray(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    matrix[:3, 3] = np.asarray(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
    return matrix


def _primitives(file: GltfFile, node: int) -> Iterator[tuple[dict[str, Any], Primitive]]:
    """The mesh of a node with each of its primitives that holds triangles."""
    entry = file.item("nodes", node)
    if "mesh" not in entry:
        return
    if "EXT_mesh_gpu_instancing" in entry.get("extensions", {}):
        raise InputError(
            f"{file.path}: uses EXT_mesh_gpu_instancing, which is not supported; export without instancing"
        )
    mesh = file.item("meshes", entry["mesh"])
    for primitive in mesh["primitives"]:
        if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
            yield mesh, primitive


def _part(
    file: GltfFile, node: int, mesh: dict[str, Any], primitive: Primitive, world: dict[int, Float], uv_set: int | None
) -> RawMesh | None:
    """One primitive as a part, or None where it has no positions, or no size."""
    read = _Attributes(file, primitive)
    if "POSITION" not in read:
        return None
    entry = file.item("nodes", node)
    if "skin" not in entry and not world[node][:3, :3].any():
        return None  # scaled to nothing, as animations hide what they show at other times
    weights = entry.get("weights", mesh.get("weights", []))
    positions = read.morphed("POSITION", (3,), weights)
    normals = read.morphed("NORMAL", (3,), weights) if "NORMAL" in read else None
    material = file.item("materials", primitive["material"]) if "material" in primitive else {}
    chosen, transform = uv_of_material(material, uv_set)
    name = f"TEXCOORD_{chosen}"
    uv = read.morphed(name, (2,), weights) @ transform[:2, :2].T + transform[:2, 2] if name in read else None

    tangents = None
    if normals is not None and "TANGENT" in read and not any(weights) and tangents_fit(material, chosen, transform):
        tangents = read.numbers("TANGENT", (4,))[:, :3]
        if len(tangents) != len(positions):
            raise InputError(f"{file.path}: expected {len(positions)} tangents, one a vertex, got {len(tangents)}")

    if "skin" in entry:
        placed = _skinned(file, read, entry["skin"], world, positions, normals, tangents)
    else:
        placed = _placed(file, world[node], positions, normals, tangents)
    positions, normals, tangents, mirrored = placed
    faces = _faces(read.indices(len(positions)), primitive.get("mode", TRIANGLES))
    refuse_missing_vertices(file.path, faces, len(positions))
    if mirrored:
        faces = np.ascontiguousarray(faces[:, ::-1])
    for rows, of_what in ((uv, "UVs"), (normals, "normals")):
        if rows is not None and len(rows) != len(positions):
            raise InputError(f"{file.path}: expected {len(positions)} {of_what}, one a vertex, got {len(rows)}")
    corner_uv = np.zeros((len(faces), 3, 2))
    if uv is not None:
        corner_uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)[faces]  # glTF has v down
    rgb = read.numbers("COLOR_0", (3, 4))[:, :3] if "COLOR_0" in read else None
    if rgb is not None and len(rgb) != len(positions):
        raise InputError(f"{file.path}: expected {len(positions)} colours, one a vertex, got {len(rgb)}")
    names = tuple(str(owner["name"]) for owner in (entry, mesh, material) if owner.get("name"))
    return RawMesh(
        positions,
        faces.astype(np.int32),
        corner_uv,
        np.full(len(faces), uv is not None),
        normals[faces] if normals is not None else np.zeros((len(faces), 3, 3)),
        np.zeros(len(faces), np.int32),
        (tuple(dict.fromkeys(names)),),
        mm_per_unit=METRE,
        corner_tangent=None if tangents is None else tangents[faces],
        corner_rgb=None if rgb is None else rgb[faces],
        material=(int(primitive.get("material", -1)),),
    )


class _Attributes:
    """Vertex attributes and indices of a primitive, from accessors or from Draco."""

    def __init__(self, file: GltfFile, primitive: Primitive) -> None:
        self.file, self.primitive = file, primitive
        self._accessors = primitive["attributes"]
        self._draco: Any = None
        extension = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
        if extension is not None:
            self._draco_names = extension["attributes"]
            self._draco = self._decoded(extension)

    def _decoded(self, extension: dict[str, Any]) -> Any:
        try:
            import DracoPy
        except ImportError:
            if "bufferView" in self.file.item("accessors", self._accessors["POSITION"]):
                return None  # the same primitive is there without compression, too
            raise InputError(
                f"{self.file.path}: uses KHR_draco_mesh_compression; install its decoder with"
                " pip install 'skinbake[draco]', or export without compression"
            ) from None
        data, _ = self.file.view(extension["bufferView"])
        try:
            found = DracoPy.decode(bytes(data))
        except Exception as error:  # the library has its own kinds, with plain Exception above them
            raise self._undecoded(f"{type(error).__name__}: {str(error)[:80]}") from None
        if getattr(found, "faces", None) is None:
            raise self._undecoded("points without triangles")
        return found

    def _undecoded(self, why: str) -> InputError:
        return InputError(
            f"{self.file.path}: KHR_draco_mesh_compression: its data cannot be decoded ({why});"
            " export the mesh again, or without compression"
        )

    def __contains__(self, name: str) -> bool:
        return name in self._accessors

    def numbers(self, name: str, columns: tuple[int, ...]) -> Float:
        """An attribute as float64 of shape (V, n)."""
        return as_numbers(self.rows(name, columns), self._normalized(name))

    def _normalized(self, name: str) -> bool:
        return bool(self.file.item("accessors", self._accessors[name]).get("normalized", False))

    def rows(self, name: str, columns: tuple[int, ...]) -> NDArray:
        """An attribute as it is stored, of shape (V, n)."""
        if self._draco is None or name not in self._draco_names:
            return self.file.accessor(self._accessors[name], columns)
        attribute = self._draco.get_attribute_by_unique_id(self._draco_names[name])
        if not attribute or attribute["data"].shape[1:] not in {(n,) for n in columns}:
            raise self._undecoded(f"no {name} of {' or '.join(map(str, columns))} numbers")
        return np.asarray(attribute["data"])

    def morphed(self, name: str, columns: tuple[int, ...], weights: list[float]) -> Float:
        """An attribute with its morph targets added by their weights."""
        values = self.numbers(name, columns)
        for weight, target in zip(weights, self.primitive.get("targets", []), strict=False):
            if weight and name in target:
                values = values + float(weight) * self.file.numbers(target[name], columns)
        return values

    def indices(self, vertices: int) -> NDArray[np.int64]:
        """Vertex of each corner of the primitive."""
        if self._draco is not None:
            return np.asarray(self._draco.faces).astype(np.int64).ravel()
        if "indices" not in self.primitive:
            return np.arange(vertices)
        return self.file.accessor(self.primitive["indices"], (1,))[:, 0].astype(np.int64)


def _faces(index: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Triangles of a list, a strip or a fan; those that a strip only passes through are left out."""
    if mode == TRIANGLES:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    if len(index) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1)
    return strip_faces(index)


def strip_faces(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles of a strip, every other one turned back, without those that have no area."""
    faces = np.stack([index[:-2], index[1:-1], index[2:]], axis=1)
    faces[1::2] = faces[1::2][:, [1, 0, 2]]
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def _placed(
    file: GltfFile, transform: Float, positions: Float, normals: Float | None, tangents: Float | None
) -> tuple[Float, Float | None, Float | None, bool]:
    """Vertices, normals and tangents in world space, and whether the transform mirrors them."""
    linear = transform[:3, :3]
    determinant = float(np.linalg.det(linear))
    if not (np.isfinite(transform).all() and np.isfinite(determinant) and determinant):
        raise InputError(f"{file.path}: expected a transform that can be undone, got {linear.tolist()}")
    positions = positions @ linear.T + transform[:3, 3]
    normals = None if normals is None else normals @ np.linalg.inv(linear)
    return positions, normals, None if tangents is None else tangents @ linear.T, determinant < 0


def _skinned(
    file: GltfFile,
    read: _Attributes,
    skin: Any,
    world: dict[int, Float],
    positions: Float,
    normals: Float | None,
    tangents: Float | None,
) -> tuple[Float, Float | None, Float | None, bool]:
    """Vertices, normals and tangents where the joints put them: the node's own transform does not count."""
    entry = file.item("skins", skin)
    joints = entry["joints"]
    for joint in joints:
        if joint not in world:
            raise InputError(f"{file.path}: joint {joint} is not in the scene")
    binds = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    if "inverseBindMatrices" in entry:
        binds = file.numbers(entry["inverseBindMatrices"], (16,)).reshape(-1, 4, 4).transpose(0, 2, 1)
    if len(binds) < len(joints):
        raise InputError(f"{file.path}: skin {skin}: expected {len(joints)} inverse bind matrices, got {len(binds)}")
    matrices = np.stack([world[joint] for joint in joints]) @ binds[: len(joints)]
    if not np.isfinite(matrices).all():
        raise InputError(f"{file.path}: skin {skin}: expected finite joints")

    blended = np.zeros((len(positions), 3, 4))
    total = np.zeros(len(positions))
    number = 0
    while f"JOINTS_{number}" in read and f"WEIGHTS_{number}" in read:
        index = read.rows(f"JOINTS_{number}", (4,)).astype(np.int64)
        weight = read.numbers(f"WEIGHTS_{number}", (4,))
        if len(index) != len(positions) or len(weight) != len(positions):
            raise InputError(f"{file.path}: skin {skin}: expected joints and weights of {len(positions)} vertices")
        used = weight != 0
        if (used & ((index < 0) | (index >= len(joints)))).any():
            raise InputError(
                f"{file.path}: skin {skin}: a vertex names joint {int(index[used].max())} of {len(joints)}"
            )
        for k in range(4):
            blended += weight[:, k, None, None] * matrices[np.where(used[:, k], index[:, k], 0), :3]
        total += weight.sum(axis=1)
        number += 1
    blended = safe_div(blended, total[:, None, None])
    blended[total == 0] = np.eye(4)[:3]
    moved = np.einsum("vij,vj->vi", blended[:, :, :3], positions) + blended[:, :, 3]
    rows = blended[:, :, :3]
    cofactor = np.stack([np.cross(rows[:, i - 2], rows[:, i - 1]) for i in range(3)], axis=1)
    turned = np.einsum("vi,vi->v", rows[:, 0], cofactor[:, 0])
    if normals is not None:
        normals = np.einsum("vij,vj->vi", cofactor, normals) * np.sign(turned)[:, None]
    if tangents is not None:
        tangents = np.einsum("vij,vj->vi", rows, tangents)
    return _held_together(positions, moved), normals, tangents, bool(np.sign(turned).sum() < 0)


def _held_together(before: Float, after: Float) -> Float:
    """Vertices that were one point, and still nearly are, made one point again: float32 weights part UV seams."""
    _, first, same = np.unique(before + 0.0, axis=0, return_index=True, return_inverse=True)
    partner = first[same.reshape(-1)]
    near = np.abs(after - after[partner]).max(axis=1) < SAME_PLACE * max(float(np.ptp(after, axis=0).max()), 1e-300)
    return np.where(near[:, None], after[partner], after)
