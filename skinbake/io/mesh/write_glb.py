"""Triangles with pictures as a binary glTF 2.0 file."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinbake
from skinbake.io.atomic import atomic_write
from skinbake.io.png import png_bytes

_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_CLAMP, _LINEAR, _TRILINEAR = 33071, 9729, 9987
_VARIANTS = "KHR_materials_variants"
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


@dataclass(frozen=True)
class GlbMaterial:
    """A surface: one that shows its picture whatever lights there are, or one that scatters as its extensions say.

    Attributes
    ----------
    name : str
    colour : ndarray of shape (H, W, 3), uint8
        Encoded as sRGB.
    normal : ndarray of shape (h, w, 3), uint8, optional
        Tangent space, green up.
    normal_scale : float
    roughness : ndarray of shape (h, w, 3), uint8, optional
        Perceptual roughness in green.
    roughness_factor : float
        Where there is no such picture.
    extensions : mapping of name to JSON object
        By default it is unlit.
    """

    name: str
    colour: NDArray[np.uint8]
    normal: NDArray[np.uint8] | None = None
    normal_scale: float = 1.0
    roughness: NDArray[np.uint8] | None = None
    roughness_factor: float = 1.0
    extensions: Mapping[str, Any] = field(default_factory=lambda: {"KHR_materials_unlit": {}})


@dataclass(frozen=True)
class GlbPrimitive:
    """Triangles of one material.

    Attributes
    ----------
    position, normal : ndarray of shape (N, 3), float32
        Positions in metres.
    tangent : ndarray of shape (N, 4), float32
    uv : ndarray of shape (N, 2), float32
        v down.
    faces : ndarray of shape (F, 3), int32
    material : GlbMaterial
    other : GlbMaterial, optional
        In the second of the file's variants.
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    tangent: NDArray[np.float32]
    uv: NDArray[np.float32]
    faces: NDArray[np.int32]
    material: GlbMaterial
    other: GlbMaterial | None = None


def write_glb(
    path: Path, primitives: Sequence[GlbPrimitive], extras: Mapping[str, Any], variants: Sequence[str] = ()
) -> None:
    """Write one node with one mesh; the same input gives the same bytes.

    Parameters
    ----------
    path : Path
    primitives : sequence of GlbPrimitive
    variants : sequence of str
        Names of the two that there are where primitives have two materials.
    extras : mapping
        Written as `extras.skinbake` of the asset.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    binary = _Binary()
    used = [each.material for each in primitives] + [each.other for each in primitives if each.other]
    materials = [_material(material, binary) for material in used]
    drawn = [
        {
            "attributes": {
                "POSITION": binary.accessor(each.position, _ARRAY_BUFFER, bounds=True),
                "NORMAL": binary.accessor(_unit(each.normal), _ARRAY_BUFFER),
                "TEXCOORD_0": binary.accessor(each.uv, _ARRAY_BUFFER),
            }
            | _tangents(each, binary),
            "indices": binary.accessor(each.faces.reshape(-1, 1).astype(np.uint32), _ELEMENT_ARRAY_BUFFER),
            "material": index,
        }
        | _variants(each, used)
        for index, each in enumerate(primitives)
    ]
    document = {
        "asset": {
            "version": "2.0",
            "generator": f"skinbake {skinbake.__version__}",
            "extras": {"skinbake": dict(extras)},
        },
        "extensionsUsed": sorted(
            {name for material in materials for name in material["extensions"]} | ({_VARIANTS} if variants else set())
        ),
        **({"extensions": {_VARIANTS: {"variants": [{"name": name} for name in variants]}}} if variants else {}),
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "skin", "mesh": 0}],
        "meshes": [{"name": "skin", "primitives": drawn}],
        "materials": materials,
        "textures": [{"sampler": 0, "source": i} for i in range(len(binary.images))],
        "images": binary.images,
        "samplers": [{"magFilter": _LINEAR, "minFilter": _TRILINEAR, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{"byteLength": len(binary.data)}],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    with atomic_write(path) as beside, open(beside, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary.data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary.data), b"BIN\0"))
        file.write(binary.data)


@dataclass
class _Binary:
    """The one buffer of the file, and what lies where in it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    textures: list[NDArray[np.uint8]] = field(default_factory=list)

    def view(self, content: bytes, **more: int) -> int:
        """Append bytes, aligned to 4; the number of their view."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content), **more})
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.views) - 1

    def accessor(self, rows: NDArray[Any], target: int, bounds: bool = False) -> int:
        """Append an array (N, C) of float32 or uint32; the number of its accessor.

        Parameters
        ----------
        rows : ndarray of shape (N, C)
        target : int
            What the buffer is for.
        bounds : bool
            State the smallest and the largest values.
        """
        made: dict[str, Any] = {
            "bufferView": self.view(np.ascontiguousarray(rows).tobytes(), target=target),
            "componentType": _FLOAT if rows.dtype == np.float32 else _UNSIGNED_INT,
            "count": len(rows),
            "type": _SHAPES[rows.shape[1]],
        }
        if bounds:
            made |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(made)
        return len(self.accessors) - 1

    def texture(self, name: str, rgb: NDArray[np.uint8]) -> dict[str, int]:
        """Append a picture as PNG, unless it is there; a reference to its texture."""
        for index, known in enumerate(self.textures):
            if known is rgb:
                return {"index": index}
        self.textures.append(rgb)
        self.images.append({"name": name, "mimeType": "image/png", "bufferView": self.view(png_bytes(rgb))})
        return {"index": len(self.images) - 1}


def _material(material: GlbMaterial, binary: _Binary) -> dict[str, Any]:
    """A material of the document; its pictures go into the buffer."""
    metal: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": material.roughness_factor}
    metal["baseColorTexture"] = binary.texture(f"{material.name} colour", material.colour)
    made: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": metal}
    if material.roughness is not None:
        metal["metallicRoughnessTexture"] = binary.texture(f"{material.name} roughness", material.roughness)
        metal["roughnessFactor"] = 1.0
    if material.normal is not None:
        made["normalTexture"] = binary.texture(f"{material.name} normal", material.normal)
        made["normalTexture"]["scale"] = material.normal_scale
    return made | {"extensions": dict(material.extensions)}


def _variants(primitive: GlbPrimitive, materials: Sequence[GlbMaterial]) -> dict[str, Any]:
    """Which material a primitive has in each variant."""
    if primitive.other is None:
        return {}
    both = [next(i for i, of in enumerate(materials) if of is each) for each in (primitive.material, primitive.other)]
    return {"extensions": {_VARIANTS: {"mappings": [{"material": m, "variants": [i]} for i, m in enumerate(both)]}}}


def _tangents(primitive: GlbPrimitive, binary: _Binary) -> dict[str, int]:
    """The attribute that only a normal map has use for."""
    if primitive.material.normal is None:
        return {}
    return {"TANGENT": binary.accessor(_unit_tangent(primitive.tangent), _ARRAY_BUFFER)}


def _unit(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Vectors (N, 3) at length 1; where there is none, up."""
    length = np.linalg.norm(vectors.astype(np.float64), axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(length > 0, vectors / np.maximum(length, 1e-30), up).astype(np.float32)


def _unit_tangent(tangent: NDArray[np.float32]) -> NDArray[np.float32]:
    """Tangents (N, 4) with a direction of length 1 and a sign of 1 or -1."""
    sign = np.where(tangent[:, 3:] < 0, np.float32(-1), np.float32(1))
    return np.concatenate([_unit(tangent[:, :3]), sign], axis=1)
