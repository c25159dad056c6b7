"""glTF 2.0 as a container: its JSON, the files it names, its buffers and accessors."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.numerics import Float

GEOMETRY_EXTENSIONS = {
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
}
# Required by some exporters though they change neither where skin is nor its UVs
HARMLESS = ("KHR_materials_", "KHR_lights_", "KHR_texture_basisu", "EXT_texture_", "MSFT_texture_", "KHR_xmp",
            "KHR_animation_", "VRM", "EXT_lights_")  # fmt: skip
COMPONENT = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
LARGEST_ARRAY = 2**31  # bytes of one accessor, more than any buffer that its 32-bit indices can address well
MESHOPT_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")


class GltfFile:
    """A .gltf or .glb file, opened.

    Attributes
    ----------
    path : path
    tree : dict
        The JSON.

    Raises
    ------
    InputError
        The file is no glTF 2.0, or requires an extension that is not supported, which the message names.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tree, self._binary = _opened(path)
        version = str(self._mapping(self.tree.get("asset", {})).get("version", ""))
        if not version.startswith("2."):
            raise InputError(f"{path}: expected glTF 2.0, got version {version or 'none'}; export it again as glTF 2.0")
        for name in self.tree.get("extensionsRequired", []):
            if name not in GEOMETRY_EXTENSIONS and not str(name).startswith(HARMLESS):
                raise InputError(f"{path}: requires {name}, which is not supported; export it without {name}")

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """One entry of a top-level list.

        Raises
        ------
        InputError
            There is no such entry.
        """
        entries = self.tree.get(kind, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            raise InputError(f"{self.path}: expected one of {len(entries)} {kind}, got {index!r}")
        return self._mapping(entries[index])

    def _mapping(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise InputError(f"{self.path}: damaged glTF, expected a JSON object, got {value!r:.80}")
        return value

    @cached_property
    def _buffers(self) -> dict[int, bytes]:
        return {}

    def buffer(self, index: Any) -> bytes:
        """The bytes of a buffer.

        Raises
        ------
        InputError
            It holds no data, or too little.
        """
        entry = self.item("buffers", index)
        if index not in self._buffers:
            length = int(entry["byteLength"])
            if "uri" in entry:
                data = self.resource(entry["uri"])
            elif index == 0 and self._binary is not None:
                data = self._binary
            else:
                raise InputError(f"{self.path}: buffer {index} holds no data")
            if len(data) < length:
                raise InputError(f"{self.path}: buffer {index}: expected {length} bytes, got {len(data)}; cut off?")
            self._buffers[index] = data
        return self._buffers[index]

    def resource(self, uri: str) -> bytes:
        """What a URI leads to: data in the file itself, or another file beside it.

        Raises
        ------
        InputError
            There is no such file beside it, or its data cannot be decoded.
        """
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            try:
                return base64.b64decode(unquote(body)) if head.endswith(";base64") else unquote_to_bytes(body)
            except (binascii.Error, ValueError) as error:
                raise InputError(f"{self.path}: expected base64 in a data URI: {error}") from None
        file = file_of(self.path, uri)
        if file is None:
            raise InputError(f"{self.path}: names {uri}, which is not a file beside it")
        try:
            return file.read_bytes()
        except OSError as error:
            raise InputError(
                f"{self.path}: names {uri}: {file}: {error.strerror or error}; keep the two files together"
            ) from None

    def view(self, index: Any) -> tuple[bytes | memoryview, int]:
        """The bytes of a buffer view, decompressed, and their stride (0: packed)."""
        entry = self.item("bufferViews", index)
        extensions = entry.get("extensions", {})
        for name in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
            if name in extensions:
                return self._meshopt(name, extensions[name]), int(extensions[name]["byteStride"])
        return self._slice(entry), int(entry.get("byteStride", 0))

    def _slice(self, entry: dict[str, Any]) -> memoryview:
        data = self.buffer(entry["buffer"])
        start, length = int(entry.get("byteOffset", 0)), int(entry["byteLength"])
        if not 0 <= start <= start + length <= len(data):
            raise InputError(f"{self.path}: a buffer view reaches past its buffer of {len(data)} bytes")
        return memoryview(data)[start : start + length]

    def _meshopt(self, name: str, entry: dict[str, Any]) -> bytes:
        try:
            import meshoptimizer
        except ImportError:
            raise InputError(
                f"{self.path}: uses {name}; install its decoder with pip install 'skinbake[meshopt]',"
                " or export without meshopt compression"
            ) from None
        count, stride, mode = int(entry["count"]), int(entry["byteStride"]), entry.get("mode")
        packed = bytes(self._slice(entry))
        if mode not in MESHOPT_MODES or not 0 < stride <= 256 or not 0 <= count * stride < LARGEST_ARRAY:
            raise InputError(f"{self.path}: damaged {name}: count {count}, stride {stride}, mode {mode}")
        if mode != "ATTRIBUTES" and (stride not in (2, 4) or (mode == "TRIANGLES" and count % 3)):
            raise InputError(f"{self.path}: damaged {name}: {count} indices of {stride} bytes")
        if not count:
            return b""
        if mode != "ATTRIBUTES":
            decode = meshoptimizer.decode_index_buffer if mode == "TRIANGLES" else meshoptimizer.decode_index_sequence
            found = decode(count, stride, packed)  # 16-bit indices lie packed in an array of 32-bit ones
            return found.tobytes()[: count * stride]
        found = meshoptimizer.decode_vertex_buffer(count, stride, packed, dtype=np.dtype((np.void, stride)))
        filters = {"OCTAHEDRAL": "oct", "QUATERNION": "quat", "EXPONENTIAL": "exp"}
        chosen = entry.get("filter", "NONE")
        if chosen in filters:
            if stride % 4:
                raise InputError(f"{self.path}: damaged {name}: filter {chosen} on a stride of {stride}")
            found = getattr(meshoptimizer, f"decode_filter_{filters[chosen]}")(found, count, stride)
        elif chosen != "NONE":
            raise InputError(f"{self.path}: {name}: filter {chosen} is not supported")
        return found.tobytes()

    def accessor(self, index: Any, columns: tuple[int, ...]) -> NDArray:
        """Rows of an accessor as they are stored, shape (count, n) with n one of `columns`; sparse values filled in.

        Raises
        ------
        InputError
            The accessor does not fit, or reaches past its data.
        """
        entry = self.item("accessors", index)
        width, count = COLUMNS[entry["type"]], int(entry["count"])
        if width not in columns:
            raise InputError(
                f"{self.path}: accessor {index}: expected {' or '.join(map(str, columns))} numbers, got {entry['type']}"
            )
        kind = np.dtype(COMPONENT[entry["componentType"]]).newbyteorder("<")
        if not 0 <= count * width * kind.itemsize < LARGEST_ARRAY:
            raise InputError(f"{self.path}: accessor {index}: expected fewer values, got {count}")
        if "bufferView" in entry:
            rows = self._rows(entry["bufferView"], int(entry.get("byteOffset", 0)), count, width, kind)
        else:
            rows = np.zeros((count, width), kind)
        if "sparse" in entry:
            sparse, rows = entry["sparse"], rows.copy()
            changed = int(sparse["count"])
            where, what = sparse["indices"], sparse["values"]
            if not 0 <= changed <= count:
                raise InputError(f"{self.path}: accessor {index}: {changed} sparse values of {count}")
            index_kind = np.dtype(COMPONENT[where["componentType"]]).newbyteorder("<")
            places = self._rows(where["bufferView"], int(where.get("byteOffset", 0)), changed, 1, index_kind)[:, 0]
            values = self._rows(what["bufferView"], int(what.get("byteOffset", 0)), changed, width, kind)
            if changed and (places.min() < 0 or places.max() >= count):
                raise InputError(f"{self.path}: accessor {index}: a sparse value past its {count} values")
            rows[places.astype(np.int64)] = values
        return rows

    def _rows(self, view: Any, offset: int, count: int, width: int, kind: np.dtype) -> NDArray:
        data, stride = self.view(view)
        row = width * kind.itemsize
        stride = stride or row
        if stride < row or offset < 0 or (count and offset + (count - 1) * stride + row > len(data)):
            raise InputError(f"{self.path}: an accessor of {count} values reaches past its {len(data)} bytes")
        if not count:
            return np.zeros((0, width), kind)
        return np.ndarray((count, width), kind, data, offset, (stride, kind.itemsize))

    def numbers(self, index: Any, columns: tuple[int, ...]) -> Float:
        """Rows of an accessor as numbers: normalised integers as fractions, others as they are."""
        return as_numbers(self.accessor(index, columns), bool(self.item("accessors", index).get("normalized", False)))


def as_numbers(rows: NDArray, normalized: bool) -> Float:
    """Stored values as float64; `normalized` integers span [0, 1], or [-1, 1] where they have a sign."""
    numbers = rows.astype(np.float64)
    if normalized and rows.dtype.kind in "iu":
        numbers = np.maximum(numbers / np.iinfo(rows.dtype).max, -1.0)
    return numbers


def file_of(path: Path, uri: Any) -> Path | None:
    """The file beside `path` that a relative URI names, percent-encoded or as it is; None for data and networks."""
    if not isinstance(uri, str) or not uri or uri.startswith(("data:", "http:", "https:")) or "\0" in unquote(uri):
        return None
    decoded = path.parent / unquote(uri)
    written = path.parent / uri
    return written if not decoded.exists() and written.exists() else decoded


def files_of_gltf(path: Path) -> tuple[Path, ...]:
    """Buffers and images that a .gltf or .glb names and that are there."""
    try:
        tree, _ = _opened(path)
        entries = [entry for kind in ("buffers", "images") for entry in tree.get(kind, [])]
        found = [file_of(path, entry.get("uri")) for entry in entries]
        return tuple(dict.fromkeys(file for file in found if file is not None and file.is_file()))
    except (InputError, OSError, AttributeError, TypeError, ValueError):
        return ()  # whoever reads the mesh says what is wrong with it


def _opened(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """The JSON of a file and, of a GLB, its binary chunk."""
    data = path.read_bytes()
    binary = None
    if data[:4] == b"glTF":
        if len(data) < 20:
            raise InputError(f"{path}: expected a GLB, got {len(data)} bytes; cut off?")
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise InputError(f"{path}: expected glTF 2.0, got GLB version {version}; export it again as glTF 2.0")
        if length > len(data):
            raise InputError(f"{path}: expected {length} bytes, got {len(data)}; cut off?")
        chunks: dict[bytes, bytes] = {}
        offset = 12
        while offset + 8 <= length:
            size, kind = struct.unpack_from("<I4s", data, offset)
            if offset + 8 + size > length:
                raise InputError(f"{path}: a chunk of {size} bytes reaches past the end; cut off?")
            chunks.setdefault(kind, data[offset + 8 : offset + 8 + size])
            offset += 8 + size
        data, binary = chunks.get(b"JSON", b""), chunks.get(b"BIN\0")
    elif path.suffix.lower() == ".glb":
        raise InputError(f"{path}: expected a GLB, which begins with glTF, got {data[:4]!r}")
    try:
        tree = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected the JSON of a glTF: {str(error)[:120]}") from None
    if not isinstance(tree, dict):
        raise InputError(f"{path}: expected the JSON object of a glTF, got {type(tree).__name__}")
    return tree, binary
