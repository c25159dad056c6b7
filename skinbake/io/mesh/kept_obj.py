"""Large OBJ files as arrays in the user's cache: text takes longer to read than most of a draft's other steps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of, sha256_of
from skinbake.io.mesh.obj import read_obj
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.io.user_cache import user_cache

WORTH_BYTES = 2**20  # of text: half a second in ten such
_ARRAYS = ("positions", "faces", "corner_uv", "has_uv", "corner_normal", "part")


def read_kept_obj(path: Path) -> RawMesh:
    """What `read_obj` gives, which also has the errors; from the user's cache where that very text was read before."""
    cache = user_cache() if path.stat().st_size >= WORTH_BYTES else None
    if cache is None:
        return read_obj(path)
    key = key_of(code_digest("skinbake.io.mesh.obj"), sha256_of(path))
    entry = cache.read(key)
    if entry is not None:
        return _mesh(entry)
    mesh = read_obj(path)
    cache.write(key, _entry(mesh))
    return mesh


def _entry(mesh: RawMesh) -> dict[str, Any]:
    """A mesh as the cache holds it."""
    names = np.frombuffer(json.dumps(mesh.names).encode("utf-8", "surrogatepass"), np.uint8)
    entry = {name: getattr(mesh, name) for name in _ARRAYS} | {"names": names}
    return entry if mesh.corner_rgb is None else entry | {"corner_rgb": mesh.corner_rgb}


def _mesh(entry: dict[str, Any]) -> RawMesh:
    """The mesh of an entry."""
    names = json.loads(entry["names"].tobytes().decode("utf-8", "surrogatepass"))
    arrays: dict[str, Any] = {name: entry[name] for name in _ARRAYS}
    return RawMesh(**arrays, names=tuple(tuple(each) for each in names), corner_rgb=entry.get("corner_rgb"))
