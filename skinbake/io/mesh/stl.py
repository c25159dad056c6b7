"""STL, text or binary: triangles, nothing else; normals of facets are those of the triangles."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.raw_mesh import RawMesh, bare_mesh

_HEADER = 84  # bytes, the last four of which count the facets
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_BEGIN, _END = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE), re.compile(rb"\bendfacet\b", re.IGNORECASE)


def read_stl(path: Path) -> RawMesh:
    """Read an STL file.

    Raises
    ------
    InputError
        The file is damaged; the message says how.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    size = _HEADER + _FACET.itemsize * count
    if len(data) == size:  # whatever it begins with: headers of binary files say solid, too
        with np.errstate(invalid="ignore"):  # NaN of a damaged file, which is refused later
            corners = np.frombuffer(data, _FACET, count, _HEADER)["corners"].astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _text(path, data)
    else:
        raise InputError(f"{path}: expected {count} triangles in {size} bytes, got {len(data)} bytes; cut off?")
    return bare_mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def _text(path: Path, data: bytes) -> np.ndarray:
    """Corners of all facets, (3 F, 3)."""
    facets, ends, found = len(_BEGIN.findall(data)), len(_END.findall(data)), _CORNER.findall(data)
    if len(found) != 3 * facets or ends != facets:
        raise InputError(
            f"{path}: expected {facets} facets of three vertices, got {len(found)} vertices and {ends} ends; cut off?"
        )
    try:
        return np.array(found, dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise InputError(f"{path}: expected numbers after vertex: {str(error)[:80]}") from None
