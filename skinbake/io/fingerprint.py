"""Digests (sha256) of what a file or a stage depends on: the same inputs give the same key, so a key tells what is
stale.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

from skinbake.errors import InputError
from skinbake.io.mesh.files import mesh_files
from skinbake.scene.spec import SceneSpec

PACKAGE = Path(__file__).parent.parent


def sha256_of(path: Path | str) -> str:
    """Digest of a file's bytes.

    Raises
    ------
    InputError
        The file is missing or cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:  # ValueError: a NUL byte, from a damaged manifest
        got = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: expected a file that can be read, got: {got}") from error


def key_of(*parts: Any) -> str:
    """Digest of plain values (anything JSON can hold)."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


@cache
def code_key(*parts: str) -> str:
    """Digest of the package's shared modules and of `parts`, folders or files: results of other code are not reused."""
    files = [*PACKAGE.glob("*.py"), *(PACKAGE / "scene").glob("*.py")]
    for part in parts:
        files += (PACKAGE / part).rglob("*.py") if (PACKAGE / part).is_dir() else [PACKAGE / part]
    digest = hashlib.sha256()
    for file in sorted(set(files)):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def input_files(spec: SceneSpec) -> dict[str, tuple[Path, ...]]:
    """Files a look reads, by role; a map with `<UDIM>` in its name has one file a tile, a .gltf may name others.

    Raises
    ------
    InputError
        A pattern that no file matches.
    """
    roles: dict[str, str | None] = {"mesh": spec.mesh.path}
    for role in ("albedo", "normal", "roughness", "specular"):
        chosen = getattr(spec.maps, role)
        roles[role] = chosen.path if chosen else None
    for light in spec.lights:
        roles[f"light.{light.name}"] = getattr(light, "path", None)
    roles["skin"] = getattr(spec.skin, "path", None)
    found = {role: tuple(files_named(path)) for role, path in roles.items() if path is not None}
    found["mesh"] = mesh_files(spec.mesh.path)
    for index, occluder in enumerate(spec.occluders):
        found[f"occluder.{index}"] = mesh_files(occluder.path)
        if occluder.opacity is not None:
            found[f"occluder.{index}.opacity"] = (Path(occluder.opacity),)
    for role, files in found.items():
        if not files:
            raise InputError(f"{roles[role]}: expected a file for at least one UDIM tile, found none")
    return found


def files_named(path: str) -> list[Path]:
    """The file of a path, there or not; of one with `<UDIM>`, the tiles' files that are there."""
    if "<UDIM>" not in path:
        return [Path(path)]
    pattern = Path(path)
    return sorted(pattern.parent.glob(pattern.name.replace("<UDIM>", "[0-9][0-9][0-9][0-9]")))


def digest_of(paths: tuple[Path, ...]) -> str:
    """Digest of one role: of its file, or of its files' names and contents."""
    return sha256_of(paths[0]) if len(paths) == 1 else key_of([(p.name, sha256_of(p)) for p in paths])


def input_hashes(spec: SceneSpec) -> dict[str, str]:
    """Digest of each role's file or files."""
    return {role: digest_of(paths) for role, paths in input_files(spec).items()}


def input_stamps(spec: SceneSpec) -> dict[Path, tuple[int, ...] | None]:
    """Time, size and place of every input, None where it is gone: they tell whether a file was changed meanwhile."""
    return {path: _stamp(path) for paths in input_files(spec).values() for path in paths}


def _stamp(path: Path) -> tuple[int, ...] | None:
    """Time, size and place of a file, None where it is gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
