"""glTF files made by script, byte by byte as the specification has them, without any library's help."""

from __future__ import annotations

import base64
import json
import struct

import numpy as np

COMPONENT = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A glTF in the making: accessors add to its one buffer, `tree` is its JSON."""

    def __init__(self):
        self.data = bytearray()
        self.tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                     "meshes": [], "accessors": [], "bufferViews": []}  # fmt: skip

    def view(self, data: bytes, **more) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, rows, kind="f", normalized=False, view=None, **more) -> int:
        """An accessor of numbers, of shape (N,) or (N, n)."""
        rows = np.asarray(rows)
        packed = rows.astype(np.dtype(kind).newbyteorder("<")).tobytes()
        width = 1 if rows.ndim == 1 else rows.shape[1]
        entry = {"componentType": COMPONENT[kind], "count": len(rows), "type": TYPES[width], **more}
        entry["bufferView"] = self.view(packed) if view is None else view
        if normalized:
            entry["normalized"] = True
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1

    def mesh(self, attributes, indices=None, name="head", **more) -> int:
        """A mesh of one primitive; attributes by name, as accessors."""
        primitive = {"attributes": attributes, **more}
        if indices is not None:
            primitive["indices"] = indices
        self.tree["meshes"].append({"name": name, "primitives": [primitive]})
        return len(self.tree["meshes"]) - 1

    def material(self, **entry) -> int:
        self.tree.setdefault("materials", []).append(entry)
        return len(self.tree["materials"]) - 1

    def image(self, data: bytes, kind="image/png", uri: str | None = None, name=None) -> dict:
        """A picture, within the buffer or where `uri` says; gives `{"index": texture}`, as materials have it."""
        entry = {"uri": uri} if uri else {"bufferView": self.view(data), "mimeType": kind}
        images, textures = (self.tree.setdefault(key, []) for key in ("images", "textures"))
        images.append(entry | ({"name": name} if name else {}))
        textures.append({"source": len(images) - 1})
        return {"index": len(textures) - 1}

    def glb(self) -> bytes:
        self.tree["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        length = 12 + 8 + len(text) + 8 + len(data)
        head = struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(data), b"BIN\0") + data

    def gltf(self, uri: str | None = None) -> bytes:
        """The JSON; the buffer in a file of its own where `uri` names one, else in the text."""
        data = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.data)).decode()
        self.tree["buffers"] = [{"byteLength": len(self.data), "uri": uri or data}]
        return json.dumps(self.tree).encode()


def vertices_of(mesh):
    """Positions, UVs (glTF's, v down), normals and triangles of a SkinMesh, one vertex a corner."""
    uv = mesh.corner_uv.reshape(-1, 2)
    faces = np.arange(len(mesh.faces) * 3).reshape(-1, 3)
    down = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
    return mesh.corner_position_mm.reshape(-1, 3), down, mesh.corner_normal.reshape(-1, 3), faces


def plain(mesh, **more):
    """A Gltf of a SkinMesh in float32, with its attributes by name."""
    positions, uv, normals, faces = vertices_of(mesh)
    made = Gltf()
    attributes = {
        "POSITION": made.accessor(positions),
        "TEXCOORD_0": made.accessor(uv),
        "NORMAL": made.accessor(normals),
    }
    made.mesh(attributes, made.accessor(faces.ravel(), "I"), **more)
    return made, attributes
