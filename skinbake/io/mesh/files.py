"""Which files a mesh is made of."""

from __future__ import annotations

from pathlib import Path

from skinbake.io.mesh.gltf_file import files_of_gltf
from skinbake.io.mesh.usd import SUFFIXES, files_of_usd


def mesh_files(path: Path | str) -> tuple[Path, ...]:
    """A mesh's own file, there or not, then the buffers, images and layers that it names and that are there."""
    path = Path(path)
    if path.suffix.lower() in SUFFIXES and path.is_file():
        return (path, *files_of_usd(path))
    if path.suffix.lower() not in (".gltf", ".glb") or not path.is_file():
        return (path,)
    return (path, *files_of_gltf(path))
